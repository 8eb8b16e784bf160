"""What is written down while a motion is played, and what becomes of it. Needs numpy only."""

import numpy as np

from control.trajectory.samples import SAMPLE_TIME
from hw_interface.cell.backend import Measured
from hw_interface.messages.motions import MotionResult, Outcome
from hw_interface.messages.robot import Trouble

TRACE_EVERY = 10  # milliseconds between two rows of a motion's record: 100 rows a second


class MotionRecord:
    """The record of one motion.

    Args:
        serial: Of its certificate.
        samples: Samples of its trajectory.
        started: Time on the robot's clock in [s].
    """

    def __init__(self, serial: str, samples: int, started: float) -> None:
        self.serial = serial
        self.samples = samples
        self._started = started
        self._ticks = 0
        self._max_tracking_error = 0.0
        self._rows: list[tuple[float, np.ndarray, np.ndarray, np.ndarray, float, float]] = []

    def observe(self, q_d: np.ndarray, measured: Measured, tracking_error: float, speed: float) -> None:
        """A millisecond of the motion.

        Args:
            q_d: Last command in [rad], shape (7,).
            measured: What the robot measures.
            tracking_error: Largest joint difference between the two in [rad].
            speed: Share of the trajectory's own speed that was commanded.
        """
        self._max_tracking_error = max(self._max_tracking_error, tracking_error)
        if self._ticks % TRACE_EVERY == 0:
            self._write_down(q_d, measured, speed)
        self._ticks += 1

    def result(
        self,
        outcome: Outcome,
        trouble: Trouble | None,
        played: int,
        q_d: np.ndarray,
        measured: Measured,
        speed: float,
        now: float,
    ) -> MotionResult:
        """What became of the motion.

        Args:
            outcome, trouble: How and why it ended.
            played: Samples of the trajectory that were commanded or passed.
            q_d, measured, speed: As for `observe`, at the end.
            now: Time on the robot's clock in [s].
        """
        self._write_down(q_d, measured, speed)
        columns = zip(*self._rows, strict=True)
        times, commanded, q, tau, width, speeds = (np.array(column, float) for column in columns)
        return MotionResult(
            serial=self.serial,
            outcome=outcome,
            trouble=trouble,
            samples=self.samples,
            played=played,
            started=self._started,
            finished=now,
            max_tracking_error=self._max_tracking_error,
            times=times,
            q_d=commanded,
            q=q,
            tau=tau,
            gripper_width=width,
            speed=speeds,
        )

    def _write_down(self, q_d: np.ndarray, m: Measured, speed: float) -> None:
        self._rows.append((self._ticks * SAMPLE_TIME, np.array(q_d), m.q, m.tau, m.gripper_width, speed))
