"""Messages of a robot in ROS 2's encoding (CDR); those of pictures and transforms are in `perception.ros2.messages`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from perception.ros2.messages import encoded, header, moment, numbers, part

JOINT_STATE = "sensor_msgs/msg/JointState"
JOINT_TRAJECTORY, POINT = "trajectory_msgs/msg/JointTrajectory", "trajectory_msgs/msg/JointTrajectoryPoint"
DURATION = "builtin_interfaces/msg/Duration"
DIAGNOSTICS, STATUS = "diagnostic_msgs/msg/DiagnosticArray", "diagnostic_msgs/msg/DiagnosticStatus"
KEY_VALUE = "diagnostic_msgs/msg/KeyValue"
LOG = "rcl_interfaces/msg/Log"

OK, WARN, ERROR, STALE = 0, 1, 2, 3  # diagnostic_msgs/msg/DiagnosticStatus
LOG_LEVELS: dict[str, int] = {"info": 20, "warn": 30, "error": 40}  # rcl_interfaces/msg/Log
LogLevel = Literal["info", "warn", "error"]


@dataclass(frozen=True)
class Ros2Message:
    """One encoded message.

    Attributes:
        topic: Its topic without the leading slash, for instance "joint_states".
        kind: Its type, for instance "sensor_msgs/msg/JointState".
        stamp_ns: When what it says was so, in [ns] since 1970.
        data: CDR, little-endian, with its header of four bytes; it cannot be changed.
        latched: Whether someone who comes later still needs it (durability transient local).
    """

    topic: str
    kind: str
    stamp_ns: int
    data: memoryview
    latched: bool = False


def joint_state(
    stamp_ns: int,
    frame: str,
    names: Sequence[str],
    position: np.ndarray,
    velocity: np.ndarray,
    effort: np.ndarray,
) -> memoryview:
    """A sensor_msgs/msg/JointState; arrays of shape (n,) in [rad] or [m], [rad/s] or [m/s], [Nm] or [N]."""
    values = numbers(position), numbers(velocity), numbers(effort)
    return encoded(JOINT_STATE, header(stamp_ns, frame), list(names), *values)


def joint_trajectory(
    stamp_ns: int,
    frame: str,
    names: Sequence[str],
    times_ns: np.ndarray,
    q: np.ndarray,
    qd: np.ndarray,
    qdd: np.ndarray,
) -> memoryview:
    """A trajectory_msgs/msg/JointTrajectory.

    Args:
        stamp_ns: When it begins in [ns].
        frame: Frame of the robot's base.
        names: Its joints, k of them.
        times_ns: Times of the points since the beginning in whole [ns], shape (n,).
        q, qd, qdd: Points in [rad], [rad/s], [rad/s^2], shape (n, k).
    """
    nothing = np.empty(0)
    points = [
        part(POINT, *rows, nothing, part(DURATION, *divmod(int(at), 10**9)))
        for at, *rows in zip(times_ns, numbers(q), numbers(qd), numbers(qdd), strict=True)
    ]
    return encoded(JOINT_TRAJECTORY, header(stamp_ns, frame), list(names), points)


def diagnostics(
    stamp_ns: int, level: int, name: str, message: str, hardware: str, values: Mapping[str, str]
) -> memoryview:
    """A diagnostic_msgs/msg/DiagnosticArray of one status: OK, WARN, ERROR or STALE, and numbers as texts."""
    pairs = [part(KEY_VALUE, key, value) for key, value in values.items()]
    return encoded(DIAGNOSTICS, header(stamp_ns, ""), [part(STATUS, level, name, message, hardware, pairs)])


def log(stamp_ns: int, level: LogLevel, name: str, message: str) -> memoryview:
    """An rcl_interfaces/msg/Log without a place in a program."""
    return encoded(LOG, moment(stamp_ns), LOG_LEVELS[level], name, message, "", "", 0)
