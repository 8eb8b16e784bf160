"""What a motion needs to know of the gripper at the flange: how far it opens, how deep it reaches, how fast it is.

Frame of the tool centre point, for every gripper: between the pads, z out of the hand (the approach direction), y the
direction in which the fingers move.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class GripperModel:
    """One gripper with two fingers that move in parallel.

    Attributes:
        name: As in a cell file.
        opening: Largest distance between the pads in [m].
        fingertip: How far the fingertips reach past the tool centre point, along the approach, in [m].
        palm_room: From the tool centre point back to where an object comes too close to the palm, in [m].
        planned_speed: Of each finger in [m/s], as twins play a command.
        rated_speed: Of each finger in [m/s], as the robot moves its set point.
        least_force, most_force: Grasp force of each finger that can be asked for, in [N].
    """

    name: str
    opening: float
    fingertip: float
    palm_room: float
    planned_speed: float
    rated_speed: float
    least_force: float
    most_force: float

    def widest(self, clearance: float) -> float:
        """Widest object in [m] that open fingers go around with a clearance in [m] on either side."""
        return self.opening - 2 * clearance


PANDA_HAND = GripperModel(
    name="panda_hand",
    opening=0.08,  # Franka Hand, product manual
    fingertip=0.0095,  # collision boxes of the URDF
    palm_room=0.030,  # it is 37 mm to the palm, of which 7 mm are kept free
    planned_speed=0.05,  # the hand closes its 80 mm in about 0.8 s
    rated_speed=0.2,  # the Panda's URDF
    least_force=0.0,
    most_force=70.0,  # Franka Hand, product manual: continuous force
)
