"""What a cell says, as messages of ROS 2.

joint_states                            JointState      panda_joint1..7, panda_finger_joint1..2
tf, tf_static                           TFMessage       world -> panda_link0 -> ..., cameras' optical frames
robot_mode                              String          idle, moving, stopping, stopped, reflex
diagnostics                             DiagnosticArray mode, why it stopped, speed, tracking error
executing_trajectory                    JointTrajectory each motion that the robot has accepted
<camera>/color/image_raw                Image rgb8      with .../camera_info
<camera>/aligned_depth_to_color/...     Image 32FC1     in [m], NaN where unknown; with .../camera_info
rosout                                  Log             what happened
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from control.robot.gripper import GripperModel
from control.robot.limits import JOINT_NAMES
from control.trajectory.samples import SAMPLE_TIME, Trajectory
from hw_interface.messages.robot import RobotState
from hw_interface.ros2 import encoding
from hw_interface.ros2.encoding import LogLevel, Ros2Message
from hw_interface.ros2.link_tree import BASE, LinkPose, LinkTree
from perception.frames import RgbdFrame
from perception.ros2.messages import (
    CAMERA_INFO,
    IMAGE,
    STRING,
    TF,
    camera_info,
    image,
    message_types,
    string,
    transforms,
)
from perception.ros2.topic_names import topic_name

WORLD = "world"
POINT_EVERY = 10  # samples of 1 ms between two points of a trajectory; velocities and accelerations fill the gaps
DIAGNOSTICS_PERIOD = 1.0  # [s]; as diagnostic_updater's default
DIAGNOSTIC_LEVELS = {
    "idle": encoding.OK,
    "moving": encoding.OK,
    "stopping": encoding.WARN,
    "stopped": encoding.WARN,
    "reflex": encoding.ERROR,
}


@dataclass(frozen=True)
class MountedCamera:
    """A camera that the cell file places.

    Attributes:
        name: Its name.
        parent: Frame that it is fixed to: `WORLD` or "panda_hand".
        parent_T_camera: Pose of its optical frame there, shape (4, 4).
    """

    name: str
    parent: str
    parent_T_camera: NDArray[np.float64]


def optical_frame(camera: str) -> str:
    """Name of a camera's optical frame (x right, y down, z forward)."""
    return f"{topic_name(camera)}_color_optical_frame"


class Ros2View:
    """Turns what comes over the wire into messages of ROS 2; not thread-safe.

    Args:
        gripper: What hangs at the flange.
        world_T_base: Pose of the robot's base, shape (4, 4).
        cameras: Cameras that the cell file places; others are placed by each of their pictures.

    Raises:
        ConfigError: The robot's description is not installed.
        MissingPackageError: The library that encodes is not installed.
    """

    def __init__(
        self, gripper: GripperModel, world_T_base: np.ndarray, cameras: tuple[MountedCamera, ...] = ()
    ) -> None:
        message_types()  # now, so that the first message does not wait for it
        self._tree = LinkTree(gripper)
        self._names = (*JOINT_NAMES, *self._tree.finger_joints)
        self._world_T_base = world_T_base
        self._cameras = cameras
        self._before: tuple[float, float] | None = None  # stamp and width of the state before
        self._mode = ""
        self._next_diagnostics = 0.0

    def fixed(self, stamp: float) -> Ros2Message:
        """All transforms that never change.

        Args:
            stamp: Time in [s].
        """
        poses = [LinkPose.of(WORLD, BASE, self._world_T_base), *self._tree.fixed()]
        poses += [LinkPose.of(c.parent, optical_frame(c.name), c.parent_T_camera) for c in self._cameras]
        return _tf("tf_static", _ns(stamp), poses, latched=True)

    def state(self, state: RobotState) -> list[Ros2Message]:
        """Messages of a state: joints and transforms always, the mode when it changes, diagnostics every second.

        The speed of the fingers is the difference from the state before; their force is not measured and NaN.
        """
        stamp = _ns(state.stamp)
        fingers = len(self._tree.finger_joints)
        q = np.concatenate([state.q, np.full(fingers, state.gripper_width / 2)])
        qd = np.concatenate([state.qd, np.full(fingers, self._finger_speed(state))])
        effort = np.concatenate([state.tau, np.full(fingers, np.nan)])
        joints = encoding.joint_state(stamp, BASE, self._names, q, qd, effort)
        messages = [
            Ros2Message("joint_states", encoding.JOINT_STATE, stamp, joints),
            _tf("tf", stamp, self._tree.moving(np.array(state.q), state.gripper_width)),
        ]
        # The mode is published again with the diagnostics, so that whoever comes later learns it as well.
        if state.mode != self._mode or state.stamp >= self._next_diagnostics:
            self._mode, self._next_diagnostics = state.mode, state.stamp + DIAGNOSTICS_PERIOD
            messages.append(Ros2Message("robot_mode", STRING, stamp, string(state.mode)))
            messages.append(self._diagnostics(state))
        return messages

    def silence(self, stamp: float, seconds: float) -> Ros2Message:
        """Diagnostics that say that the robot process has not been heard of for some seconds."""
        text = f"nothing was heard of the robot process for {seconds:.1f} s"
        data = encoding.diagnostics(_ns(stamp), encoding.STALE, "replan: robot", text, "panda", {})
        return Ros2Message("diagnostics", encoding.DIAGNOSTICS, _ns(stamp), data)

    def trajectory(self, trajectory: Trajectory, stamp: float) -> Ros2Message:
        """A motion that the robot plays, at its certified speed, a point every 10 ms.

        Args:
            trajectory: The motion.
            stamp: When the robot took it in [s].
        """
        rows = np.unique(np.append(np.arange(0, len(trajectory.q), POINT_EVERY), len(trajectory.q) - 1))
        times = rows * round(SAMPLE_TIME * 1e9)
        q, qd, qdd = trajectory.q[rows], trajectory.qd[rows], trajectory.qdd[rows]
        data = encoding.joint_trajectory(_ns(stamp), BASE, JOINT_NAMES, times, q, qd, qdd)
        return Ros2Message("executing_trajectory", encoding.JOINT_TRAJECTORY, _ns(stamp), data)

    def frame(self, frame: RgbdFrame) -> list[Ros2Message]:
        """A frame's pictures with their lens, and its pose where the cell file does not say it."""
        camera, optical, stamp = topic_name(frame.camera), optical_frame(frame.camera), _ns(frame.stamp)
        k = frame.intrinsics
        info = camera_info(stamp, optical, k.width, k.height, k.matrix)
        messages = []
        for part, kind, pixels in (
            ("color", "rgb8", frame.colour),
            ("aligned_depth_to_color", "32FC1", frame.depth),
        ):
            topic = f"{camera}/{part}"
            messages.append(Ros2Message(f"{topic}/camera_info", CAMERA_INFO, stamp, info))
            picture = image(stamp, optical, kind, pixels)
            messages.append(Ros2Message(f"{topic}/image_raw", IMAGE, stamp, picture))
        if all(frame.camera != c.name for c in self._cameras):
            messages.append(_tf("tf", stamp, [LinkPose.of(WORLD, optical, frame.world_T_camera)]))
        return messages

    def event(self, stamp: float, level: LogLevel, name: str, message: str) -> Ros2Message:
        """Something that happened, for people.

        Args:
            stamp: When, in [s].
            level: How bad it is.
            name: Who says so.
            message: What.
        """
        data = encoding.log(_ns(stamp), level, name, message)
        return Ros2Message("rosout", encoding.LOG, _ns(stamp), data)

    def _finger_speed(self, state: RobotState) -> float:
        before, self._before = self._before, (state.stamp, state.gripper_width)
        if before is None or state.stamp <= before[0]:
            return 0.0
        return (state.gripper_width - before[1]) / 2 / (state.stamp - before[0])

    def _diagnostics(self, state: RobotState) -> Ros2Message:
        message = state.mode if state.last_error is None else f"{state.mode}: {state.last_error.reason}"
        values: Mapping[str, str] = {
            "mode": state.mode,
            "cell": state.cell,
            "profile": state.profile,
            "firmware": state.firmware,
            "error": state.last_error.code if state.last_error else "",
            "motion": state.motion_serial or "",
            "progress": f"{state.progress}/{state.samples}",
            "speed": f"{state.speed:.3f}",
            "tracking_error": f"{state.tracking_error:.5f}",
            "gripper_width": f"{state.gripper_width:.4f}",
            "grasped": str(state.grasped).lower(),
        }
        level = DIAGNOSTIC_LEVELS[state.mode]
        stamp = _ns(state.stamp)
        data = encoding.diagnostics(stamp, level, "replan: robot", message, "panda", values)
        return Ros2Message("diagnostics", encoding.DIAGNOSTICS, stamp, data)


def _ns(stamp: float) -> int:
    seconds = math.floor(stamp)  # apart, since nanoseconds since 1970 are more than a float holds
    return seconds * 10**9 + round((stamp - seconds) * 1e9)


def _tf(topic: str, stamp: int, poses: list[LinkPose], latched: bool = False) -> Ros2Message:
    data = transforms([(stamp, p.parent, p.child, p.position, p.quaternion) for p in poses])
    return Ros2Message(topic, TF, stamp, data, latched)
