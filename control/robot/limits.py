"""What a robot may do: limits of position, velocity, acceleration, jerk, torque. Needs numpy only.

The numbers stand in the files of profiles/, which `control.robot.profiles` reads.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from control.robot.gripper import PANDA_HAND, GripperModel

JOINT_NAMES = tuple(f"panda_joint{i}" for i in range(1, 8))
REST_Q = (0.0, -0.785398, 0.0, -2.356194, 0.0, 1.570796, 0.785398)  # Franka's "ready" pose, in [rad]


@dataclass(frozen=True)
class VelocityEnds:
    """How far a joint may go at what speed: towards its end it must be able to brake in time.

        upper(q) = max(0, -offset + sqrt(max(0, 2 deceleration (q_high - q))))
        lower(q) = max(0, -offset + sqrt(max(0, 2 deceleration (q - q_low))))

    are the largest speeds upwards and downwards, where they are below the joint's speed limit. Within
    offset^2 / (2 deceleration) of an end a joint must not move towards it at all.

    Source: Franka Control Interface documentation, "Control Interface Specification and Robot Limits",
    position-based velocity limits of the Franka Research 3.

    Attributes:
        q_low, q_high: Where braking has to end, in [rad], shape (7,).
        offset: Speed kept in reserve in [rad/s], shape (7,).
        deceleration: Braking that is counted on in [rad/s^2], shape (7,).
    """

    q_low: NDArray[np.float64]
    q_high: NDArray[np.float64]
    offset: NDArray[np.float64]
    deceleration: NDArray[np.float64]

    def largest(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Largest speeds upwards and downwards in [rad/s] at positions in [rad], both of the shape of q, (..., 7)."""
        upper = np.sqrt(np.maximum(2.0 * self.deceleration * (self.q_high - q), 0.0)) - self.offset
        lower = np.sqrt(np.maximum(2.0 * self.deceleration * (q - self.q_low), 0.0)) - self.offset
        return np.maximum(upper, 0.0), np.maximum(lower, 0.0)


@dataclass(frozen=True)
class RobotLimits:
    """Limits of one robot profile; joint arrays have shape (7,).

    Attributes:
        profile: Name and interface version that the numbers belong to.
        firmware: Family of robot system versions that enforce these numbers.
        q_min, q_max: Joint positions in [rad].
        qd: Joint speeds in [rad/s].
        qdd: Joint accelerations in [rad/s^2].
        qddd: Joint jerks in [rad/s^3].
        tau: Joint torques in [Nm].
        taud: Torque rates in [Nm/s].
        cartesian_speed, cartesian_acceleration, cartesian_jerk: Of the hand in [m/s], [m/s^2], [m/s^3].
        angular_speed, angular_acceleration, angular_jerk: Of the hand in [rad/s], [rad/s^2], [rad/s^3].
        velocity_ends: How joint speeds fall off towards the ends of the joints; None where they do not.
    """

    profile: str
    firmware: str
    q_min: NDArray[np.float64]
    q_max: NDArray[np.float64]
    qd: NDArray[np.float64]
    qdd: NDArray[np.float64]
    qddd: NDArray[np.float64]
    tau: NDArray[np.float64]
    taud: NDArray[np.float64]
    cartesian_speed: float
    cartesian_acceleration: float
    cartesian_jerk: float
    angular_speed: float
    angular_acceleration: float
    angular_jerk: float
    velocity_ends: VelocityEnds | None = None

    def scaled(self, velocity: float, acceleration: float) -> "RobotLimits":
        """The same robot at shares (0..1) of its speed and acceleration limits; the others stay as published."""
        return replace(
            self,
            qd=self.qd * velocity,
            qdd=self.qdd * acceleration,
            cartesian_speed=self.cartesian_speed * velocity,
            cartesian_acceleration=self.cartesian_acceleration * acceleration,
            angular_speed=self.angular_speed * velocity,
            angular_acceleration=self.angular_acceleration * acceleration,
        )


def panda_limits(gripper: GripperModel = PANDA_HAND) -> RobotLimits:
    """Published limits of the Franka Emika Panda (profile "panda/5" of `control.robot.profiles`)."""
    from control.robot.profiles import load_profile  # it reads files, which needs more than numpy

    return load_profile("panda/5", gripper)
