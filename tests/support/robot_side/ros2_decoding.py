"""Two decoders of ROS 2's messages that share nothing with the encoder: mcap-ros2-support's and pycdr2's."""

from dataclasses import dataclass
from typing import Any

from mcap_ros2._dynamic import generate_dynamic
from pycdr2 import IdlStruct
from pycdr2.types import float64, int32, sequence, uint8, uint32

from tests.support.robot_side.ros2_messages import definition


def decode_ros2(kind: str, data: bytes) -> Any:
    """The message by the definitions of `tests.support.robot_side.ros2_messages`."""
    return generate_dynamic(kind, definition(kind))[kind](data)


@dataclass
class Time(IdlStruct, typename="builtin_interfaces/msg/Time"):
    sec: int32
    nanosec: uint32


@dataclass
class Duration(IdlStruct, typename="builtin_interfaces/msg/Duration"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs/msg/Header"):
    stamp: Time
    frame_id: str


@dataclass
class JointState(IdlStruct, typename="sensor_msgs/msg/JointState"):
    header: Header
    name: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64]
    effort: sequence[float64]


@dataclass
class JointTrajectoryPoint(IdlStruct, typename="trajectory_msgs/msg/JointTrajectoryPoint"):
    positions: sequence[float64]
    velocities: sequence[float64]
    accelerations: sequence[float64]
    effort: sequence[float64]
    time_from_start: Duration


@dataclass
class JointTrajectory(IdlStruct, typename="trajectory_msgs/msg/JointTrajectory"):
    header: Header
    joint_names: sequence[str]
    points: sequence[JointTrajectoryPoint]


@dataclass
class KeyValue(IdlStruct, typename="diagnostic_msgs/msg/KeyValue"):
    key: str
    value: str


@dataclass
class DiagnosticStatus(IdlStruct, typename="diagnostic_msgs/msg/DiagnosticStatus"):
    level: uint8
    name: str
    message: str
    hardware_id: str
    values: sequence[KeyValue]


@dataclass
class DiagnosticArray(IdlStruct, typename="diagnostic_msgs/msg/DiagnosticArray"):
    header: Header
    status: sequence[DiagnosticStatus]


@dataclass
class Log(IdlStruct, typename="rcl_interfaces/msg/Log"):
    stamp: Time
    level: uint8
    name: str
    msg: str
    file: str
    function: str
    line: uint32


def decode_again(kind: str, data: bytes) -> Any:
    """The message by the types above."""
    types: dict[str, Any] = {
        "sensor_msgs/msg/JointState": JointState,
        "trajectory_msgs/msg/JointTrajectory": JointTrajectory,
        "diagnostic_msgs/msg/DiagnosticArray": DiagnosticArray,
        "rcl_interfaces/msg/Log": Log,
    }
    return types[kind].deserialize(data)
