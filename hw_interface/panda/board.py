"""Memory that a supervisor and its player share: clearances one way, a millisecond's measurements the other.

It lives in an anonymous file of the operating system (`memfd_create`), whose descriptor the child process inherits; so
nothing is left behind however either of them ends. Each side writes only its own half. A writer makes the sequence
number odd, writes, and makes it even; a reader that saw it odd or changing, or a checksum that does not fit, tries
again a millisecond later. Nobody ever waits for the other.
"""

import mmap
import os
import zlib
from typing import NamedTuple

import numpy as np

from hw_interface.panda.clearance import MOST_ROWS, Clearance

RING = 4096  # measurements that a supervisor may fall behind before some are lost: four seconds

_ORDER = np.dtype(
    [
        ("sequence", "<u8"),
        ("motion", "<u8"),  # ordinal number of the motion, from 1
        ("part", "<i8"),
        ("first", "<i8"),
        ("count", "<i8"),
        ("planned", "<i8"),
        ("checksum", "<u8"),
        ("progress", "<f8", MOST_ROWS),
    ]
)
MEASUREMENT = np.dtype(
    [
        ("number", "<u8"),  # of the measurement, from 1
        ("monotonic", "<f8"),  # [s], CLOCK_MONOTONIC when it came in
        ("robot_time", "<f8"),  # [s] on the control box's clock
        ("motion", "<u8"),
        ("row", "<i8"),  # that was commanded; -1 while nothing is
        ("mode", "<u8"),  # as in libfranka.RobotMode
        ("q", "<f8", 7),
        ("qd", "<f8", 7),
        ("tau", "<f8", 7),
        ("q_d", "<f8", 7),
        ("tau_ext", "<f8", 7),
        ("force", "<f8", 3),  # [N] on the end effector in the base frame
        ("success_rate", "<f8"),
    ]
)
_REPORT = np.dtype(
    [
        ("written", "<u8"),  # measurements so far
        ("alive", "<u8"),  # counts turns of the player's loop
        ("taken", "<u8"),  # sequence number of the last clearance that was taken
        ("refused", "<u8"),  # and of the last one that was not
        ("late", "<u8"),  # whether that was only too late
        ("ring", MEASUREMENT, RING),
    ]
)


class Order(NamedTuple):
    """A clearance with the part that it belongs to, and its sequence number."""

    sequence: int
    motion: int
    part: int
    clearance: Clearance


class ClearanceBoard:
    """One side's view of the shared memory.

    Attributes:
        descriptor: Of the memory, for a child process to inherit.
    """

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor
        self._map = mmap.mmap(descriptor, _ORDER.itemsize + _REPORT.itemsize)
        self._order = np.frombuffer(self._map, _ORDER, 1)
        self._report = np.frombuffer(self._map, _REPORT, 1, _ORDER.itemsize)
        self._ring = self._report["ring"][0]
        self._seen = 0  # sequence number of the order that was read last

    @classmethod
    def create(cls) -> "ClearanceBoard":
        """A board of its own memory."""
        descriptor = os.memfd_create("replan-player", os.MFD_CLOEXEC)
        os.ftruncate(descriptor, _ORDER.itemsize + _REPORT.itemsize)
        return cls(descriptor)

    # --- the supervisor's half ----------------------------------------------------------------------------------

    def post(self, motion: int, part: int, clearance: Clearance) -> int:
        """Give a clearance; returns its sequence number."""
        order, count = self._order, len(clearance.progress)
        sequence = int(order["sequence"][0]) + 2 & ~1
        order["sequence"] = sequence - 1
        order["motion"], order["part"], order["first"], order["count"] = motion, part, clearance.first, count
        order["planned"] = clearance.planned
        order["progress"][0, :count] = clearance.progress
        order["checksum"] = _checksum(motion, part, clearance)
        order["sequence"] = sequence
        return sequence

    def order(self) -> Order | None:
        """The latest clearance if it was not read before; None as well while it is being written or is damaged."""
        order = self._order
        sequence = int(order["sequence"][0])
        if sequence == self._seen or sequence % 2:
            return None
        count = min(max(int(order["count"][0]), 0), MOST_ROWS)
        motion, part = int(order["motion"][0]), int(order["part"][0])
        clearance = Clearance(int(order["first"][0]), order["progress"][0, :count].copy(), int(order["planned"][0]))
        if int(order["checksum"][0]) != _checksum(motion, part, clearance) or int(order["sequence"][0]) != sequence:
            return None
        self._seen = sequence
        return Order(sequence, motion, part, clearance)

    # --- the player's half --------------------------------------------------------------------------------------

    def turn(self) -> None:
        """Say that the player's loop lives."""
        self._report["alive"] += np.uint64(1)

    def tell_order(self, sequence: int, refused: str | None) -> None:
        """Say what became of a clearance."""
        self._report["taken" if refused is None else "refused"] = sequence
        self._report["late"] = refused == "late"

    def next_measurement(self) -> np.ndarray:
        """The place of the next measurement, a structured view of shape (); publish it when it is filled."""
        return self._ring[int(self._report["written"][0]) % RING : int(self._report["written"][0]) % RING + 1]

    def publish_measurement(self) -> None:
        """Hand the filled place over."""
        place = self.next_measurement()
        place["number"] = self._report["written"][0] + np.uint64(1)
        self._report["written"] += np.uint64(1)

    @property
    def written(self) -> int:
        """Number of the latest measurement."""
        return int(self._report["written"][0])

    @property
    def alive(self) -> int:
        """Turns of the player's loop so far."""
        return int(self._report["alive"][0])

    @property
    def taken(self) -> int:
        """Sequence number of the last clearance that the player took."""
        return int(self._report["taken"][0])

    @property
    def refused(self) -> tuple[int, bool]:
        """Sequence number of the last clearance that it refused, and whether that came only too late."""
        return int(self._report["refused"][0]), bool(self._report["late"][0])

    def measurements(self, after: int) -> np.ndarray:
        """Copies of the measurements after number `after`, in order, the oldest ones missing when they were lost."""
        written = int(self._report["written"][0])
        first = max(after, written - RING + 64)  # the writer may be about to reuse the oldest places
        rows = self._ring[np.arange(first, written) % RING].copy()
        return rows[rows["number"] == np.arange(first + 1, written + 1, dtype="<u8")]

    def close(self) -> None:
        """Let go of the memory."""
        os.close(self.descriptor)


def _checksum(motion: int, part: int, clearance: Clearance) -> int:
    head = np.array([motion, part, clearance.first, len(clearance.progress), clearance.planned], "<i8")
    return zlib.crc32(clearance.progress.tobytes(), zlib.crc32(head.tobytes()))
