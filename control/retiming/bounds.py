"""What one segment of a motion is held to: published limits at the shares that may be used, speeds slowed down."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from control.robot.limits import RobotLimits, VelocityEnds
from control.safety.limits import SafetyLimits

# Shares of accelerations (a fifth of it of speeds) and of torque rates that a motion leaves unused. A motion that was
# slowed down and goes back to its own speed is commanded between its samples, where it reaches a little beyond them:
# without headroom it could not go back at all while it accelerates. It costs a thousandth of the time.
HEADROOM, TORQUE_RATE_HEADROOM = 0.005, 0.035


@dataclass(frozen=True)
class MotionBounds:
    """Bounds of one segment; joint arrays have shape (7,).

    Attributes:
        qd, qdd, qddd: Joint speed, acceleration and jerk in [rad/s], [rad/s^2], [rad/s^3].
        tau, taud: Joint torque and its rate in [Nm], [Nm/s].
        hand: Speed, acceleration and jerk of the tool centre point in [m/s], [m/s^2], [m/s^3].
        turn: The same of the hand's rotation in [rad/s], [rad/s^2], [rad/s^3].
        ends: How joint speed falls off towards the ends of the joints, or None; `speed_share` applies to it as well.
        speed_share: Share of the published joint speeds that `qd` is.
    """

    qd: NDArray[np.float64]
    qdd: NDArray[np.float64]
    qddd: NDArray[np.float64]
    tau: NDArray[np.float64]
    taud: NDArray[np.float64]
    hand: tuple[float, float, float]
    turn: tuple[float, float, float]
    ends: VelocityEnds | None
    speed_share: float

    @classmethod
    def of(cls, limits: RobotLimits, safety: SafetyLimits, speed_scale: float) -> "MotionBounds":
        """Bounds of a segment.

        Args:
            limits: Published limits of the robot.
            safety: Shares of them that may be used, and the hand's speeds.
            speed_scale: Slows all speeds down further, 0..1; accelerations stay.
        """
        share, acceleration = safety.velocity_scale * speed_scale, safety.acceleration_scale
        return cls(
            qd=limits.qd * share,
            qdd=limits.qdd * acceleration,
            qddd=limits.qddd,
            tau=limits.tau,
            taud=limits.taud,
            hand=(
                min(safety.hand_speed, limits.cartesian_speed) * speed_scale,
                limits.cartesian_acceleration * acceleration,
                limits.cartesian_jerk,
            ),
            turn=(
                min(safety.hand_angular_speed, limits.angular_speed) * speed_scale,
                limits.angular_acceleration * acceleration,
                limits.angular_jerk,
            ),
            ends=limits.velocity_ends,
            speed_share=share,
        )

    def with_headroom(self) -> "MotionBounds":
        """A little less of what a change of speed needs some of: see `HEADROOM`."""
        less, slower = 1.0 - HEADROOM, 1.0 - HEADROOM / 5.0
        return replace(
            self,
            qd=self.qd * slower,
            qdd=self.qdd * less,
            taud=self.taud * (1.0 - TORQUE_RATE_HEADROOM),
            hand=(self.hand[0] * slower, self.hand[1] * less, self.hand[2]),
            turn=(self.turn[0] * slower, self.turn[1] * less, self.turn[2]),
        )

    def joint_speed(self, q: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Largest speeds in [rad/s] at joint positions in [rad] for motion in a direction (its sign), all (n, 7)."""
        if self.ends is None:
            return np.broadcast_to(self.qd, q.shape)
        upper, lower = self.ends.largest(q)
        return np.minimum(self.qd, self.speed_share * np.where(direction >= 0.0, upper, lower))
