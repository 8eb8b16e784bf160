"""The motion that a driver is playing: where it is, at which speed, and what is written down about it."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from control.errors import RefusedError, TrajectoryError
from control.robot.limits import RobotLimits
from control.trajectory.on_path_stop import stop_on_path
from control.trajectory.playback import RATE, Playback
from control.trajectory.samples import SAMPLE_TIME, GripperCommand, Trajectory
from control.trajectory.speed_override import check_length, override_speed
from hw_interface.cell.backend import Measured
from hw_interface.cell.gate import Gate
from hw_interface.cell.motion_monitor import MonitorLimits, MotionMonitor
from hw_interface.cell.motion_record import MotionRecord
from hw_interface.messages.motions import MotionResult, Outcome
from hw_interface.messages.robot import Mode, Trouble


class PlayedMotion:
    """A certified trajectory on its way through a driver.

    Whatever the speed, its progress, gripper events and what the monitor expects count the trajectory's samples.

    Args:
        trajectory: What the gate has let pass.
        serial: Of its certificate.
        speed: Share of its own speed to play it at.
        gate: Limits to hold that against.
        monitor_limits: Where to stop.
        started: Time on the robot's clock in [s].

    Attributes:
        stop_mode: Mode to end in when `stopping`.
        trouble: Why the robot stops it, or None.

    Raises:
        RefusedError: too_slow, or breaks_limit at that speed.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        serial: str,
        speed: float,
        gate: Gate,
        monitor_limits: MonitorLimits,
        started: float,
    ) -> None:
        with refusing_plan("too_slow"):
            check_length(len(trajectory.q) - 1, speed)
        self._playback = Playback.of(trajectory, speed)
        if speed != 1.0:
            gate.check_limits(self._playback.as_trajectory())
        self.serial = serial
        self.samples = len(trajectory.q)
        self.stopping = False
        self.stop_mode: Mode = "stopped"
        self.trouble: Trouble | None = None
        self._monitor = MotionMonitor(trajectory, monitor_limits)
        self._record = MotionRecord(serial, self.samples, started)
        self._events = list(trajectory.gripper)  # to be given
        self._row = 0  # of the playback, next to command

    @property
    def _last(self) -> int:
        """Row that was commanded last; before the first, the one where the arm stands already."""
        return max(0, self._row - 1)

    @property
    def played(self) -> int:
        """Samples of the trajectory that were commanded or passed."""
        return self._playback.sample(self._last) + 1 if self._row > 0 else 0

    @property
    def speed(self) -> float:
        """Share of the trajectory's own speed that was commanded last."""
        return float(self._playback.clock[self._last, RATE]) if self._row > 0 else 0.0

    def check(self, q_d: np.ndarray, measured: Measured, tracking_error: float) -> Trouble | None:
        """Write down what is measured; why to stop now, or None.

        Args:
            q_d: Last command in [rad], shape (7,).
            measured: What the robot measures.
            tracking_error: Largest joint difference between the two in [rad].
        """
        self._record.observe(q_d, measured, tracking_error, self.speed)
        # While stopping the arm already does what trouble would make it do.
        if self.stopping:
            return None
        return self._monitor.check(self._playback.sample(self._row), measured, tracking_error)

    def next_command(self) -> tuple[np.ndarray, np.ndarray, GripperCommand | None] | None:
        """Joint positions in [rad], velocities in [rad/s] and gripper command of this millisecond; None at the end."""
        playback, row = self._playback, self._row
        if self._monitor.waiting and not self.stopping:
            return playback.q[self._last], np.zeros_like(playback.qd[self._last]), None
        if row >= len(playback.q):
            return None
        command = None
        due = round(self._events[0].time / SAMPLE_TIME) if self._events and not self.stopping else None
        if due is not None and playback.sample(row) >= due:
            command = self._events.pop(0).command
        self._row += 1
        return playback.q[row], playback.qd[row], command

    def change_speed(self, speed: float, gate: Gate) -> None:
        """Play the rest at another share of its own speed.

        Args:
            speed: Above 0 and at most 1.
            gate: Limits to hold the result against before it is played.

        Raises:
            RefusedError: busy, too_slow, no_ramp or breaks_limit; the speed stays as it was.
        """
        if self.stopping:
            raise RefusedError("busy", "the robot is stopping; set the speed when it rests")
        with refusing_plan("too_slow"):
            check_length(self.samples - self.played, speed, self._last)
        with refusing_plan("no_ramp"):
            playback = override_speed(self._playback, self._last, speed, gate.playing_limits, gate.torque)
        gate.check_limits(playback.as_trajectory())
        self._playback = playback

    def stop(self, limits: RobotLimits) -> None:
        """Come to rest on the path within these limits, then end."""
        self._playback = stop_on_path(self._playback, self._last, limits)

    def result(self, outcome: Outcome, q_d: np.ndarray, measured: Measured, now: float) -> MotionResult:
        """What became of it.

        Args:
            outcome: How it ended.
            q_d: Last command in [rad], shape (7,).
            measured: What the robot measures.
            now: Time on the robot's clock in [s].
        """
        return self._record.result(outcome, self.trouble, self.played, q_d, measured, self.speed, now)


@contextmanager
def refusing_plan(code: str) -> Iterator[None]:
    """Turn what a plan cannot do into a refusal."""
    try:
        yield
    except TrajectoryError as error:
        raise RefusedError(code, str(error)) from error
