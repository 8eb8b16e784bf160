"""Motions for tests of motion files, with derivatives that are exact, and writers for other people's formats."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.motion.arm_paths import pick_and_place
from control.errors import MotionFileError
from control.motion_files.contents import MotionFile
from control.motion_files.reading import read_motion
from control.retiming.retime import retime
from control.robot.dynamics import RobotModel
from control.robot.limits import JOINT_NAMES, REST_Q, panda_limits
from control.safety.limits import SafetyLimits
from control.trajectory.samples import Trajectory
from tests.support.robot_side.ros2_messages import joint_trajectory

STEP = np.array([0.5, 0.3, -0.4, 0.35, -0.3, 0.4, 0.6])  # [rad]


@dataclass(frozen=True)
class Motion:
    """Rows of a motion: times in [s], q, qd, qdd in SI units, and the gripper's width in [m]."""

    times: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    width: np.ndarray


def there_and_back(times: np.ndarray) -> Motion:
    """Two seconds there, one second's rest in which the gripper closes at 2.2 to 2.6 s, two seconds back.

    There is 10 s^3 - 15 s^4 + 6 s^5 of STEP, with s the share of the time: at rest at both ends, acceleration too.
    """
    s = np.clip(np.where(times < 2.5, times / 2.0, (5.0 - times) / 2.0), 0.0, 1.0)
    way = np.where(times < 2.5, 1.0, -1.0)
    share = 10 * s**3 - 15 * s**4 + 6 * s**5
    slope = way * (30 * s**2 - 60 * s**3 + 30 * s**4) / 2.0
    turn = (60 * s - 180 * s**2 + 120 * s**3) / 4.0
    width = np.clip(0.08 - 0.1 * (times - 2.2), 0.04, 0.08)
    return Motion(times, np.array(REST_Q) + share[:, None] * STEP, slope[:, None] * STEP, turn[:, None] * STEP, width)


def rows(step: float) -> np.ndarray:
    """Times of rows a step apart in [s] over all five seconds."""
    return np.arange(round(5.0 / step) + 1) * step


def write_csv(path: Path, columns: Sequence[tuple[str, np.ndarray]], digits: int = 12) -> Path:
    """Write columns by name."""
    lines = [",".join(name for name, _ in columns)]
    lines += [",".join(f"{value:.{digits}f}" for value in row) for row in np.array([c for _, c in columns]).T]
    path.write_text("\n".join(lines) + "\n")
    return path


def columns(motion: Motion, derivatives: int = 0, width: bool = False) -> list[tuple[str, np.ndarray]]:
    """The usual columns: t, joints, their velocities and accelerations as asked for, gripper_width."""
    out = [("t", motion.times), *zip(JOINT_NAMES, motion.q.T, strict=True)]
    for ending, array in (("_velocity", motion.qd), ("_acceleration", motion.qdd))[:derivatives]:
        out += [(name + ending, column) for name, column in zip(JOINT_NAMES, array.T, strict=True)]
    return [*out, ("gripper_width", motion.width)] if width else out


def as_motion(
    rows_of: Motion, derivatives: int = 0, width: bool = False, force: np.ndarray | None = None
) -> MotionFile:
    """Rows as a CSV file holds them, with none, one or two of the derivatives."""
    return MotionFile(
        Path("m.csv"), "CSV", rows_of.times, rows_of.q, JOINT_NAMES, "line", np.arange(len(rows_of.times)) + 2,
        qd=rows_of.qd if derivatives > 0 else None,
        qdd=rows_of.qdd if derivatives > 1 else None,
        gripper_width=rows_of.width if width else None,
        gripper_force=force,
    )  # fmt: skip


def retimed_pick_and_place() -> Trajectory:
    """A trajectory of ours: seven segments, a grasp and a release."""
    return retime(pick_and_place(RobotModel.panda()), RobotModel.panda(), panda_limits(), SafetyLimits())


def refused(path: Path, **choice: Any) -> str:
    """The message of a refusal: one line that names the file."""
    with pytest.raises(MotionFileError) as caught:
        read_motion(path, **choice)
    message = str(caught.value)
    assert "\n" not in message and str(path) in message and len(message) < 900
    return message


def write_npz(path: Path, **arrays: Any) -> Path:
    """Write arrays by name."""
    np.savez(path, **arrays)
    return path


def plain_arrays(motion: Motion) -> dict[str, np.ndarray]:
    """The least that an NPZ file needs."""
    return {"t": motion.times, "q": motion.q, "joint_names": np.array(JOINT_NAMES)}


def planned(motion: Motion, names: Sequence[str] = JOINT_NAMES, derivatives: int = 2) -> dict[str, Any]:
    """A JointTrajectory message."""
    return joint_trajectory(names, motion.times, motion.q, *(motion.qd, motion.qdd)[:derivatives])


def at_rest(n: int) -> Trajectory:
    """Samples of an arm that rests at zero."""
    return Trajectory(np.zeros((n, 7)), np.zeros((n, 7)), np.zeros((n, 7)))
