"""What a robot may do: limits of position, velocity, acceleration, jerk, torque. Needs numpy only."""

from dataclasses import dataclass, replace

import numpy as np

from control.gripper import PANDA_HAND, GripperModel

JOINT_NAMES = tuple(f"panda_joint{i}" for i in range(1, 8))
REST_Q = (0.0, -0.785398, 0.0, -2.356194, 0.0, 1.570796, 0.785398)  # Franka's "ready" pose, in [rad]


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
    """

    profile: str
    firmware: str
    q_min: np.ndarray
    q_max: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    qddd: np.ndarray
    tau: np.ndarray
    taud: np.ndarray
    cartesian_speed: float
    cartesian_acceleration: float
    cartesian_jerk: float
    angular_speed: float
    angular_acceleration: float
    angular_jerk: float

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
    """Published limits of the Franka Emika Panda (interface version 5).

    The profile names a gripper that is not the Panda's own hand, so that nothing planned for one gripper is played
    with another.

    Source: Franka Control Interface documentation, "Robot and interface specifications", Panda.
    """
    return RobotLimits(
        profile="panda/5" if gripper == PANDA_HAND else f"panda/5+{gripper.name}",
        firmware="panda system 4.2.1 and later 4.x, research interface 5",
        q_min=np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]),
        q_max=np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]),
        qd=np.array([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61]),
        qdd=np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]),
        qddd=np.array([7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0]),
        tau=np.array([87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0]),
        taud=np.full(7, 1000.0),
        cartesian_speed=1.7,
        cartesian_acceleration=13.0,
        cartesian_jerk=6500.0,
        angular_speed=2.5,
        angular_acceleration=25.0,
        angular_jerk=12500.0,
    )
