"""Messages of a robot in ROS 2's encoding (CDR); those of pictures and transforms are in `perception.ros2.cdr`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from perception.ros2.cdr import Cdr

JOINT_STATE = "sensor_msgs/msg/JointState"
JOINT_TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
LOG = "rcl_interfaces/msg/Log"
STRING = "std_msgs/msg/String"
TF = "tf2_msgs/msg/TFMessage"
IMAGE = "sensor_msgs/msg/Image"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"

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
        data: CDR, little-endian, with its header of four bytes.
        latched: Whether someone who comes later still needs it (durability transient local).
    """

    topic: str
    kind: str
    stamp_ns: int
    data: bytes
    latched: bool = False


def joint_state(
    stamp_ns: int,
    frame: str,
    names: Sequence[str],
    position: np.ndarray,
    velocity: np.ndarray,
    effort: np.ndarray,
) -> bytes:
    """A sensor_msgs/msg/JointState; arrays of shape (n,) in [rad] or [m], [rad/s] or [m/s], [Nm] or [N]."""
    out = Cdr().header(stamp_ns, frame).texts(names)
    return out.numbers(position).numbers(velocity).numbers(effort).data


def joint_trajectory(
    stamp_ns: int,
    frame: str,
    names: Sequence[str],
    times_ns: np.ndarray,
    q: np.ndarray,
    qd: np.ndarray,
    qdd: np.ndarray,
) -> bytes:
    """A trajectory_msgs/msg/JointTrajectory.

    Args:
        stamp_ns: When it begins in [ns].
        frame: Frame of the robot's base.
        names: Its joints, k of them.
        times_ns: Times of the points since the beginning in whole [ns], shape (n,).
        q, qd, qdd: Points in [rad], [rad/s], [rad/s^2], shape (n, k).
    """
    out = Cdr().header(stamp_ns, frame).texts(names).put("I", len(q))
    nothing = np.empty(0)
    for i in range(len(q)):
        out.numbers(q[i]).numbers(qd[i]).numbers(qdd[i]).numbers(nothing)
        out.put("iI", *divmod(int(times_ns[i]), 10**9))
    return out.data


def diagnostics(stamp_ns: int, level: int, name: str, message: str, hardware: str, values: Mapping[str, str]) -> bytes:
    """A diagnostic_msgs/msg/DiagnosticArray of one status: OK, WARN, ERROR or STALE, and numbers as texts."""
    out = Cdr().header(stamp_ns, "").put("I", 1).put("B", level).text(name).text(message).text(hardware)
    out.put("I", len(values))
    for key, value in values.items():
        out.text(key).text(value)
    return out.data


def log(stamp_ns: int, level: LogLevel, name: str, message: str) -> bytes:
    """An rcl_interfaces/msg/Log without a place in a program."""
    out = Cdr().put("iI", *divmod(stamp_ns, 10**9)).put("B", LOG_LEVELS[level]).text(name).text(message)
    return out.text("").text("").put("I", 0).data
