"""What a motion file holds once it is read, whatever its format, and what every file is held to.

A file is refused when it cannot mean a motion of this robot in SI units: numbers that are not finite or absurd, times
that do not increase, degrees, milliseconds. Whether the motion is a good one (limits, jumps, collisions) is not
decided here: that is what reading it is for.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from control.errors import MotionFileError
from control.trajectory.samples import GripperEvent, Trajectory, TrajectorySegment

MAX_DURATION = 180.0  # [s]; as long as a robot accepts at 1 kHz
MAX_ROWS = 360_000  # that long at 2 kHz
BEYOND_ANY_JOINT = 7.0  # [rad]; the joint that turns furthest reaches 3.75
LARGEST = {  # beyond these nothing is meant seriously
    "position": (1e3, "rad"),
    "velocity": (1e5, "rad/s"),
    "acceleration": (1e8, "rad/s^2"),
}
WIDEST = 1.0  # [m]; no gripper opens as far
FASTEST = 10.0  # [rad/s]; the Panda's joints reach 2.61
COARSE_STEP = 0.5  # [s] between rows
DEGREE_SPEEDS = (50.0, 65.0)  # velocities relative to the slope of positions; 57.3 when they are in degrees
TIME_UNITS = (("nanoseconds", 1e9), ("microseconds", 1e6), ("milliseconds", 1e3))


@dataclass(frozen=True)
class MotionFile:
    """A motion as its file has it; arrays are read-only.

    Attributes:
        path: The file.
        source: Its format in words.
        times: Time of each row in [s], increasing, starting where the file starts, shape (n,), n >= 2.
        q: Joint positions in [rad] in the robot's joint order, shape (n, 7).
        joint_names: The file's names of these joints, in the robot's order.
        row_word: What the file's rows are called in messages: "line", "row", "point" or "message".
        row_numbers: Of each row as a person would find it, shape (n,): lines of a text file count from 1 with header
            and comments, everything else from 0.
        qd: Joint velocities in [rad/s], shape (n, 7), or None when the file has none.
        qdd: Joint accelerations in [rad/s^2], shape (n, 7), or None.
        gripper_width: Distance between the pads in [m], shape (n,), or None.
        gripper_force: Grasp force in [N] asked for from each row on, 0 where nothing is to be grasped, shape (n,), or
            None.
        trajectory: The trajectory itself, bit for bit, when the file was written by `write_trajectory`; else None.
        notes: What a reader of a report should know of how the file was understood, as sentences.
    """

    path: Path
    source: str
    times: NDArray[np.floating]
    q: NDArray[np.float64]
    joint_names: tuple[str, ...]
    row_word: str
    row_numbers: NDArray[np.int64]
    qd: NDArray[np.float64] | None = None
    qdd: NDArray[np.float64] | None = None
    gripper_width: NDArray[np.float64] | None = None
    gripper_force: NDArray[np.float64] | None = None
    trajectory: Trajectory | None = None
    notes: tuple[str, ...] = ()

    @property
    def duration(self) -> float:
        """Time from the first to the last row in [s]."""
        return float(self.times[-1] - self.times[0])

    @property
    def gripper(self) -> tuple[GripperEvent, ...]:
        """Gripper events of one of our own files; other files have samples of the width instead."""
        return self.trajectory.gripper if self.trajectory else ()

    @property
    def segments(self) -> tuple[TrajectorySegment, ...]:
        """Segments of one of our own files."""
        return self.trajectory.segments if self.trajectory else ()

    def row(self, k: int) -> str:
        """Row k of the arrays as a person finds it in the file, for instance "line 12"."""
        return f"{self.row_word} {int(self.row_numbers[k])}"


def checked(motion: MotionFile, seconds: bool = False) -> MotionFile:
    """The same motion, its arrays read-only, after every check that does not depend on the format.

    Args:
        motion: As it was read. Of a file that is too long it is enough to hold the rows up to the first beyond
            MAX_DURATION, or one more than MAX_ROWS.
        seconds: Whether times are in seconds for certain.

    Raises:
        MotionFileError: What was found, naming file, row and joint.
    """
    _refuse_few_or_many_rows(motion)
    _refuse_unfinished_numbers(motion)
    _refuse_absurd_numbers(motion)
    _refuse_times_that_do_not_increase(motion)
    if not seconds:
        _refuse_other_time_units(motion)
    if motion.duration > MAX_DURATION:
        late = int(np.argmax(motion.times - motion.times[0] > MAX_DURATION))
        raise MotionFileError(
            f"'{motion.path}' is too long: {motion.row(late)} is {motion.times[late] - motion.times[0]:.6g} s after "
            f"the first row, at most {MAX_DURATION:g} s are read; cut it into shorter motions (times are in seconds)"
        )
    if motion.qdd is not None and motion.qd is None:
        raise MotionFileError(f"'{motion.path}' has accelerations but no velocities; give both, or no accelerations")
    _refuse_degrees(motion)
    _refuse_impossible_widths(motion)
    for array in (motion.times, motion.q, motion.qd, motion.qdd, motion.gripper_width, motion.gripper_force):
        if array is not None:
            array.flags.writeable = False
    return motion


def _refuse_few_or_many_rows(motion: MotionFile) -> None:
    n = len(motion.times)
    if n > MAX_ROWS:
        raise MotionFileError(
            f"'{motion.path}' has more than {MAX_ROWS} rows; a motion has at most that many: a robot plays 1000 a "
            "second; leave some out or cut the file"
        )
    if n < 2:
        raise MotionFileError(
            f"'{motion.path}' has {'one row' if n else 'no rows'} of numbers; a motion has at least 2"
        )


def _refuse_unfinished_numbers(motion: MotionFile) -> None:
    bad = np.flatnonzero(~np.isfinite(motion.times))
    if len(bad):
        raise MotionFileError(f"'{motion.path}', {motion.row(bad[0])}: the time is {motion.times[bad[0]]}")
    for what, array in _arrays(motion):
        bad = np.argwhere(~np.isfinite(array))
        if len(bad):
            k, joint = bad[0]
            raise MotionFileError(
                f"'{motion.path}', {motion.row(k)}: the {what} of {motion.joint_names[joint]} is {array[k, joint]}"
            )
    for what, array in (("gripper width", motion.gripper_width), ("gripper force", motion.gripper_force)):
        if array is not None and not np.all(np.isfinite(array)):
            k = int(np.argmax(~np.isfinite(array)))
            raise MotionFileError(f"'{motion.path}', {motion.row(k)}: the {what} is {array[k]}")


def _refuse_times_that_do_not_increase(motion: MotionFile) -> None:
    steps = np.diff(motion.times)
    if np.all(steps > 0):
        return
    k = int(np.argmax(~(steps > 0)))
    what = "the same time as" if steps[k] == 0 else "earlier than"
    raise MotionFileError(
        f"'{motion.path}', {motion.row(k + 1)}: time {motion.times[k + 1]:.9g} is {what} that of the row before it "
        f"({motion.times[k]:.9g}); times must increase"
    )


def _refuse_other_time_units(motion: MotionFile) -> None:
    """Times that are coarse, and make a motion absurdly slow, which in another unit would be neither."""
    steps = np.diff(motion.times)
    step, fastest = float(np.median(steps)), float(np.max(np.abs(np.diff(motion.q, axis=0)) / steps[:, None]))
    if step < COARSE_STEP or fastest < 1e-12:  # a file at rest says nothing about its unit
        return
    for unit, factor in TIME_UNITS:
        if step / factor >= COARSE_STEP * 1e-3 and fastest * factor < FASTEST:
            raise MotionFileError(
                f"'{motion.path}': times look like {unit} (rows are {step:.6g} apart): divide them by {factor:.0e}; if "
                f"it is as slow as that in seconds, give rows less than {COARSE_STEP} s apart"
            )


def _refuse_degrees(motion: MotionFile) -> None:
    """Two joints or more that are far beyond any joint's reach most of the time: no valid motion has even one.

    Joint 4 is bent by 4 to 176 degrees, and no usual posture has all other joints within 7 degrees. Velocities are
    held against the slope of the positions, where they would be off by 57.3.
    """
    far = np.sum(np.abs(motion.q) > BEYOND_ANY_JOINT, axis=1)
    if np.median(far) >= 2 and np.max(np.abs(motion.q)) < np.rad2deg(BEYOND_ANY_JOINT):
        k = int(np.argmax(far >= 2))
        joint = int(np.argmax(np.abs(motion.q[k])))
        raise MotionFileError(
            f"'{motion.path}', {motion.row(k)}: {motion.joint_names[joint]} is at {motion.q[k, joint]:.6g}: positions "
            "look like degrees: multiply by pi/180"
        )
    for what, array, slope_of in (("velocities", motion.qd, motion.q), ("accelerations", motion.qdd, motion.qd)):
        if array is None or slope_of is None:
            continue
        slope = np.gradient(slope_of, motion.times, axis=0)
        with np.errstate(over="ignore", invalid="ignore"):
            ratio = np.sum(array * slope) / max(float(np.sum(slope * slope)), 1e-12)
        if DEGREE_SPEEDS[0] < ratio < DEGREE_SPEEDS[1]:
            raise MotionFileError(
                f"'{motion.path}': {what} are {ratio:.1f} times what the rows before them say: they look like degrees: "
                "multiply by pi/180"
            )


def _refuse_absurd_numbers(motion: MotionFile) -> None:
    for what, array in _arrays(motion):
        largest, unit = LARGEST[what]
        if np.max(np.abs(array)) > largest:
            k, joint = np.unravel_index(int(np.argmax(np.abs(array) > largest)), array.shape)
            raise MotionFileError(
                f"'{motion.path}', {motion.row(int(k))}: the {what} of {motion.joint_names[joint]} is "
                f"{array[k, joint]:.6g} {unit}; beyond {largest:g} {unit} nothing is read"
            )


def _refuse_impossible_widths(motion: MotionFile) -> None:
    width, force = motion.gripper_width, motion.gripper_force
    if width is not None and np.max(width) > WIDEST:
        k = int(np.argmax(width > WIDEST))
        advice = "it looks like millimetres: divide by 1000" if np.max(width) < WIDEST * 1e3 else "it must be in metres"
        raise MotionFileError(f"'{motion.path}', {motion.row(k)}: the gripper width is {width[k]:.6g} m; {advice}")
    for what, array, unit in (("width", width, "m"), ("force", force, "N")):
        if array is not None and np.min(array) < -1e-3:
            k = int(np.argmax(array < -1e-3))
            raise MotionFileError(
                f"'{motion.path}', {motion.row(k)}: the gripper {what} is {array[k]:.6g} {unit}; it cannot be negative"
            )
    if force is not None and width is None:
        raise MotionFileError(f"'{motion.path}' has a gripper_force but no gripper width; give both, or neither")
    if force is not None and np.max(force) > 1e3:
        k = int(np.argmax(force > 1e3))
        raise MotionFileError(f"'{motion.path}', {motion.row(k)}: the gripper force is {force[k]:.6g} N; at most 1000")


def _arrays(motion: MotionFile) -> list[tuple[str, np.ndarray]]:
    """Position, velocity and acceleration as far as the file has them."""
    named = (("position", motion.q), ("velocity", motion.qd), ("acceleration", motion.qdd))
    return [(what, array) for what, array in named if array is not None]
