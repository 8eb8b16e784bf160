"""The driver of a robot that is commanded from this process: plays exactly a trajectory's samples, one a tick.

At a speed below 1 it commands exactly their path, by a slower clock. What it accepts and when it stops for good is
the same for every robot side (`hw_interface.cell.robot_state_machine`).
"""

import time
from collections.abc import Callable

import numpy as np

from control.safety.certificate import Certificate
from control.trajectory.samples import Trajectory
from hw_interface.cell.backend import RobotBackend
from hw_interface.cell.gate import Gate
from hw_interface.cell.motion_monitor import MonitorLimits
from hw_interface.cell.played_motion import PlayedMotion
from hw_interface.cell.robot_state_machine import RobotStateMachine, internal_trouble
from hw_interface.messages.robot import Trouble


class Driver(RobotStateMachine[PlayedMotion]):
    """One robot's driver; its tick is one millisecond of robot time.

    Args:
        backend: The robot.
        gate, cell, monitor_limits, clock: As for `RobotStateMachine`.
    """

    def __init__(
        self,
        backend: RobotBackend,
        gate: Gate,
        cell: str,
        monitor_limits: MonitorLimits | None = None,
        clock: Callable[[], float] = time.time,
    ) -> None:
        measured = backend.read()
        super().__init__(gate, cell, measured, measured.q, monitor_limits, clock)
        self._backend = backend
        self._at_rest = np.zeros_like(self._q_d)

    def tick(self) -> None:
        """One millisecond of robot time: measure, monitor, command. Never raises."""
        try:
            self._measured = self._backend.read()
            self._tracking_error = float(np.abs(self._measured.q - self._q_d).max())
            trouble = self._monitored()
            self._faults.pop("measuring", None)
        except Exception as error:
            self._log_fault("measuring", error)
            trouble = internal_trouble(error)
        if trouble is not None:
            self._react(trouble)
        try:
            q_d, qd_d = self._next()
            self._backend.command(q_d, qd_d)
            self._q_d = q_d
            self._faults.pop("commanding", None)
        except Exception as error:
            self._log_fault("commanding", error)
            self._hold(internal_trouble(error))

    def _make_motion(self, trajectory: Trajectory, certificate: Certificate, speed: float) -> PlayedMotion:
        return PlayedMotion(trajectory, certificate.serial, speed, self.gate, self._monitor_limits, self._clock())

    def _bring_to_rest(self, motion: PlayedMotion) -> None:
        motion.stop(self.gate.robot_limits)

    def _monitored(self) -> Trouble | None:
        if self._motion is None:
            return None
        return self._motion.check(self._q_d, self._measured, self._tracking_error)

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
        super()._hold(trouble)
        try:
            self._backend.command(self._q_d, self._at_rest)
            self._faults.pop("holding", None)
        except Exception as error:
            self._log_fault("holding", error)
