"""How far the robot process's clock is from this computer's, measured by asking it for the time.

A question that leaves at t0 and is answered at t1 with the robot's time r says that the robot's clock showed r at some
moment between the two: the offset is r - (t0 + t1) / 2, wrong by at most (t1 - t0) / 2 either way. The quickest of
several round trips says it best (Cristian, "Probabilistic clock synchronization", 1989). Between measurements clocks
drift apart; `DRIFT` bounds how fast.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass

from control.errors import RefusedError

ROUNDS = 12  # questions of one measurement
AGAIN = 10.0  # [s] between two measurements
DRIFT = 1e-4  # [s/s]; computers' quartz crystals are within 50 ppm, one on either side
LIMIT = 0.02  # [s]; a hand at 0.3 m/s has moved 6 mm by then
STEP = 0.005  # [s] that the wall clock may move against the monotonic one before it counts as set anew


@dataclass(frozen=True)
class ClockOffset:
    """One measurement.

    Attributes:
        offset: The robot's wall clock less this computer's, in [s].
        uncertainty: By how much that may be wrong, in [s].
        at: This computer's monotonic clock then, in [s].
        wall_less_monotonic: This computer's wall clock less its monotonic one then, in [s].
    """

    offset: float
    uncertainty: float
    at: float
    wall_less_monotonic: float


class RobotClock:
    """Turns stamps of this computer's wall clock into stamps of the robot's; not thread-safe.

    Args:
        ask: Asks the robot process for the time on its wall clock in [s]; may raise RobotGoneError.
        wall, monotonic: This computer's clocks in [s].
        limit: Largest uncertainty that stamps may have in [s].

    Attributes:
        jumps: How often this computer's or the robot's clock was set anew while this ran.
    """

    def __init__(
        self,
        ask: Callable[[], float],
        wall: Callable[[], float] = time.time,
        monotonic: Callable[[], float] = time.monotonic,
        limit: float = LIMIT,
    ) -> None:
        self._ask = ask
        self._wall = wall
        self._monotonic = monotonic
        self._limit = limit
        self._latest: ClockOffset | None = None
        self.jumps = 0

    @property
    def offset(self) -> float | None:
        """The robot's clock less this computer's in [s], as measured last; None before that."""
        return None if self._latest is None else self._latest.offset

    @property
    def uncertainty(self) -> float | None:
        """By how much the offset may be wrong now in [s]; None before the first measurement."""
        latest = self._latest
        return None if latest is None else latest.uncertainty + DRIFT * (self._monotonic() - latest.at)

    def keep(self) -> None:
        """Measure if it is time to, or if this computer's clock was set anew.

        Raises:
            RobotGoneError: The robot process does not answer.
        """
        latest = self._latest
        if latest is not None:
            moved = self._wall() - self._monotonic() - latest.wall_less_monotonic
            if abs(moved) > STEP:
                self.jumps += 1
                self._latest = latest = None
        if latest is None or self._monotonic() - latest.at > AGAIN:
            self._measure()

    def to_robot(self, stamp: float) -> float:
        """A stamp of this computer's wall clock on the robot's, in [s].

        Raises:
            RefusedError: clock_unsure: the offset may be wrong by more than the limit.
            RobotGoneError: The robot process does not answer.
        """
        self.keep()
        uncertainty, latest = self.uncertainty, self._latest
        assert uncertainty is not None and latest is not None
        if uncertainty > self._limit:
            raise RefusedError(
                "clock_unsure",
                f"this computer's clock is {latest.offset:+.3f} s from the robot's, give or take "
                f"{1000 * uncertainty:.0f} ms; at most {1000 * self._limit:.0f} ms are allowed: use a quicker link to "
                "the robot's computer, or run the camera there",
            )
        return stamp + latest.offset

    def _measure(self) -> None:
        best: ClockOffset | None = None
        for _ in range(ROUNDS):
            before = self._monotonic()
            base = self._wall() - before
            robot = self._ask()
            after = self._monotonic()
            half = (after - before) / 2
            if best is None or half < best.uncertainty:
                best = ClockOffset(robot - (base + before + half), half, after, base)
        assert best is not None
        known = self._latest
        if known is not None:
            allowed = best.uncertainty + known.uncertainty + DRIFT * (best.at - known.at)
            if abs(best.offset - known.offset) > max(allowed, STEP):
                self.jumps += 1  # the robot's clock was set; what is measured now holds from now on
        self._latest = best
