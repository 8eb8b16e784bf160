"""The arm and hand under the control box: a MuJoCo world driven through its joint servos, or by bare torques."""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from control.robot.gripper import PANDA_HAND, GripperModel
from control.trajectory.samples import SAMPLE_TIME
from control.twin_model import ARM_ACTUATORS, ARM_BODIES, ARM_JOINTS
from hw_interface.fci_simulator.arm import Arm
from hw_interface.simulated.sim_backend import SimBackend

# First-order low-pass of the estimated external torque in [Hz]. Franka publishes none; this one shows a blow to the
# hand within 10 ms and takes away the chatter of the contact solver.
EXTERNAL_TORQUE_CUTOFF = 30.0
# How far the mechanical stops lie beyond the positions that may be commanded in [rad], so that an arm that follows with
# an error does not strike them. Not published.
STOPS = 0.05


@dataclass(frozen=True)
class JointReadings:
    """What the joints measure; arrays of shape (7,).

    Attributes:
        q, dq: Positions in [rad] and velocities in [rad/s].
        tau: Torques on the side of the links in [Nm], gravity included.
        dtau: Their rate in [Nm/s].
        drive: Torques that the drives give in [Nm], gravity included; they also accelerate the drives themselves.
        tau_ext: Low-passed torques that the arm spends on what it touches in [Nm], what the announced load explains
            not counted; positive where the robot pushes: tau = (torque of the robot's own model) + tau_ext.
    """

    q: NDArray[np.float64]
    dq: NDArray[np.float64]
    tau: NDArray[np.float64]
    dtau: NDArray[np.float64]
    drive: NDArray[np.float64]
    tau_ext: NDArray[np.float64]


class Plant:
    """A simulated Panda, advanced by one millisecond a call.

    Args:
        model, data: World whose robot carries the names of `control.twin_model`; stepped here alone.
        gripper: What the robot carries.

    Attributes:
        arm: Its rigid-body model.
        backend: The simulated servos and gripper.

    Raises:
        ConfigError: The model lacks a joint, body or actuator.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, gripper: GripperModel = PANDA_HAND) -> None:
        self.backend = SimBackend(model, data, gripper)
        self._model, self._data = model, data
        joints = [int(model.joint(name).id) for name in ARM_JOINTS]
        self._q, self._v = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
        model.jnt_range[joints] += (-STOPS, STOPS)
        self._servos = np.array([int(model.actuator(name).id) for name in ARM_ACTUATORS])
        self._armature = model.dof_armature[self._v].copy()
        self._lead = -model.actuator_biasprm[self._servos, 2] / model.actuator_gainprm[self._servos, 0]
        self._stiffness = model.actuator_gainprm[self._servos, 0].copy()
        self._servo_on = True
        base = data.body(ARM_BODIES[0]).xmat.reshape(3, 3)
        self.gravity = base.T @ model.opt.gravity
        self.arm = Arm(gripper, self.gravity)
        self._push = np.zeros(7)
        self._smoothing = SAMPLE_TIME / (SAMPLE_TIME + 1.0 / (2.0 * np.pi * EXTERNAL_TORQUE_CUTOFF))
        self._tau_ext = np.zeros(7)
        self._tau = self._link_torque(self._drive_torque())
        self._dtau = np.zeros(7)

    @property
    def q(self) -> np.ndarray:
        """Measured joint positions in [rad], shape (7,)."""
        return self._data.qpos[self._q]

    @property
    def dq(self) -> np.ndarray:
        """Measured joint velocities in [rad/s], shape (7,)."""
        return self._data.qvel[self._v]

    @property
    def stiffness(self) -> np.ndarray:
        """Stiffness of the joint servos in [Nm/rad], shape (7,)."""
        return self._stiffness.copy()

    def set_stiffness(self, stiffness: np.ndarray) -> None:
        """Set the stiffness of the joint servos in [Nm/rad], shape (7,); their damping stays in proportion."""
        self._stiffness = np.array(stiffness, float)
        self._set_servo(self._servo_on)

    def set_push(self, torque: np.ndarray) -> None:
        """Let something outside push the joints with a torque in [Nm], shape (7,), until set again."""
        self._push = np.array(torque, float)

    def step(self, q_d: np.ndarray, dq_d: np.ndarray) -> JointReadings:
        """Advance under the joint servos towards q_d in [rad], moving with dq_d in [rad/s], both of shape (7,)."""
        if not self._servo_on:
            self._set_servo(True)
        return self._advance(q_d, dq_d, self._push)

    def step_with_torque(self, tau: np.ndarray) -> JointReadings:
        """Advance under bare joint torques in [Nm], shape (7,), added to the compensation of gravity."""
        if self._servo_on:
            self._set_servo(False)
        return self._advance(self.q, np.zeros(7), self._push + tau)

    def _advance(self, q_d: np.ndarray, dq_d: np.ndarray, applied: np.ndarray) -> JointReadings:
        data = self._data
        data.qfrc_applied[self._v] = applied
        self.backend.command(q_d, dq_d)
        drive = self._drive_torque()
        tau = self._link_torque(drive)
        self._dtau = (tau - self._tau) / SAMPLE_TIME
        self._tau = tau
        q, dq = data.qpos[self._q], data.qvel[self._v]
        outside = -data.qfrc_constraint[self._v] - self._push
        outside -= self.arm.load_torque(q, dq, data.qacc[self._v])
        self._tau_ext += self._smoothing * (outside - self._tau_ext)
        return JointReadings(q, dq, tau, self._dtau, drive, self._tau_ext.copy())

    def _drive_torque(self) -> np.ndarray:
        data, v = self._data, self._v
        return data.qfrc_actuator[v] + data.qfrc_gravcomp[v] + data.qfrc_applied[v] - self._push

    def _link_torque(self, drive: np.ndarray) -> np.ndarray:
        """Torque behind motor and gear: what is left of the drive's after accelerating its own inertia."""
        return drive - self._armature * self._data.qacc[self._v]

    def _set_servo(self, on: bool) -> None:
        gain = self._stiffness if on else np.zeros(7)
        self._model.actuator_gainprm[self._servos, 0] = gain
        self._model.actuator_biasprm[self._servos, 1] = -gain
        self._model.actuator_biasprm[self._servos, 2] = -self._lead * gain
        self._servo_on = on
