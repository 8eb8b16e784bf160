"""Where every link of the robot is in the frame of the link before it, from the robot's description by Pinocchio."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from control.errors import ConfigError
from control.robot.description import arm_model
from control.robot.description_files import panda_urdf
from control.robot.gripper import GripperModel
from control.robot.limits import JOINT_NAMES

BASE = "panda_link0"
FINGER_JOINTS = ("panda_finger_joint1", "panda_finger_joint2")


@dataclass(frozen=True)
class LinkPose:
    """A link in the frame of the one before it.

    Attributes:
        parent, child: Names of the links.
        position: In [m], shape (3,).
        quaternion: (x, y, z, w), shape (4,).
    """

    parent: str
    child: str
    position: NDArray[np.float64]
    quaternion: NDArray[np.float64]

    @classmethod
    def of(cls, parent: str, child: str, pose: np.ndarray) -> "LinkPose":
        """From a transform parent_T_child, shape (4, 4)."""
        return cls(parent, child, pose[:3, 3], Rotation.from_matrix(pose[:3, :3]).as_quat())


class LinkTree:
    """The links of the arm and its gripper.

    A gripper whose fingers the description does not have (any but the Panda's hand) ends with its hand and tool
    centre point. Not safe to share between threads: Pinocchio keeps intermediate results in one buffer.

    Args:
        gripper: What hangs at the flange.

    Attributes:
        finger_joints: Names of the finger joints, each at half of the gripper's width; none where fingers are not
            described.

    Raises:
        ConfigError: The robot's description is not installed.
    """

    def __init__(self, gripper: GripperModel) -> None:
        import pinocchio  # pyright: ignore[reportMissingImports] -- its path is added by a .pth file

        self._pin = pinocchio
        self.finger_joints = FINGER_JOINTS if gripper.mounting is None else ()
        if gripper.mounting is None:
            self._model = pinocchio.buildModelFromUrdf(str(panda_urdf()))
        else:
            self._model = arm_model(gripper, gripper.opening)
        expected = (*JOINT_NAMES, *self.finger_joints)
        if tuple(self._model.names)[1:] != expected:
            raise ConfigError(f"the robot's description has joints {tuple(self._model.names)[1:]}, not {expected}")
        self._data = self._model.createData()
        frames = self._model.frames
        solid = (pinocchio.FrameType.BODY, pinocchio.FrameType.OP_FRAME)
        self._moving: list[tuple[int, int]] = []
        self._fixed: list[tuple[int, int]] = []
        for child, frame in enumerate(frames):
            parent = frame.parentFrame
            while parent and frames[parent].type not in solid:
                parent = frames[parent].parentFrame
            if frame.type in solid and frame.name != BASE:
                still = frame.parentJoint == frames[parent].parentJoint
                (self._fixed if still else self._moving).append((parent, child))

    def moving(self, q: np.ndarray, width: float) -> list[LinkPose]:
        """Links that joints move.

        Args:
            q: Joint positions in [rad], shape (7,).
            width: Distance between the pads in [m].
        """
        return self._poses(self._moving, q, width)

    def fixed(self) -> list[LinkPose]:
        """Links that are fixed to the one before them."""
        return self._poses(self._fixed, np.zeros(len(JOINT_NAMES)), 0.0)

    def _poses(self, pairs: list[tuple[int, int]], q: np.ndarray, width: float) -> list[LinkPose]:
        whole = np.concatenate([q, np.full(len(self.finger_joints), width / 2)])
        self._pin.framesForwardKinematics(self._model, self._data, whole)
        frames, placed = self._model.frames, self._data.oMf
        return [LinkPose.of(frames[p].name, frames[c].name, placed[p].actInv(placed[c]).homogeneous) for p, c in pairs]
