"""Filling the state that the control box sends every millisecond."""

import numpy as np

from control.trajectory.samples import SAMPLE_TIME
from hw_interface.fci_simulator.arm import Arm, RigidLoad
from hw_interface.fci_simulator.layout import STATE
from hw_interface.fci_simulator.plant import JointReadings
from hw_interface.fci_simulator.set_point import SetPoint

ELBOW_FLIP = -0.467002423653011  # [rad] of joint 4; libfranka, `robot.h`
# Product of the Jacobian's singular values below which an external wrench is not told apart from noise (a Panda in its
# ready pose has about 0.1). Not published; libfranka's `robot_state.h` says that the wrench is zero near singularities.
SINGULAR = 0.01


class StateRecord:
    """One `layout.STATE` with everything that it takes to fill it.

    Args:
        arm: The robot's rigid bodies.
        gravity: Acceleration of free fall in the base frame in [m/s^2], shape (3,).

    Attributes:
        F_T_NE, NE_T_EE, EE_T_K: Frames at the flange as transforms, shape (4, 4); call `frames_changed` after a change.
        wrench_K: External force [N] and torque [Nm] at K in the axes of K, shape (6,).
    """

    def __init__(self, arm: Arm, gravity: np.ndarray) -> None:
        self._arm = arm
        self._record = np.zeros((), STATE)
        # Views of the fields: indexing a structured array by name at every use is what takes the time.
        self._view = {name: self._record[name] for name in STATE.names or ()}
        self.F_T_NE = arm.flange_T_hand_tcp.copy()
        self.NE_T_EE, self.EE_T_K = np.eye(4), np.eye(4)
        self.wrench_K = np.zeros(6)
        hand = arm.hand
        self.set("m_ee", hand.mass)
        self.set("F_x_Cee", hand.com)
        self.set("I_ee", hand.inertia.T.ravel())
        self.set("O_ddP_O", gravity)
        self.frames_changed()

    def set(self, name: str, value: object) -> None:
        """Set one field."""
        self._view[name][...] = value

    def set_load(self, load: RigidLoad) -> None:
        """What is fastened to the flange beside the hand."""
        self.set("m_load", load.mass)
        self.set("F_x_Cload", load.com)
        self.set("I_load", load.inertia.T.ravel())

    def frames_changed(self) -> None:
        """Take over the frames at the flange."""
        self._F_T_EE = self.F_T_NE @ self.NE_T_EE
        self._F_T_K = self._F_T_EE @ self.EE_T_K
        for name, pose in (
            ("F_T_NE", self.F_T_NE),
            ("NE_T_EE", self.NE_T_EE),
            ("EE_T_K", self.EE_T_K),
            ("F_T_EE", self._F_T_EE),
        ):
            self.set(name, pose.T.ravel())

    def estimate_wrench(self, readings: JointReadings) -> None:
        """Take the wrench at K from the external torque: the F with J^T F nearest to it."""
        O_T_F = self._arm.flange_pose(readings.q)
        turn = O_T_F[:3, :3]
        jacobian = self._arm.jacobian(readings.q, turn @ self._F_T_K[:3, 3])
        square = jacobian @ jacobian.T
        wrench = np.zeros(6)
        if np.linalg.det(square) > SINGULAR**2:
            wrench = np.linalg.solve(square, jacobian @ readings.tau_ext)
        O_R_K = turn @ self._F_T_K[:3, :3]
        self.wrench_K = np.concatenate([O_R_K.T @ wrench[:3], O_R_K.T @ wrench[3:]])
        view = self._view
        view["O_F_ext_hat_K"][:] = wrench
        view["K_F_ext_hat_K"][:] = self.wrench_K
        view["O_T_EE"][:] = (O_T_F @ self._F_T_EE).T.ravel()

    def fill(self, readings: JointReadings, set_point: SetPoint, tau_d: np.ndarray) -> None:
        """Take over what the joints measure and what the box wants."""
        view = self._view
        view["q"][:] = view["theta"][:] = readings.q  # gears taken as rigid
        view["dq"][:] = view["dtheta"][:] = readings.dq
        view["tau_J"][:] = readings.tau
        view["dtau_J"][:] = readings.dtau
        view["tau_J_d"][:] = tau_d
        view["tau_ext_hat_filtered"][:] = readings.tau_ext
        view["q_d"][:], view["dq_d"][:], view["ddq_d"][:] = set_point.q, set_point.dq, set_point.ddq
        view["elbow"][:] = readings.q[2], _flip(readings.q[3])
        desired_elbow = set_point.q[2], _flip(set_point.q[3])
        view["elbow_d"][:] = view["elbow_c"][:] = desired_elbow
        view["delbow_c"][0], view["ddelbow_c"][0] = set_point.dq[2], set_point.ddq[2]
        O_T_F = self._arm.flange_pose(set_point.q)
        view["O_T_EE_d"][:] = view["O_T_EE_c"][:] = (O_T_F @ self._F_T_EE).T.ravel()
        twist = np.zeros(6)
        if set_point.dq.any():
            twist = self._arm.jacobian(set_point.q, O_T_F[:3, :3] @ self._F_T_EE[:3, 3]) @ set_point.dq
        view["O_ddP_EE_c"][:] = (twist - view["O_dP_EE_c"]) / SAMPLE_TIME
        view["O_dP_EE_d"][:] = view["O_dP_EE_c"][:] = twist

    def as_bytes(self) -> bytes:
        """As it goes over the wire."""
        return self._record.tobytes()


def _flip(q4: float) -> float:
    return float(np.sign(q4 - ELBOW_FLIP))
