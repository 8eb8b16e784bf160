"""Rigid-body model of the Panda with Pinocchio: where the hand is, and what torques a motion takes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from control.errors import ConfigError
from control.robot.description import TCP_FRAME, arm_model
from control.robot.gripper import PANDA_HAND, GripperModel
from control.robot.limits import JOINT_NAMES


@dataclass(frozen=True)
class Payload:
    """What the hand carries, taken as a point.

    Attributes:
        mass: In [kg].
        com: Its centre of mass in the tcp frame in [m], (x, y, z).
    """

    mass: float
    com: tuple[float, float, float] = (0.0, 0.0, 0.0)


class RobotModel:
    """The arm with its fingers locked; the base frame is link 0.

    Not safe to share between threads: Pinocchio keeps intermediate results in one buffer.

    Args:
        model: Pinocchio model with exactly the seven arm joints, in the order of JOINT_NAMES.
        tcp_frame: Name of the frame of the tool centre point.
        gripper: What hangs at the flange; the model contains it already.

    Raises:
        ConfigError: The model has other joints, or no such frame.
    """

    def __init__(self, model: Any, tcp_frame: str = TCP_FRAME, gripper: GripperModel = PANDA_HAND) -> None:
        import pinocchio  # pyright: ignore[reportMissingImports] -- its path is added by a .pth file

        joints = tuple(model.names)[1:]
        if joints != JOINT_NAMES:
            raise ConfigError(f"the robot model has joints {joints}; it needs exactly {JOINT_NAMES}")
        if not model.existFrame(tcp_frame):
            raise ConfigError(f"the robot model has no frame '{tcp_frame}'; it has {[f.name for f in model.frames]}")
        self.gripper = gripper
        self._pin = pinocchio
        self._model = model
        self._data = model.createData()
        self._tcp = model.getFrameId(tcp_frame)
        self._pool: Any = None  # of buffers for `torques`, made when it is needed

    @classmethod
    def panda(
        cls,
        payload_mass: float = 0.0,
        payload_com: Sequence[float] = (0.0, 0.0, 0.0),
        finger_width: float | None = None,
        gripper: GripperModel = PANDA_HAND,
    ) -> "RobotModel":
        """The Panda as example-robot-data describes it, with its hand or another gripper in its place.

        Args:
            payload_mass: Mass of a carried object in [kg], taken as a point.
            payload_com: Its centre of mass in the tcp frame in [m], shape (3,).
            finger_width: Distance between the pads in [m] at which the fingers are locked; open by default.
            gripper: What hangs at the flange.

        Raises:
            ConfigError: A mass or width out of range, or the description is not installed.
        """
        width = gripper.opening if finger_width is None else finger_width
        if not 0.0 <= width <= gripper.opening:
            raise ConfigError(f"finger_width is {width} m; the hand opens from 0 to {gripper.opening} m")
        model = arm_model(gripper, width)
        robot = cls(model, gripper=gripper)
        x, y, z = (float(v) for v in payload_com)
        return robot if payload_mass == 0.0 else robot.with_payload(Payload(payload_mass, (x, y, z)))

    def with_payload(self, payload: Payload) -> "RobotModel":
        """The same robot with something more in its hand.

        Raises:
            ConfigError: Its mass is negative or not finite.
        """
        if not (np.isfinite(payload.mass) and payload.mass >= 0.0 and np.all(np.isfinite(payload.com))):
            raise ConfigError(f"payload_mass is {payload.mass} kg at {payload.com}; it must be a number >= 0")
        model = self._model.copy()
        frame = model.frames[self._tcp]
        point = self._pin.Inertia(payload.mass, np.asarray(payload.com, float), np.zeros((3, 3)))
        model.inertias[frame.parentJoint] += frame.placement.act(point)
        return RobotModel(model, frame.name, self.gripper)

    @property
    def mass(self) -> float:
        """Mass of the whole robot in [kg], base, gripper and payload included."""
        return float(sum(inertia.mass for inertia in self._model.inertias))

    def tcp_pose(self, q: np.ndarray) -> np.ndarray:
        """Pose of the tool centre point, base_T_tcp, shape (4, 4), at joint positions in [rad], shape (7,)."""
        self._pin.forwardKinematics(self._model, self._data, np.asarray(q, float))
        return self._pin.updateFramePlacement(self._model, self._data, self._tcp).homogeneous.copy()

    def tcp_poses(self, q: np.ndarray) -> np.ndarray:
        """Poses base_T_tcp, shape (n, 4, 4), at joint positions in [rad], shape (n, 7)."""
        out = np.zeros((len(q), 4, 4))
        out[:, 3, 3] = 1.0
        model, data, forward = self._model, self._data, self._pin.forwardKinematics
        frame = model.frames[self._tcp]
        joint = data.oMi[frame.parentJoint]
        turned, moved = joint.rotation, joint.translation  # refer to the buffer
        for row, rotation, position in zip(
            np.ascontiguousarray(q, dtype=float), out[:, :3, :3], out[:, :3, 3], strict=True
        ):
            forward(model, data, row)
            rotation[...], position[...] = turned, moved
        return (out.reshape(-1, 4) @ frame.placement.homogeneous).reshape(out.shape)

    def tcp_jacobian(self, q: np.ndarray) -> np.ndarray:
        """Jacobian of the tool centre point, shape (6, 7): rows are linear [m/rad], then angular; axes of the base."""
        aligned = self._pin.LOCAL_WORLD_ALIGNED
        jacobian = self._pin.computeFrameJacobian(self._model, self._data, np.asarray(q, float), self._tcp, aligned)
        return np.array(jacobian)

    def tcp_motion(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How the tool centre point moves, in the axes of the base.

        Args:
            q, qd, qdd: In [rad], [rad/s], [rad/s^2], each of shape (n, 7).

        Returns:
            Velocities, linear [m/s] then angular [rad/s], and accelerations, linear [m/s^2] then angular [rad/s^2], of
            shape (n, 6) each.
        """
        pin, model, data, tcp = self._pin, self._model, self._data, self._tcp
        aligned = pin.LOCAL_WORLD_ALIGNED
        q, qd, qdd = (np.ascontiguousarray(x, dtype=float) for x in (q, qd, qdd))
        velocity, acceleration = np.empty((len(q), 6)), np.empty((len(q), 6))
        for k in range(len(q)):
            pin.forwardKinematics(model, data, q[k], qd[k], qdd[k])
            velocity[k] = pin.getFrameVelocity(model, data, tcp, aligned).vector
            acceleration[k] = pin.getFrameClassicalAcceleration(model, data, tcp, aligned).vector
        return velocity, acceleration

    def torque(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """Joint torques tau = M(q) qdd + C(q, qd) qd + g(q) by the recursive Newton-Euler algorithm, in [Nm].

        Args:
            q, qd, qdd: In [rad], [rad/s], [rad/s^2], each of shape (7,) or (n, 7).

        Returns:
            Torques of the same shape; friction is not modelled.
        """
        q, qd, qdd = (np.ascontiguousarray(x, dtype=float) for x in (q, qd, qdd))
        rnea, model, data = self._pin.rnea, self._model, self._data
        if q.ndim == 1:
            return np.array(rnea(model, data, q, qd, qdd))
        out = np.empty_like(q)
        for k in range(len(q)):
            out[k] = rnea(model, data, q[k], qd[k], qdd[k])
        return out

    def torques(self, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
        """As `torque` of many rows, bit for bit, in about two thirds of the time: one call for all of them.

        On the calling thread OpenMP uses one thread from then on: for processes that compute with nothing else that
        uses it, such as a robot's.

        Args:
            q, qd, qdd: In [rad], [rad/s], [rad/s^2], each of shape (n, 7).

        Returns:
            Torques in [Nm], shape (n, 7).
        """
        if self._pool is None:
            self._pool = self._pin.ModelPool(self._model, 1)
        # One column comes back as a vector.
        return self._pin.rneaInParallel(1, self._pool, q.T, qd.T, qdd.T).reshape(q.shape[::-1]).T

    def gravity(self, q: np.ndarray) -> np.ndarray:
        """Torques g(q) that hold the arm still in [Nm]; q in [rad], shape (7,) or (n, 7)."""
        zero = np.zeros_like(np.asarray(q, dtype=float))
        return self.torque(q, zero, zero)
