"""The simulated Panda: joint impedance control, gripper and sensors on a MuJoCo model that steps at 1 kHz."""

import mujoco
import numpy as np

from control.errors import ConfigError
from control.robot.gripper import PANDA_HAND, GripperModel
from control.trajectory.samples import SAMPLE_TIME, GripperCommand
from control.twin_model import ARM_ACTUATORS, ARM_BODIES, ARM_JOINTS, FINGER_JOINTS, GRIPPER_ACTUATOR, HAND_BODY
from hw_interface.cell.backend import Measured

STILL_SPEED = 2e-3  # [m/s]; a finger slower than this has arrived or is blocked
STILL_TIME = 0.03  # [s]; for so long
ARRIVED = 1e-3  # [m]; difference of half widths that counts as arrived
SETTLE_TIME = 1.0  # [s]; after which a blocked gripper is no longer busy even if it trembles
MIN_GRASP_WIDTH = 1e-3  # [m]; pads closer than this hold nothing
GRASP_SHARE = 0.5  # of the asked force that must be felt


class SimBackend:
    """A `RobotBackend` on a MuJoCo model that uses the names of `control.twin_model`.

    The arm's actuators are position servos f = kp (ctrl - q) - kv qd. Velocity feedforward makes them follow a moving
    set point without lag:

        ctrl = q_d + (kv / kp) qd_d

    Args:
        model, data: The world; its time step is set to one millisecond. `data` is stepped by `command`.
        gripper: How fast the set point of its fingers moves.

    Raises:
        ConfigError: The model lacks a joint, body or actuator, or an actuator is not a position servo.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, gripper: GripperModel = PANDA_HAND) -> None:
        self._model, self._data = model, data
        self._rated_speed = self._finger_speed = gripper.rated_speed
        model.opt.timestep = SAMPLE_TIME
        self._servos = np.array([_id(model, "actuator", name) for name in ARM_ACTUATORS])
        self._grip = _id(model, "actuator", GRIPPER_ACTUATOR)
        joints = [_id(model, "joint", name) for name in ARM_JOINTS]
        fingers = [_id(model, "joint", name) for name in FINGER_JOINTS]
        self._q, self._v = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
        self._finger_q, self._finger_v = model.jnt_qposadr[fingers], model.jnt_dofadr[fingers]
        gain = model.actuator_gainprm[self._servos, 0]
        if not np.all(gain > 0) or not np.allclose(model.actuator_biasprm[self._servos, 1], -gain):
            raise ConfigError(f"the model's actuators {list(ARM_ACTUATORS)} must be position servos with kp > 0")
        self._lead = -model.actuator_biasprm[self._servos, 2] / gain
        self._gravity_apart = ~model.jnt_actgravcomp[joints].astype(bool)
        arm_bodies = [_id(model, "body", name) for name in (*ARM_BODIES[1:], HAND_BODY)]  # the base may touch
        self._arm_geom = np.isin(model.geom_bodyid, arm_bodies)
        self._full_grip_range = model.actuator_forcerange[self._grip].copy()
        self._grip_kp = float(model.actuator_gainprm[self._grip, 0])
        self._half_target = self._half_now = float(data.ctrl[self._grip])
        self._gripper_command: GripperCommand | None = None
        self._grasping = False
        self._busy = False
        self._busy_time = self._still_time = 0.0
        self._force = np.zeros(6)
        mujoco.mj_forward(model, data)

    @property
    def time(self) -> float:
        """Simulated time in [s]."""
        return float(self._data.time)

    def read(self) -> Measured:
        """What the simulated sensors show."""
        data = self._data
        tau = data.qfrc_actuator[self._v] + np.where(self._gravity_apart, data.qfrc_gravcomp[self._v], 0.0)
        return Measured(
            q=data.qpos[self._q],
            qd=data.qvel[self._v],
            tau=tau,
            gripper_width=float(data.qpos[self._finger_q].sum()),
            gripper_busy=self._busy,
            grasped=self._grasped(),
            contact_force=self._contact_force(),
        )

    def command(self, q_d: np.ndarray, qd_d: np.ndarray) -> None:
        """Command the servos and step the world by one millisecond."""
        data = self._data
        data.ctrl[self._servos] = q_d + self._lead * qd_d
        step = self._finger_speed * SAMPLE_TIME
        self._half_now += min(max(self._half_target - self._half_now, -step), step)
        data.ctrl[self._grip] = self._half_now
        mujoco.mj_step(self._model, data)
        self._watch_gripper()

    def gripper(self, command: GripperCommand, finger_speed: float | None = None) -> None:
        """Begin a gripper command.

        Args:
            command: What to do.
            finger_speed: Of each finger's set point in [m/s]; the rated speed if None, and at most that.
        """
        self._finger_speed = self._rated_speed if finger_speed is None else min(finger_speed, self._rated_speed)
        self._gripper_command = command
        self._grasping = command.kind == "grasp"
        # The servo drives one finger and the coupling shares its force: twice the force of a pad.
        low, high = self._full_grip_range
        force = 2.0 * command.force if self._grasping else np.inf
        if high > low:
            self._model.actuator_forcerange[self._grip] = (max(low, -force), min(high, force))
        self._half_target = 0.0 if self._grasping else command.width / 2.0
        if not self._grasping:
            # From where the fingers are: a squeezing set point is far from them.
            self._half_now = float(self._data.qpos[self._finger_q].mean())
        self._busy, self._busy_time, self._still_time = True, 0.0, 0.0

    def stop_gripper(self) -> None:
        """Have moving fingers stay where they are; a finished grasp goes on holding."""
        if self._busy:
            self._half_target = self._half_now = float(self._data.qpos[self._finger_q].mean())
            self._grasping = self._busy = False

    def _watch_gripper(self) -> None:
        if not self._busy:
            return
        data = self._data
        half = float(data.qpos[self._finger_q].mean())
        slow = bool(np.abs(data.qvel[self._finger_v]).max() < STILL_SPEED)
        self._busy_time += SAMPLE_TIME
        self._still_time = self._still_time + SAMPLE_TIME if slow else 0.0
        ramp_done = self._half_now == self._half_target
        if self._grasping:
            done = self._still_time >= STILL_TIME and (self._pressing() or (ramp_done and half < MIN_GRASP_WIDTH))
        else:
            done = ramp_done and self._still_time >= STILL_TIME and abs(half - self._half_target) < ARRIVED
        blocked = ramp_done and self._busy_time > SETTLE_TIME and self._still_time >= STILL_TIME
        self._busy = not (done or blocked)

    def _pressing(self) -> bool:
        """Whether the gripper's servo feels at least half of the force that was asked for."""
        command = self._gripper_command
        wanted = 2.0 * command.force if command is not None else np.inf
        wanted = min(wanted, abs(float(self._full_grip_range[0])) or np.inf)
        return -float(self._data.actuator_force[self._grip]) >= GRASP_SHARE * wanted

    def _grasped(self) -> bool:
        """Whether something keeps the squeezing pads apart."""
        return (
            self._grasping
            and not self._busy
            and float(self._data.qpos[self._finger_q].sum()) > MIN_GRASP_WIDTH
            and self._pressing()
        )

    def _contact_force(self) -> float:
        """Sum of the normal forces of all contacts of arm and hand (fingers not counted) in [N]."""
        data = self._data
        if data.ncon == 0:
            return 0.0
        total = 0.0
        for i in np.flatnonzero(self._arm_geom[data.contact.geom].any(axis=1)):
            mujoco.mj_contactForce(self._model, data, int(i), self._force)
            total += abs(float(self._force[0]))
        return total


def _id(model: mujoco.MjModel, kind: str, name: str) -> int:
    try:
        return int(getattr(model, kind)(name).id)
    except KeyError:
        raise ConfigError(
            f"the world's model has no {kind} '{name}'; build its robot with the names of control.twin_model"
        ) from None
