"""The Panda's rigid bodies as its control box knows them: the arm without its hand, the hand, an announced load."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from control.robot.description import FLANGE_FRAME, TCP_FRAME, arm_model, without_hand
from control.robot.description_files import panda_urdf
from control.robot.gripper import PANDA_HAND, GripperModel


@dataclass(frozen=True)
class RigidLoad:
    """Something fastened to the flange.

    Attributes:
        mass: In [kg].
        com: Its centre of mass in the flange frame in [m], shape (3,).
        inertia: About the centre of mass in the axes of the flange in [kg m^2], shape (3, 3).
    """

    mass: float
    com: NDArray[np.float64]
    inertia: NDArray[np.float64]


class Arm:
    """Kinematics of the arm and torques of what hangs at its flange; everything in the robot's base frame.

    Args:
        gripper: What hangs at the flange.
        gravity: Acceleration of free fall in the base frame in [m/s^2], shape (3,).

    Attributes:
        model: Pinocchio model of the seven joints without anything at the flange.
        hand: The gripper with open fingers as one body.
        flange_T_hand_tcp: Where its tool centre point is in the flange frame, shape (4, 4).

    Raises:
        ConfigError: The robot's description is not installed.
    """

    def __init__(self, gripper: GripperModel = PANDA_HAND, gravity: np.ndarray | None = None) -> None:
        import pinocchio  # pyright: ignore[reportMissingImports] -- its path is added by a .pth file

        self._pin = pinocchio
        self.model: Any = pinocchio.buildModelFromXML(without_hand(panda_urdf()))
        self._data = self.model.createData()
        self._flange = self.model.getFrameId(FLANGE_FRAME)
        whole = arm_model(gripper, gripper.opening)
        flange = self.model.frames[self._flange].placement
        tool = whole.frames[whole.getFrameId(TCP_FRAME)].placement
        self.flange_T_hand_tcp: np.ndarray = (flange.inverse() * tool).homogeneous
        self.hand = _difference(whole.inertias[7], self.model.inertias[7], flange)
        # The same chain without mass: its inverse dynamics are those of the load alone.
        self._carrier = self.model.copy()
        for k in range(len(self._carrier.inertias)):
            self._carrier.inertias[k] = pinocchio.Inertia.Zero()
        if gravity is not None:
            self._carrier.gravity.linear = np.asarray(gravity, float)
        self._carrier_data = self._carrier.createData()
        self._loaded = False

    def carry(self, load: RigidLoad) -> None:
        """Take note of what is fastened to the flange beside the hand."""
        inertia = self._pin.Inertia(load.mass, load.com, load.inertia)
        self._carrier.inertias[7] = self.model.frames[self._flange].placement.act(inertia)
        self._loaded = load.mass > 0.0

    def load_torque(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        """Joint torques in [Nm] that carrying the load takes; in [rad], [rad/s], [rad/s^2], all of shape (7,)."""
        if not self._loaded:
            return np.zeros(7)
        return np.array(self._pin.rnea(self._carrier, self._carrier_data, q, dq, ddq))

    def flange_pose(self, q: np.ndarray) -> np.ndarray:
        """base_T_flange, shape (4, 4), at joint positions in [rad], shape (7,)."""
        self._pin.forwardKinematics(self.model, self._data, q)
        return self._pin.updateFramePlacement(self.model, self._data, self._flange).homogeneous.copy()

    def jacobian(self, q: np.ndarray, offset: np.ndarray) -> np.ndarray:
        """Jacobian of a point that moves with the flange, shape (6, 7): linear over angular, in the axes of the base.

        Args:
            q: Joint positions in [rad], shape (7,).
            offset: From the flange to the point, in the axes of the base in [m], shape (3,).
        """
        aligned = self._pin.LOCAL_WORLD_ALIGNED
        jacobian = np.array(self._pin.computeFrameJacobian(self.model, self._data, q, self._flange, aligned))
        # Velocity of the point: v + w x offset.
        x, y, z = offset
        wx, wy, wz = jacobian[3], jacobian[4], jacobian[5]
        jacobian[0] += wy * z - wz * y
        jacobian[1] += wz * x - wx * z
        jacobian[2] += wx * y - wy * x
        return jacobian


def _difference(whole: Any, part: Any, flange: Any) -> RigidLoad:
    """What `whole` has more than `part`, both inertias in the frame of the last joint, seen from the flange."""
    mass = whole.mass - part.mass
    com = (whole.mass * whole.lever - part.mass * part.lever) / mass
    about_origin = _about_origin(whole.mass, whole.lever, whole.inertia)
    about_origin = about_origin - _about_origin(part.mass, part.lever, part.inertia)
    inertia = about_origin - _about_origin(mass, com, np.zeros((3, 3)))
    turn = flange.rotation
    return RigidLoad(float(mass), turn.T @ (com - flange.translation), turn.T @ inertia @ turn)


def _about_origin(mass: float, com: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """Steiner: I + m (|c|^2 1 - c c^T)."""
    return inertia + mass * (float(com @ com) * np.eye(3) - np.outer(com, com))
