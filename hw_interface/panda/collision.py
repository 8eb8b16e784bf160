"""From which torques and forces on the control box stops by itself, for each part of a motion.

The box compares its estimates of external joint torques and of the force on the hand with a lower threshold (a contact
is reported) and an upper one (a reflex). Parts in which fingers or a held thing are meant to touch something get more
room than free ones, where any touch is an accident.

Sources: franka::Robot::setCollisionBehavior in libfranka's documentation; its examples use 20 Nm and 20 N for free
motion, and estimates of a Panda at rest err by a few newtons.
"""

from dataclasses import dataclass

from hw_interface.panda.parts import Part


@dataclass(frozen=True)
class CollisionThresholds:
    """Upper thresholds; lower ones are half of them.

    Attributes:
        torque: Of each joint in [Nm].
        force: On the hand along each axis in [N].
        moment: About each axis in [Nm].
    """

    torque: tuple[float, ...]
    force: float
    moment: float

    def as_arguments(self) -> tuple[list[float], list[float], list[float], list[float]]:
        """Lower and upper torques (7 each), lower and upper forces (6 each), as libfranka takes them."""
        upper, wrench = list(self.torque), [self.force] * 3 + [self.moment] * 3
        return [t / 2.0 for t in upper], upper, [w / 2.0 for w in wrench], wrench


FREE = CollisionThresholds((25.0, 25.0, 22.0, 20.0, 18.0, 16.0, 14.0), force=25.0, moment=25.0)
HANDLING = CollisionThresholds((40.0, 40.0, 36.0, 36.0, 30.0, 28.0, 24.0), force=45.0, moment=30.0)


def thresholds(part: Part) -> CollisionThresholds:
    """The thresholds of a part.

    `HANDLING` allows what the verdict allows: fingers and held things may press with 40 N (`pressing_force`).
    """
    return HANDLING if part.handling or part.held or part.gripper is not None else FREE
