"""What every robot side does with requests, whoever moves its joints: accept, latch, report.

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
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

import numpy as np

from control.errors import RefusedError, StackError
from control.safety.certificate import Certificate
from control.trajectory.samples import Trajectory
from hw_interface.cell.backend import Measured
from hw_interface.cell.gate import Gate, valid_speed
from hw_interface.cell.motion_monitor import MISSED_GRASP, MonitorLimits
from hw_interface.messages.motions import MotionResult, Outcome
from hw_interface.messages.robot import Accepted, Mode, RobotState, Trouble

LOG = logging.getLogger(__name__)
RESULTS_KEPT = 16


class PlayableMotion(Protocol):
    """What a robot side needs to know of the motion that it plays.

    Attributes:
        serial: Of its certificate.
        samples: Samples of its trajectory.
        stopping: Whether it is being brought to rest.
        stop_mode: Mode to end in when `stopping`.
        trouble: Why the robot stops it, or None.
    """

    serial: str
    samples: int
    stopping: bool
    stop_mode: Mode
    trouble: Trouble | None

    @property
    def speed(self) -> float:
        """Share of the trajectory's own speed that was commanded last."""
        ...

    def change_speed(self, speed: float, gate: Gate) -> None:
        """Play the rest at another share of its own speed."""
        ...

    def result(self, outcome: Outcome, q_d: np.ndarray, measured: Measured, now: float) -> MotionResult:
        """What became of it."""
        ...


M = TypeVar("M", bound=PlayableMotion)


class RobotStateMachine(ABC, Generic[M]):
    """One robot's side of the wire. Not thread-safe: everything is called from the loop that calls `tick`.

    Args:
        gate: What trajectories are checked against.
        cell: Name of the cell, for the state messages.
        measured: What the robot measures now.
        q_d: Joint positions that it is commanded to hold in [rad], shape (7,).
        monitor_limits: Where it stops by itself.
        clock: Wall clock in [s].
    """

    def __init__(
        self,
        gate: Gate,
        cell: str,
        measured: Measured,
        q_d: np.ndarray,
        monitor_limits: MonitorLimits | None,
        clock: Callable[[], float] = time.time,
    ) -> None:
        self.epoch = uuid.uuid4().hex
        self.cell = cell
        self.gate = gate
        self._monitor_limits = monitor_limits or MonitorLimits()
        self._clock = clock
        self._begun = clock()
        self._measured = measured
        self._q_d = np.array(q_d, float)
        self._tracking_error = 0.0
        self._mode: Mode = "idle"
        self._motion: M | None = None
        self._serial: str | None = None
        self._progress = (0, 0)
        self._speed_wanted = 1.0
        self._trouble: Trouble | None = None
        self._used: set[str] = set()
        self._results: dict[str, MotionResult] = {}
        self._faults: dict[str, str] = {}  # that last, by what was being done

    @property
    def mode(self) -> Mode:
        """What the robot is doing."""
        return self._mode

    @property
    def moving(self) -> bool:
        """Whether a motion is being played."""
        return self._motion is not None

    @property
    def control_box_mode(self) -> str | None:
        """What a real robot's own control box says that it does; None where there is none."""
        return None

    @abstractmethod
    def tick(self) -> None:
        """One turn of the loop: measure, monitor, command. Never raises."""

    @abstractmethod
    def _make_motion(self, trajectory: Trajectory, certificate: Certificate, speed: float) -> M:
        """The motion of a trajectory that passed the gate; nothing moves yet.

        Raises:
            RefusedError: It cannot be played at this speed, or the robot does not take it.
        """

    @abstractmethod
    def _bring_to_rest(self, motion: M) -> None:
        """Have a motion come to rest on its path. May raise; the position is held then."""

    def _hold(self, trouble: Trouble) -> None:
        """Last resort: hold the last commanded position and latch."""
        if self._motion is not None:
            self._motion.trouble = trouble
            self._finish(self._motion, "reflex")
        elif self._trouble is None:
            self._mode, self._trouble = "reflex", trouble

    def submit(self, trajectory: Trajectory, certificate: Certificate | None, speed: float | None = None) -> Accepted:
        """Accept a trajectory; it begins with the next tick.

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
        motion = self._make_motion(trajectory, accepted, wanted)
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
            self._begin_stop(self._motion, "stopped", None)
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
            robot_mode=self.control_box_mode,
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

    def _react(self, trouble: Trouble) -> None:
        """Come to rest on the path and latch; a trouble at rest latches at once."""
        if self._motion is None:
            if self._trouble is None:
                LOG.error("%s: %s", trouble.code, trouble.reason)
                self._mode, self._trouble = "reflex", trouble
        elif not self._motion.stopping:
            LOG.error("%s: %s", trouble.code, trouble.reason)
            self._begin_stop(self._motion, "idle" if trouble.code == MISSED_GRASP else "reflex", trouble)
        elif self._motion.stop_mode != "reflex":
            self._motion.stop_mode, self._motion.trouble = "reflex", trouble

    def _log_fault(self, doing: str, error: Exception) -> None:
        """Log a fault that lasts once, not with every tick; the caller forgets it when the doing works again."""
        if self._faults.get(doing) != repr(error):
            self._faults[doing] = repr(error)
            LOG.exception("fault while %s", doing)

    def _begin_stop(self, motion: M, then: Mode, trouble: Trouble | None) -> None:
        motion.stopping, motion.stop_mode, motion.trouble = True, then, trouble
        self._mode = "stopping"
        try:
            self._bring_to_rest(motion)
        except Exception as error:
            LOG.exception("no stop on the path was found")
            self._hold(trouble or internal_trouble(error))

    def _finish(self, motion: M, mode: Mode) -> None:
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


def internal_trouble(error: Exception) -> Trouble:
    """What to say of a fault of our own."""
    kind = "" if isinstance(error, StackError) else f"{type(error).__name__}: "
    return Trouble(code="internal_error", reason=f"fault in the driver, position is held: {kind}{error}"[:2000])
