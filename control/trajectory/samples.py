"""Paths and trajectories: what planning finds, and what a robot is asked to play. Needs numpy only."""

import hashlib
import struct
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from control.errors import TrajectoryError
from control.robot.limits import JOINT_NAMES

FINGERS = "fingers"  # the gripper's, in pairs of names that may touch
SAMPLE_TIME = 1e-3  # [s]; the Panda's control period


@dataclass(frozen=True)
class GripperCommand:
    """What the gripper should do.

    Attributes:
        kind: `move` opens or closes to a width; `grasp` closes until the force is reached.
        width: Distance between the finger pads in [m]; for a grasp the width of the object.
        force: Grasp force in [N]; unused by `move`.
    """

    kind: Literal["move", "grasp"]
    width: float
    force: float = 40.0


@dataclass(frozen=True)
class PathSegment:
    """A piece of joint path between two stops, without times.

    Attributes:
        name: What it does: "reach", "approach", "lift", "carry", "lower", "retreat", "home".
        q: Dense waypoints in [rad], shape (n, 7); the first equals the last one of the segment before.
        gripper: Command given when the segment has come to rest, or None.
        held: Name of the object in the hand while this segment is played, or None.
        touching: Pairs of names that may touch during the segment beyond fingers and held object, for instance
            ("red_cube", "crate"), "table" being the support; what the fingers come to or let go stands with `FINGERS`.
        speed_scale: Share of the allowed speed to use, 0..1 (slower near contacts).
    """

    name: str
    q: NDArray[np.float64]
    gripper: GripperCommand | None = None
    held: str | None = None
    touching: tuple[tuple[str, str], ...] = ()
    speed_scale: float = 1.0


@dataclass(frozen=True)
class JointPath:
    """A whole motion without times: segments that each start and end at rest.

    Attributes:
        segments: In order, at least one.
    """

    segments: tuple[PathSegment, ...]


@dataclass(frozen=True)
class GripperEvent:
    """A gripper command at a moment of a trajectory.

    Attributes:
        time: When the command is given, in [s] from the start; the arm rests for `dwell` from then on.
        dwell: Time in [s] that the trajectory gives the gripper; it must have finished by its end.
        command: What to do.
    """

    time: float
    dwell: float
    command: GripperCommand


@dataclass(frozen=True)
class TrajectorySegment:
    """A named stretch of a trajectory: samples start <= k < stop.

    Attributes:
        held: Name of what is in the hand meanwhile, or None.
        touching: As in `PathSegment`.
        held_mass: What that weighs in [kg] as it was counted in the torques, its centre taken at the tool centre
            point; None where nobody said. A robot is told it as its load.
    """

    name: str
    start: int
    stop: int
    held: str | None = None
    touching: tuple[tuple[str, str], ...] = ()
    held_mass: float | None = None


@dataclass(frozen=True)
class Trajectory:
    """Samples every millisecond, exactly as a robot plays them.

    Attributes:
        q: Joint positions in [rad], float64, shape (n, 7), n >= 2.
        qd: Joint velocities in [rad/s], shape (n, 7).
        qdd: Joint accelerations in [rad/s^2], shape (n, 7).
        gripper: Events in order of time.
        segments: Stretches in order, covering all samples.
        joint_names: Order of the columns.

    Raises:
        TrajectoryError: Wrong shapes, fewer than two samples, or a number that is not finite (naming row and joint).
    """

    q: NDArray[np.float64]
    qd: NDArray[np.float64]
    qdd: NDArray[np.float64]
    gripper: tuple[GripperEvent, ...] = ()
    segments: tuple[TrajectorySegment, ...] = ()
    joint_names: tuple[str, ...] = JOINT_NAMES

    def __post_init__(self) -> None:
        for label in ("q", "qd", "qdd"):
            array = np.ascontiguousarray(getattr(self, label), dtype=np.float64)
            if array.ndim != 2 or array.shape[1] != len(self.joint_names) or len(array) < 2:
                raise TrajectoryError(
                    f"trajectory field {label} has shape {array.shape}; it needs (n >= 2, {len(self.joint_names)})"
                )
            if array.shape != np.shape(self.q):
                raise TrajectoryError(f"trajectory field {label} has shape {array.shape}, q has {np.shape(self.q)}")
            if not np.isfinite(array).all():
                row, joint = np.argwhere(~np.isfinite(array))[0]
                raise TrajectoryError(
                    f"trajectory field {label} is not finite in row {row}, joint '{self.joint_names[joint]}'"
                )
            array.flags.writeable = False
            object.__setattr__(self, label, array)

    @property
    def duration(self) -> float:
        """Time from the first to the last sample in [s]."""
        return (len(self.q) - 1) * SAMPLE_TIME

    def content_hash(self) -> str:
        """SHA-256 over every bit that a robot would act on: samples, joint order, gripper events, segments."""
        digest = hashlib.sha256()
        digest.update(struct.pack("<qd", len(self.q), SAMPLE_TIME))
        for array in (self.q, self.qd, self.qdd):
            digest.update(array.astype("<f8", copy=False).data)
        for event in self.gripper:
            c = event.command
            digest.update(struct.pack("<dddd", event.time, event.dwell, c.width, c.force) + c.kind.encode() + b"\0")
        for s in self.segments:
            touching = ";".join(f"{a},{b}" for a, b in s.touching)
            mass = "" if s.held_mass is None else f"|{float(s.held_mass).hex()}"
            digest.update(f"{s.name}|{s.start}|{s.stop}|{s.held}|{touching}{mass}\n".encode())
        digest.update("|".join(self.joint_names).encode())
        return digest.hexdigest()
