"""What a motion needs to know of the gripper at the flange: how far it opens, how deep it reaches, how fast it is.

Frames, the same for every gripper:

    flange (panda_link8)   z out of the arm
    hand (panda_hand)      at the flange, turned by -45 degrees about its z as Franka mounts its hand; fingers move
                           along its y; a wrist camera's pose is given here
    tcp (panda_hand_tcp)   on the hand's z axis between the pads, axes as the hand's: z is the approach direction

Numbers of grippers that the robot's own description (its URDF) lacks stand here whole, masses included.
"""

from dataclasses import dataclass

import numpy as np

from control.errors import ConfigError

# The hand of the robot's own description: what Desk takes it to weigh (Franka Hand, product manual: 0.73 kg) and where
# the URDF has its tool centre point.
FRANKA_HAND_MASS = 0.73  # [kg]
FRANKA_HAND_TCP = 0.1034  # [m] from the flange along z
HAND_TURN = -np.pi / 4  # [rad] of the hand about the flange's z; the Panda's URDF


@dataclass(frozen=True)
class RigidPart:
    """Mass of one body, its axes those of the hand.

    Attributes:
        mass: In [kg].
        com: Centre of mass in the hand frame in [m], (x, y, z).
        inertia: Moments (ixx, iyy, izz) about the centre of mass in [kg m^2]; the products are zero.
    """

    mass: float
    com: tuple[float, float, float]
    inertia: tuple[float, float, float]


@dataclass(frozen=True)
class GripperMounting:
    """What takes the place of the hand in the robot's description.

    Attributes:
        tcp: Distance of the tool centre point from the flange along z in [m].
        base: Everything that does not move with a finger.
        finger: The finger at +y with the pads touching each other; the other one is its mirror image.
    """

    tcp: float
    base: RigidPart
    finger: RigidPart


@dataclass(frozen=True)
class GripperModel:
    """One gripper with two fingers that move in parallel.

    Attributes:
        name: As in a cell file.
        opening: Largest distance between the pads in [m].
        fingertip: Furthest that the fingertips reach past the tool centre point at any opening, along the approach,
            in [m].
        pad_reach: How far the pads reach past the tool centre point around anything that can be held, in [m].
        palm_room: From the tool centre point back to where an object comes too close to the palm, in [m].
        planned_speed: Of each finger in [m/s], as twins play a command.
        rated_speed: Of each finger in [m/s], as the robot moves its set point.
        pad_force: Most that each pad presses with in twins and simulated cells, in [N].
        least_force, most_force: Grasp force of each finger that can be asked for, in [N].
        mounting: What it weighs and where it reaches; None for the hand of the robot's own description.
    """

    name: str
    opening: float
    fingertip: float
    pad_reach: float
    palm_room: float
    planned_speed: float
    rated_speed: float
    pad_force: float
    least_force: float
    most_force: float
    mounting: GripperMounting | None = None

    def widest(self, clearance: float) -> float:
        """Widest object in [m] that open fingers go around with a clearance in [m] on either side."""
        return self.opening - 2 * clearance

    @property
    def mass(self) -> float:
        """What it weighs in [kg]."""
        return FRANKA_HAND_MASS if self.mounting is None else self.mounting.base.mass + 2 * self.mounting.finger.mass

    @property
    def tcp_distance(self) -> float:
        """Distance of the tool centre point from the flange along z in [m]."""
        return FRANKA_HAND_TCP if self.mounting is None else self.mounting.tcp

    @property
    def flange_T_tcp(self) -> np.ndarray:
        """Pose of the tool centre point at the flange, shape (4, 4)."""
        pose = np.eye(4)
        pose[:2, :2] = [[np.cos(HAND_TURN), -np.sin(HAND_TURN)], [np.sin(HAND_TURN), np.cos(HAND_TURN)]]
        pose[2, 3] = self.tcp_distance
        return pose

    @property
    def full_stroke(self) -> float:
        """Time in [s] from closed to open at the rated speed."""
        return self.opening / 2 / self.rated_speed


PANDA_HAND = GripperModel(
    name="panda_hand",
    opening=0.08,  # Franka Hand, product manual
    fingertip=0.0095,  # collision boxes of the URDF
    pad_reach=0.0095,
    palm_room=0.030,  # it is 37 mm to the palm, of which 7 mm are kept free
    planned_speed=0.05,  # the hand closes its 80 mm in about 0.8 s
    rated_speed=0.2,  # the Panda's URDF
    pad_force=40.0,  # Franka's usual grasp force
    least_force=0.0,
    most_force=70.0,  # Franka Hand, product manual: continuous force
)

# Robotiq 2F-85. Stroke 85 mm, 925 g (the coupling is counted in), grip force 20..235 N, finger speed 20..150 mm/s
# (taken as that of the distance between the pads, the slower reading), 162.8 mm from its base to the fingertips when
# closed: specifications in Robotiq's 2F-85 & 2F-140 instruction manual, and the 2F-85 profile of Robotiq's own SDK
# (robotiq/grippers). Pads 22 mm wide and 37.5 mm long, lengths of the links: ROS-Industrial's description of it. A
# coupling of 11 mm joins it to the flange.
#
# Its fingers hang on parallelograms of links L = 57.15 mm, so that their tips move on an arc: at a distance w between
# the pads they are sqrt(L^2 - (w / 2 + 7.8 mm - 12.7 mm)^2) past the knuckles' axes, which is 149.1 mm from the base
# when open and 163 mm when closed, 13.9 mm further (11.8 mm at w = 80 mm, 1.8 mm at 40 mm). Here they are LINEAR jaws
# at their furthest reach. So that this errs on the safe side, the tool centre point lies where the tips of widely
# open fingers still are: what lies between it and 25 mm nearer the palm is between the real pads at every width that
# can be held, `fingertip` keeps closed tips off the table, and `pad_reach` promises nothing past that point.
ROBOTIQ_COUPLING = 0.011  # [m] between flange and gripper
ROBOTIQ_TIP = ROBOTIQ_COUPLING + 0.163  # [m] from the flange to the tips of closed fingers
_REACH = 0.0125  # [m] from the tool centre point to these tips

ROBOTIQ_2F85 = GripperModel(
    name="robotiq_2f85",
    opening=0.085,
    fingertip=_REACH,
    pad_reach=0.0,
    palm_room=0.0325,  # it is 39.5 mm to the knuckles, of which 7 mm are kept free
    planned_speed=0.065,
    rated_speed=0.075,
    pad_force=40.0,
    least_force=20.0,
    most_force=235.0,
    mounting=GripperMounting(
        tcp=ROBOTIQ_TIP - _REACH,
        # 925 g shared out as in public models of it (0.06 kg of links and pads a side). Inertia of boxes of the parts'
        # sizes and of even density, a little more than that of the real ones, whose motor sits in the middle.
        base=RigidPart(0.805, (0.0, 0.0, 0.050), (9.7e-4, 8.7e-4, 7.6e-4)),
        finger=RigidPart(0.060, (0.0, 0.018, 0.140), (2.1e-5, 2.0e-5, 5.8e-6)),
    ),
)

GRIPPERS = {g.name: g for g in (PANDA_HAND, ROBOTIQ_2F85)}


def gripper_model(name: str) -> GripperModel:
    """The gripper of this name.

    Raises:
        ConfigError: There is none.
    """
    if name not in GRIPPERS:
        raise ConfigError(f"there is no gripper '{name}'; there are {sorted(GRIPPERS)}")
    return GRIPPERS[name]
