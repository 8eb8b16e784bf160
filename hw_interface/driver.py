"""The driver: the gate that trajectories must pass, and the player that commands exactly their samples.

    idle ──accepted──▶ moving ──last sample──▶ idle
                         │ stop request or trouble
                         ▼
                      stopping ──at rest──▶ stopped | reflex ──acknowledged──▶ idle

Nothing restarts by itself: whatever ended a motion early stays latched until somebody acknowledges it.
"""

import logging
import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from control.certificate import Certificate
from control.errors import RefusedError, StackError
from control.on_path_stop import stop_on_path
from control.trajectory import SAMPLE_TIME, Trajectory
from hw_interface.backend import Measured, RobotBackend
from hw_interface.gate import Gate
from hw_interface.messages import Accepted, Mode, RobotState, Trouble
from hw_interface.motion_messages import MotionResult
from hw_interface.supervisor import SupervisionLimits, Supervisor

LOG = logging.getLogger(__name__)
TRACE_EVERY = 10  # samples between two rows of a motion's record: 100 rows a second
RESULTS_KEPT = 16


@dataclass
class _Motion:
    """The motion that is being played."""

    trajectory: Trajectory
    serial: str
    supervisor: Supervisor
    started: float
    gripper_at: dict[int, int]  # sample -> index of its gripper event
    sample: int = 0  # next to command
    played: int = 0  # of the trajectory itself, without the samples of a stop
    ticks: int = 0
    stop_q: np.ndarray | None = None
    stop_qd: np.ndarray | None = None
    stop_sample: int = 0
    stop_mode: Mode = "stopped"
    trouble: Trouble | None = None
    max_tracking_error: float = 0.0
    rows: list[tuple[float, np.ndarray, np.ndarray, np.ndarray, float]] = field(default_factory=list)


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
        self._motion: _Motion | None = None
        self._serial: str | None = None
        self._progress = (0, 0)
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

    def submit(self, trajectory: Trajectory, certificate: Certificate | None) -> Accepted:
        """Accept a trajectory; the next tick commands its first sample.

        Raises:
            RefusedError: busy, needs_acknowledge, or what the gate refuses; nothing moves.
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
        motion = _Motion(
            trajectory,
            accepted.serial,
            Supervisor(trajectory, self._supervision),
            self._clock(),
            {round(e.time / SAMPLE_TIME): i for i, e in enumerate(trajectory.gripper)},
        )
        self._used.add(accepted.serial)
        self._motion, self._serial = motion, accepted.serial
        self._progress = (0, len(trajectory.q))
        self._mode = "moving"
        return Accepted(serial=accepted.serial, epoch=self.epoch, samples=len(trajectory.q))

    def stop(self) -> None:
        """Bring the arm to rest on its path, then stay until acknowledged. A robot at rest is latched, too."""
        if self._motion is None:
            if self._mode == "idle":
                self._mode = "stopped"
        elif self._motion.stop_q is None:
            self._begin_stop("stopped", None)

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
            tracking_error=self._tracking_error,
            cell=self.cell,
            profile=self.gate.profile,
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
        motion = self._motion
        if motion is None:
            return None
        motion.max_tracking_error = max(motion.max_tracking_error, self._tracking_error)
        if motion.ticks % TRACE_EVERY == 0:
            self._record(motion)
        motion.ticks += 1
        # While stopping the arm already does what trouble would make it do.
        if motion.stop_q is not None:
            return None
        return motion.supervisor.check(motion.sample, self._measured, self._tracking_error)

    def _react(self, trouble: Trouble) -> None:
        """Come to rest on the path and latch; a trouble at rest latches at once."""
        if self._motion is None:
            if self._trouble is None:
                LOG.error("%s: %s", trouble.code, trouble.reason)
                self._mode, self._trouble = "reflex", trouble
        elif self._motion.stop_q is None:
            LOG.error("%s: %s", trouble.code, trouble.reason)
            self._begin_stop("reflex", trouble)
        elif self._motion.trouble is None:
            self._motion.stop_mode, self._motion.trouble = "reflex", trouble

    def _begin_stop(self, then: Mode, trouble: Trouble | None) -> None:
        motion = self._motion
        assert motion is not None
        motion.stop_mode, motion.trouble = then, trouble
        self._mode = "stopping"
        try:
            stop = stop_on_path(motion.trajectory, max(0, motion.sample - 1), self.gate.robot_limits)
            motion.stop_q, motion.stop_qd = stop.q, stop.qd
        except Exception as error:
            LOG.exception("no stop on the path was found")
            self._hold(trouble or _internal(error))

    def _next(self) -> tuple[np.ndarray, np.ndarray]:
        """The next joint position and velocity to command; finishes the motion after its last one."""
        motion = self._motion
        if motion is None:
            return self._q_d, self._at_rest
        if motion.stop_q is not None and motion.stop_qd is not None:
            k = motion.stop_sample
            if k < len(motion.stop_q):
                motion.stop_sample += 1
                return motion.stop_q[k], motion.stop_qd[k]
            self._finish(motion, motion.stop_mode)
            return self._q_d, self._at_rest
        k = motion.sample
        if k >= len(motion.trajectory.q):
            self._finish(motion, "idle")
            return self._q_d, self._at_rest
        event = motion.gripper_at.get(k)
        if event is not None:
            self._backend.gripper(motion.trajectory.gripper[event].command)
        motion.sample = motion.played = k + 1
        self._progress = (k + 1, len(motion.trajectory.q))
        return motion.trajectory.q[k], motion.trajectory.qd[k]

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

    def _record(self, motion: _Motion) -> None:
        m = self._measured
        motion.rows.append((motion.ticks * SAMPLE_TIME, self._q_d, m.q, m.tau, m.gripper_width))

    def _finish(self, motion: _Motion, mode: Mode) -> None:
        self._motion = None
        self._mode, self._trouble = mode, motion.trouble
        self._record(motion)
        times, q_d, q, tau, width = (np.array(column, float) for column in zip(*motion.rows, strict=True))
        self._results[motion.serial] = MotionResult(
            serial=motion.serial,
            outcome="completed" if mode == "idle" else "stopped" if mode == "stopped" else "reflex",
            trouble=motion.trouble,
            samples=len(motion.trajectory.q),
            played=motion.played,
            started=motion.started,
            finished=self._clock(),
            max_tracking_error=motion.max_tracking_error,
            times=times,
            q_d=q_d,
            q=q,
            tau=tau,
            gripper_width=width,
        )
        while len(self._results) > RESULTS_KEPT:
            del self._results[next(iter(self._results))]


def _internal(error: Exception) -> Trouble:
    kind = "" if isinstance(error, StackError) else f"{type(error).__name__}: "
    return Trouble(code="internal_error", reason=f"fault in the driver, position is held: {kind}{error}"[:2000])
