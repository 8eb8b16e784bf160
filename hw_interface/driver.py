"""The driver: the gate that trajectories must pass, and the player that commands exactly their samples.

At a speed below 1 it commands exactly their path, by a slower clock.

    idle ──accepted──▶ moving ──last sample, or a grasp that closed on nothing──▶ idle
                         │ stop request or trouble
                         ▼
                      stopping ──at rest──▶ stopped | reflex ──acknowledged──▶ idle

Nothing restarts by itself: whatever stopped a motion stays latched until somebody acknowledges it. A hand that stood
still and closed on nothing is the one exception: it ends the motion early, and nothing is wrong with the robot.
"""

import logging
import time
import uuid
from collections.abc import Callable

import numpy as np

from control.certificate import Certificate
from control.errors import RefusedError, StackError
from control.trajectory import Trajectory
from hw_interface.backend import Measured, RobotBackend
from hw_interface.gate import Gate, valid_speed
from hw_interface.messages import Accepted, Mode, RobotState, Trouble
from hw_interface.motion_messages import MotionResult, Outcome
from hw_interface.played_motion import PlayedMotion
from hw_interface.supervisor import MISSED_GRASP, SupervisionLimits

LOG = logging.getLogger(__name__)
RESULTS_KEPT = 16


class Driver:
    """One robot's driver. Not thread-safe: everything is called from the loop that calls `tick`.

    Args:
        backend: The robot.
        gate: What trajectories are checked against.
        cell: Name of the cell, for the state messages.
        supervision: Where the driver stops by itself.
        clock: Wall clock in [s].
    """

    def __init__(
        self,
        backend: RobotBackend,
        gate: Gate,
        cell: str,
        supervision: SupervisionLimits | None = None,
        clock: Callable[[], float] = time.time,
    ) -> None:
        self.epoch = uuid.uuid4().hex
        self.cell = cell
        self.gate = gate
        self._backend = backend
        self._supervision = supervision or SupervisionLimits()
        self._clock = clock
        self._begun = clock()
        self._measured: Measured = backend.read()
        self._q_d = np.array(self._measured.q, float)
        self._at_rest = np.zeros_like(self._q_d)
        self._tracking_error = 0.0
        self._mode: Mode = "idle"
        self._motion: PlayedMotion | None = None
        self._serial: str | None = None
        self._progress = (0, 0)
        self._speed_wanted = 1.0
        self._trouble: Trouble | None = None
        self._used: set[str] = set()
        self._results: dict[str, MotionResult] = {}

    @property
    def mode(self) -> Mode:
        """What the driver is doing."""
        return self._mode

    @property
    def moving(self) -> bool:
        """Whether samples are being played."""
        return self._motion is not None

    def submit(self, trajectory: Trajectory, certificate: Certificate | None, speed: float | None = None) -> Accepted:
        """Accept a trajectory; the next tick commands its first sample.

        Args:
            trajectory: What to play.
            certificate: The right to play it.
            speed: As for `set_speed`; None leaves the speed as it is set.

        Raises:
            RefusedError: busy, needs_acknowledge, what the gate refuses, bad_speed or too_slow; nothing moves.
        """
        if self._motion is not None:
            raise RefusedError("busy", f"the robot is {self._mode}; wait until it is idle, or stop it")
        if self._mode != "idle":
            why = f" ({self._trouble.reason})" if self._trouble else ""
            raise RefusedError("needs_acknowledge", f"the robot has {self._mode}{why}; acknowledge that first")
        accepted = self.gate.check(trajectory, certificate, self._q_d, self._measured, self._clock(), self._used)
        if accepted.scene_stamp < self._begun:
            # Serials that an earlier run of this process has played are forgotten, so its certificates end with it.
            raise RefusedError(
                "scene_too_old",
                "the motion was judged on a frame from before this robot process started; look again and plan anew",
            )
        wanted = self._speed_wanted if speed is None else valid_speed(speed)
        motion = PlayedMotion(trajectory, accepted.serial, wanted, self.gate, self._supervision, self._clock())
        self._used.add(accepted.serial)
        self._motion, self._serial, self._speed_wanted = motion, accepted.serial, wanted
        self._progress = (0, motion.samples)
        self._mode = "moving"
        return Accepted(serial=accepted.serial, epoch=self.epoch, samples=len(trajectory.q))

    def set_speed(self, speed: float) -> None:
        """Play the present motion from now on, and the next ones, at a share of their certified speed.

        Args:
            speed: Above 0 and at most 1.

        Raises:
            RefusedError: bad_speed (not in that range), busy (the arm is being stopped), too_slow (the motion would
                last too long), no_ramp or breaks_limit (nothing within the limits leads there from here); the speed
                stays as it was.
        """
        speed = valid_speed(speed)
        if self._motion is not None:
            self._motion.change_speed(speed, self.gate)
        self._speed_wanted = speed

    def stop(self) -> None:
        """Bring the arm to rest on its path, then stay until acknowledged. A robot at rest is latched, too."""
        if self._motion is None:
            if self._mode == "idle":
                self._mode = "stopped"
        elif not self._motion.stopping:
            self._begin_stop("stopped", None)
        elif self._motion.stop_mode == "idle":
            self._motion.stop_mode = "stopped"  # a person's stop outlasts a motion that ends by itself

    def reflex(self, code: str, reason: str) -> None:
        """Stop because of something that only the caller could see (for instance a loop that stood still)."""
        self._react(Trouble(code=code, reason=reason[:2000]))

    def acknowledge(self) -> None:
        """Become idle after a stop.

        Raises:
            RefusedError: busy: the arm still moves.
        """
        if self._motion is not None:
            raise RefusedError("busy", f"the robot is {self._mode}; there is nothing to acknowledge until it rests")
        self._mode, self._trouble = "idle", None

    def tick(self) -> None:
        """One millisecond of robot time: measure, supervise, command. Never raises."""
        try:
            self._measured = self._backend.read()
            self._tracking_error = float(np.abs(self._measured.q - self._q_d).max())
            trouble = self._supervise()
        except Exception as error:
            LOG.exception("fault while measuring")
            trouble = _internal(error)
        if trouble is not None:
            self._react(trouble)
        try:
            q_d, qd_d = self._next()
            self._backend.command(q_d, qd_d)
            self._q_d = q_d
        except Exception as error:
            LOG.exception("fault while commanding")
            self._hold(_internal(error))

    def state(self) -> RobotState:
        """The robot's state as of the last tick."""
        m = self._measured
        return RobotState(
            stamp=self._clock(),
            epoch=self.epoch,
            mode=self._mode,
            q=tuple(m.q.tolist()),
            qd=tuple(m.qd.tolist()),
            q_d=tuple(self._q_d.tolist()),
            tau=tuple(m.tau.tolist()),
            gripper_width=float(m.gripper_width),
            grasped=bool(m.grasped),
            motion_serial=self._serial,
            progress=self._progress[0],
            samples=self._progress[1],
            speed=0.0 if self._motion is None else self._motion.speed,
            speed_wanted=self._speed_wanted,
            tracking_error=self._tracking_error,
            cell=self.cell,
            profile=self.gate.profile,
            firmware=self.gate.firmware,
            limits_hash=self.gate.limits_hash,
            last_error=self._trouble,
        )

    def result(self, serial: str) -> MotionResult:
        """What became of a finished motion.

        Raises:
            RefusedError: unknown_motion: never played here, too long ago, or not finished.
        """
        if serial not in self._results:
            raise RefusedError(
                "unknown_motion",
                f"no finished motion '{serial}' is on record; the last {RESULTS_KEPT} are kept: {list(self._results)}",
            )
        return self._results[serial]

    def _supervise(self) -> Trouble | None:
        if self._motion is None:
            return None
        return self._motion.supervise(self._q_d, self._measured, self._tracking_error)

    def _react(self, trouble: Trouble) -> None:
        """Come to rest on the path and latch; a trouble at rest latches at once."""
        if self._motion is None:
            if self._trouble is None:
                LOG.error("%s: %s", trouble.code, trouble.reason)
                self._mode, self._trouble = "reflex", trouble
        elif not self._motion.stopping:
            LOG.error("%s: %s", trouble.code, trouble.reason)
            self._begin_stop("idle" if trouble.code == MISSED_GRASP else "reflex", trouble)
        elif self._motion.stop_mode != "reflex":
            self._motion.stop_mode, self._motion.trouble = "reflex", trouble

    def _begin_stop(self, then: Mode, trouble: Trouble | None) -> None:
        motion = self._motion
        assert motion is not None
        motion.stopping, motion.stop_mode, motion.trouble = True, then, trouble
        self._mode = "stopping"
        try:
            motion.stop(self.gate.robot_limits)
        except Exception as error:
            LOG.exception("no stop on the path was found")
            self._hold(trouble or _internal(error))

    def _next(self) -> tuple[np.ndarray, np.ndarray]:
        """The next joint position and velocity to command; finishes the motion after its last one."""
        motion = self._motion
        if motion is None:
            return self._q_d, self._at_rest
        command = motion.next_command()
        if command is None:
            self._finish(motion, motion.stop_mode if motion.stopping else "idle")
            return self._q_d, self._at_rest
        q_d, qd_d, gripper = command
        if gripper is not None:
            self._backend.gripper(gripper)
        self._progress = (motion.played, motion.samples)
        return q_d, qd_d

    def _hold(self, trouble: Trouble) -> None:
        """Last resort: hold the last commanded position and latch."""
        motion = self._motion
        if motion is not None:
            motion.trouble = trouble
            self._finish(motion, "reflex")
        elif self._trouble is None:
            self._mode, self._trouble = "reflex", trouble
        try:
            self._backend.command(self._q_d, self._at_rest)
        except Exception:
            LOG.exception("the robot does not take commands")

    def _finish(self, motion: PlayedMotion, mode: Mode) -> None:
        self._motion = None
        self._mode, self._trouble = mode, None if mode == "idle" else motion.trouble
        outcome: Outcome = "reflex"
        if mode == "idle":
            outcome = "completed" if motion.trouble is None else "ended_early"
        elif mode == "stopped":
            outcome = "stopped"
        self._results[motion.serial] = motion.result(outcome, self._q_d, self._measured, self._clock())
        while len(self._results) > RESULTS_KEPT:
            del self._results[next(iter(self._results))]


def _internal(error: Exception) -> Trouble:
    kind = "" if isinstance(error, StackError) else f"{type(error).__name__}: "
    return Trouble(code="internal_error", reason=f"fault in the driver, position is held: {kind}{error}"[:2000])
