"""The control box itself, without sockets: modes, motions, reflexes, settings. One call of `tick` is one millisecond.

Mode by mode:

    idle           holds the arm; takes a Move
    move           follows commands until one says finished, a StopMove, a reflex or the user stop
    reflex         after an error; brakes to rest, refuses a Move until an AutomaticErrorRecovery
    recovery       while that lasts: until the arm rests
    user_stopped   while the button is pressed; brakes to rest, nothing can be started or recovered
    guiding        while somebody guides the arm; no Move
    other          brakes locked; no Move

Sources of the behaviour: Franka Control Interface documentation; libfranka 0.9.2, `robot_impl.cpp`, `control_loop.cpp`
(what a client expects of the order of states and answers).
"""

import struct
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from control.robot.limits import RobotLimits
from control.trajectory.samples import SAMPLE_TIME
from hw_interface.fci_simulator.history import History
from hw_interface.fci_simulator.layout import (
    Command,
    Controller,
    Error,
    Generator,
    Mode,
    MoveStatus,
    RecoveryStatus,
    StopStatus,
    response,
)
from hw_interface.fci_simulator.limits_check import (
    command_error,
    measured_error,
    start_error,
    torque_command_error,
)
from hw_interface.fci_simulator.plant import JointReadings, Plant
from hw_interface.fci_simulator.robot_state import StateRecord
from hw_interface.fci_simulator.set_point import SetPoint
from hw_interface.fci_simulator.settings import Settings

# Lost packets in a row after which a motion is aborted; Franka Control Interface documentation, "Robot limits".
MOST_LOST = 20
SUCCESS_WINDOW = 100  # commands that control_command_success_rate counts; libfranka, `robot_state.h`
RECOVERY_TIME, LONGEST_RECOVERY = 0.05, 1.0  # [s] that a recovery takes at least, and at most if the arm never rests
RESTING = 1e-3  # [rad/s] of every joint, below which the arm rests


@dataclass
class CommandedMotion:
    """A Move that is being carried out.

    Attributes:
        command_id: Of the Move; its last answer carries it.
        controller, generator: As asked for.
        started: Whether a command has come.
        lost: Packets lost in a row.
        success: Which of the last commands came.
        stop_id: Of the StopMove that ends it, or None.
    """

    command_id: int
    controller: Controller
    generator: Generator
    started: bool = False
    lost: int = 0
    success: deque[bool] = field(default_factory=lambda: deque(maxlen=SUCCESS_WINDOW))
    stop_id: int | None = None


class ControlBox:
    """The state machine of one robot.

    Args:
        plant: The robot.
        limits: What its commands are checked against.
        say: Called with one line for every event that a person would want to read.

    Attributes:
        settings: What clients have set.
        milliseconds: Robot time; the id of the last state.
        history: What it did in the last seconds.
        outbox: Answers for the client, oldest first; the caller empties it.
    """

    def __init__(self, plant: Plant, limits: RobotLimits, say: Callable[[str], None]) -> None:
        self._plant, self._limits, self._say = plant, limits, say
        self._set_point = SetPoint(plant.q)
        self._record = StateRecord(plant.arm, plant.gravity)
        self.settings = Settings(plant, self._record)
        self.milliseconds = 0
        self.history = History()
        self._told = False  # whether the set point of this millisecond is a client's
        self.outbox: list[bytes] = []
        self._motion: CommandedMotion | None = None
        self._errors: set[Error] = set()
        self._last_motion_errors: set[Error] = set()
        self._user_stop = self._locked = self._guided = False
        self._recovery: tuple[int, int] | None = None  # command id, robot time at which it may end
        self._tau_d = np.zeros(7)
        self._push_until = 0
        self._joint_collision, self._cartesian_collision = np.zeros(7), np.zeros(6)
        self._readings = plant.step(self._set_point.q, self._set_point.dq)
        self._describe()

    @property
    def mode(self) -> Mode:
        """What the robot does now."""
        if self._user_stop:
            return Mode.USER_STOPPED
        if self._locked:
            return Mode.OTHER
        if self._recovery is not None:
            return Mode.RECOVERY
        if self._errors:
            return Mode.REFLEX
        if self._motion is not None:
            return Mode.MOVE
        return Mode.GUIDING if self._guided else Mode.IDLE

    @property
    def motion(self) -> CommandedMotion | None:
        """The motion under way, or None."""
        return self._motion

    @property
    def errors(self) -> tuple[str, ...]:
        """Names of the present errors, as libfranka prints them."""
        return tuple(sorted(e.printed for e in self._errors))

    @property
    def state(self) -> bytes:
        """The present state as it goes over the wire."""
        return self._record.as_bytes()

    def tick(self, command: np.void | None, counts: bool = True, shown: bool = True) -> None:
        """Advance by one millisecond.

        Args:
            command: The client's command (`layout.COMMAND`) for it, or None: lost while a motion is followed.
            counts: Whether robot time advances. A state that was sent ahead of a motion's first command has counted
                its millisecond already.
            shown: Whether the state is looked at afterwards; without a motion it is not brought up to date else.
        """
        motion, self._told = self._motion, False
        torque: np.ndarray | None = None
        if motion is not None and motion.stop_id is None and (motion.started or command is not None):
            torque = self._follow(motion, command)
        elif motion is None or motion.stop_id is not None:
            rests = self._set_point.brake(self._limits)
            if motion is not None and rests:
                self._end_stopped(motion)
        if torque is None:
            readings = self._plant.step(self._set_point.q, self._set_point.dq)
            self._tau_d = np.zeros(7)
        else:
            readings = self._plant.step_with_torque(torque)
            self._tau_d = torque
        self.milliseconds += counts
        if self._push_until and self.milliseconds >= self._push_until:
            self._push_until = 0
            self._plant.set_push(np.zeros(7))
        self._readings = readings
        shown = shown or self._motion is not None
        if shown:
            self._watch(readings)
        self._finish_recovery()
        if shown:
            self._describe()
        self.history.add(self.milliseconds, self.mode, self._set_point.q, readings.q, self._told)

    # requests of the client

    def move(self, command_id: int, body: bytes) -> None:
        """Begin a motion."""
        controller, generator = struct.unpack_from("<II", body)
        if self.mode is not Mode.IDLE or self._set_point.dq.any():
            braking = " while braking" if self._set_point.dq.any() else ""
            self._say(f"Move refused in mode {self.mode.name.lower()}{braking}")
            self._answer(Command.MOVE, command_id, MoveStatus.NOT_POSSIBLE)
            return
        joint_generators = (Generator.JOINT_POSITION, Generator.JOINT_VELOCITY)
        if controller > Controller.EXTERNAL or generator not in joint_generators:
            self._say(f"Move refused: controller {controller}, generator {generator}; Cartesian ones are not simulated")
            self._answer(Command.MOVE, command_id, MoveStatus.INPUT_ERROR_ABORTED)
            return
        self._motion = CommandedMotion(command_id, Controller(controller), Generator(generator))
        self._last_motion_errors = set()
        self._tau_d = np.zeros(7)
        self._answer(Command.MOVE, command_id, MoveStatus.STARTED)
        self._describe()

    def stop_move(self, command_id: int) -> None:
        """Brake a motion to rest; answered when the arm rests."""
        if self._motion is None:
            self._answer(Command.STOP_MOVE, command_id, StopStatus.NOT_POSSIBLE)
            return
        self._take_over_torque_motion(self._motion)
        self._motion.stop_id = command_id

    def recover(self, command_id: int) -> None:
        """Begin an automatic error recovery; answered when the arm rests."""
        if self._user_stop:
            self._answer(Command.AUTOMATIC_ERROR_RECOVERY, command_id, RecoveryStatus.EMERGENCY_ABORTED)
        elif self._motion is not None or self._locked or self._recovery is not None:
            self._answer(Command.AUTOMATIC_ERROR_RECOVERY, command_id, RecoveryStatus.NOT_POSSIBLE)
        elif not self._errors:
            self._answer(Command.AUTOMATIC_ERROR_RECOVERY, command_id, RecoveryStatus.SUCCESS)
        else:
            self._recovery = (command_id, self.milliseconds + round(RECOVERY_TIME / SAMPLE_TIME))
            self._describe()

    def configure(self, command: Command, command_id: int, body: bytes) -> None:
        """Carry out a setter or getter, which the box does not while it moves."""
        self._answer(command, command_id, *self.settings.apply(command, body, self._motion is not None))

    # what happens to the robot

    def client_gone(self) -> None:
        """The client has left: a motion that it left behind is a failure of communication."""
        if self._motion is not None:
            self.reflex(Error.COMMUNICATION)
        if self._recovery is not None:
            self._recovery = (-1, self._recovery[1])
        self.outbox.clear()

    def reflex(self, error: Error) -> None:
        """Abort the motion under way, if any, and brake to rest."""
        self._errors.add(error)
        self._last_motion_errors = {error}
        self._recovery = None
        self._say(f"reflex: {error.printed}")
        if self._motion is not None:
            self._abort(self._motion, MoveStatus.REFLEX_ABORTED, StopStatus.REFLEX_ABORTED)
        self._describe()

    def press_user_stop(self, pressed: bool) -> None:
        """Press or release the user stop."""
        self._user_stop = pressed
        self._say(f"user stop {'pressed' if pressed else 'released'}")
        if pressed:
            if self._recovery is not None:
                self._answer(Command.AUTOMATIC_ERROR_RECOVERY, self._recovery[0], RecoveryStatus.EMERGENCY_ABORTED)
                self._recovery = None
            if self._motion is not None:
                self._abort(self._motion, MoveStatus.EMERGENCY_ABORTED, StopStatus.EMERGENCY_ABORTED)
        self._describe()

    def lock_brakes(self, locked: bool) -> None:
        """Lock or open the brakes; locking them aborts a motion."""
        self._locked = locked
        if locked and self._motion is not None:
            self._abort(self._motion, MoveStatus.ABORTED, StopStatus.ABORTED)
        self._describe()

    def guide(self, guided: bool) -> None:
        """Enter or leave the guiding mode; the arm stays where it is."""
        self._guided = guided
        self._describe()

    def push(self, torque: np.ndarray, duration: float) -> None:
        """Let something push the joints with a torque in [Nm], shape (7,), for a duration in [s]."""
        self._plant.set_push(torque)
        self._push_until = self.milliseconds + max(1, round(duration / SAMPLE_TIME))

    # within

    def _follow(self, motion: CommandedMotion, command: np.void | None) -> np.ndarray | None:
        """Take the command for this millisecond; returns the torque in [Nm] that an external controller wants."""
        first, motion.started = not motion.started, True
        motion.success.append(command is not None)
        motion.lost = 0 if command is not None else motion.lost + 1
        if motion.lost >= MOST_LOST:
            return self._fail(Error.COMMUNICATION)
        q = self._wanted(motion, command)
        error = None
        if first and motion.generator is Generator.JOINT_POSITION:
            error = start_error(q, self._set_point)
        if error is None:
            error = command_error(q, self._set_point, self._limits)
        if error is not None:
            return self._fail(error)
        torque = None
        if motion.controller is Controller.EXTERNAL:
            torque = self._tau_d if command is None else np.array(command["tau_J_d"])
            error = torque_command_error(torque, self._tau_d, self._limits)
            if error is not None:
                return self._fail(error)
        self._set_point.follow(q)
        self._told = command is not None
        if command is not None and command["finished"]:
            return self._finish(motion)
        return torque

    def _wanted(self, motion: CommandedMotion, command: np.void | None) -> np.ndarray:
        """Where the motion generator wants the joints one millisecond from now, in [rad], shape (7,)."""
        point = self._set_point
        if command is None:
            return point.extrapolated()
        if motion.generator is Generator.JOINT_POSITION:
            share = self.settings.filter_share("joint_position")
            return share * command["q_c"] + (1.0 - share) * point.q
        share = self.settings.filter_share("joint_velocity")
        return point.q + (share * command["dq_c"] + (1.0 - share) * point.dq) * SAMPLE_TIME

    def _finish(self, motion: CommandedMotion) -> None:
        """End a motion that its client calls finished: from there on the arm must be able to rest."""
        if motion.controller is Controller.EXTERNAL:
            self._take_over_torque_motion(motion)
        else:
            error = command_error(self._set_point.q, self._set_point, self._limits)
            if error is not None:
                self._fail(error)
                return
            self._set_point.rest(self._set_point.q)
        self._motion = None
        self._answer(Command.MOVE, motion.command_id, MoveStatus.SUCCESS)

    def _fail(self, error: Error) -> None:
        self.reflex(error)

    def _abort(self, motion: CommandedMotion, status: MoveStatus, stop_status: StopStatus) -> None:
        self._take_over_torque_motion(motion)
        self._motion = None
        self._answer(Command.MOVE, motion.command_id, status)
        if motion.stop_id is not None:
            self._answer(Command.STOP_MOVE, motion.stop_id, stop_status)

    def _end_stopped(self, motion: CommandedMotion) -> None:
        self._motion = None
        self._answer(Command.MOVE, motion.command_id, MoveStatus.PREEMPTED)
        assert motion.stop_id is not None
        self._answer(Command.STOP_MOVE, motion.stop_id, StopStatus.SUCCESS)

    def _take_over_torque_motion(self, motion: CommandedMotion) -> None:
        """Under an external controller the set point does not lead: brake from where the arm is."""
        if motion.controller is Controller.EXTERNAL and motion.stop_id is None:
            self._set_point.moving_at(self._readings.q, self._readings.dq)

    def _watch(self, readings: JointReadings) -> None:
        """Contact, collision and what else is measured."""
        record = self._record
        record.estimate_wrench(readings)
        levels = self.settings.thresholds.at(self._set_point.ddq)
        torque, wrench = np.abs(readings.tau_ext), np.abs(record.wrench_K)
        record.set("joint_contact", torque > levels.lower_torque)
        record.set("cartesian_contact", wrench > levels.lower_force)
        hit_joints, hit = torque > levels.upper_torque, wrench > levels.upper_force
        if hit_joints.any() or hit.any():
            self._joint_collision[hit_joints] = 1.0
            self._cartesian_collision[hit] = 1.0
            if self._motion is not None:
                self._set_point.moving_at(readings.q, readings.dq)  # give way instead of pressing on
                self._told = False
                self.reflex(Error.JOINT_REFLEX if hit_joints.any() else Error.CARTESIAN_REFLEX)
        if self._motion is not None:
            error = measured_error(readings.q, readings.dq, readings.drive, self._limits)
            if error is not None:
                self.reflex(error)

    def _finish_recovery(self) -> None:
        if self._recovery is None or self.milliseconds < self._recovery[1]:
            return
        command_id, earliest = self._recovery
        rests = not self._set_point.dq.any() and bool(np.abs(self._readings.dq).max() < RESTING)
        if not rests and self.milliseconds < earliest + round(LONGEST_RECOVERY / SAMPLE_TIME):
            return
        self._recovery = None
        self._errors.clear()
        self._joint_collision[:] = 0.0
        self._cartesian_collision[:] = 0.0
        self._say("recovered")
        if command_id >= 0:
            self._answer(Command.AUTOMATIC_ERROR_RECOVERY, command_id, RecoveryStatus.SUCCESS)

    def _describe(self) -> None:
        """Bring the state up to date."""
        record, motion = self._record, self._motion
        record.fill(self._readings, self._set_point, self._tau_d)
        record.set("message_id", self.milliseconds)
        record.set("joint_collision", self._joint_collision)
        record.set("cartesian_collision", self._cartesian_collision)
        record.set("motion_generator_mode", 0 if motion is None else motion.generator + 1)
        record.set("controller_mode", Controller.OTHER if motion is None else motion.controller)
        record.set("errors", _bits(self._errors))
        record.set("reflex_reason", _bits(self._last_motion_errors))
        record.set("robot_mode", self.mode)
        success = motion.success if motion is not None else ()
        record.set("control_command_success_rate", sum(success) / len(success) if success else 0.0)

    def _answer(self, command: Command, command_id: int, status: int, body: bytes = b"") -> None:
        self.outbox.append(response(command, command_id, status, body))


def _bits(errors: set[Error]) -> np.ndarray:
    bits = np.zeros(41, np.uint8)
    bits[list(errors)] = 1
    return bits
