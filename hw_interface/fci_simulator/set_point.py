"""Where the control box wants the arm to be: follows commands, carries on through lost packets, brakes to rest."""

import numpy as np

from control.robot.limits import RobotLimits
from control.trajectory.samples import SAMPLE_TIME


class SetPoint:
    """Desired joint positions and their derivatives, advanced by one millisecond a call.

    Derivatives are backward differences: dq_d[k] = (q_d[k] - q_d[k-1]) / dt, ddq_d[k] = (dq_d[k] - dq_d[k-1]) / dt.

    Args:
        q: Where to begin, at rest, in [rad], shape (7,).

    Attributes:
        q, dq, ddq: Desired position [rad], velocity [rad/s], acceleration [rad/s^2], shape (7,).
    """

    def __init__(self, q: np.ndarray) -> None:
        self.rest(q)

    def rest(self, q: np.ndarray) -> None:
        """Stand still at q."""
        self.q, self.dq, self.ddq = np.array(q, float), np.zeros(7), np.zeros(7)

    def derivatives(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Velocity, acceleration and jerk that being at q one millisecond from now means."""
        dq = (q - self.q) / SAMPLE_TIME
        ddq = (dq - self.dq) / SAMPLE_TIME
        return dq, ddq, (ddq - self.ddq) / SAMPLE_TIME

    def follow(self, q: np.ndarray) -> None:
        """Be at q one millisecond from now."""
        dq = (q - self.q) / SAMPLE_TIME
        self.ddq = (dq - self.dq) / SAMPLE_TIME
        self.q, self.dq = np.array(q), dq

    def extrapolated(self) -> np.ndarray:
        """Where a lost packet is taken to lead: on with constant acceleration.

        Source: Franka Control Interface documentation, "Robot limits": when a packet is lost, the control box assumes
        a constant acceleration (libfranka's `rate_limiting.h` says the same).
        """
        return self.q + (self.dq + self.ddq * SAMPLE_TIME) * SAMPLE_TIME

    def moving_at(self, q: np.ndarray, dq: np.ndarray) -> None:
        """Take over a measured motion, to brake it."""
        self.q, self.dq, self.ddq = np.array(q, float), np.array(dq, float), np.zeros(7)

    def brake(self, limits: RobotLimits) -> bool:
        """Brake every joint for one millisecond with its largest acceleration; returns whether the arm rests now."""
        step = limits.qdd * SAMPLE_TIME
        dq = np.sign(self.dq) * np.maximum(np.abs(self.dq) - step, 0.0)
        self.ddq = (dq - self.dq) / SAMPLE_TIME
        self.q = np.clip(self.q + dq * SAMPLE_TIME, limits.q_min, limits.q_max)
        self.dq = dq
        if dq.any():
            return False
        self.ddq = np.zeros(7)
        return True
