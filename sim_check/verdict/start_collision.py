"""What the robot is inside of before it has moved at all."""

import numpy as np

from control.path_planning.collision_filter import CollisionFilter, Phase
from control.safety.limits import SafetyLimits
from control.twin_model import ARM_JOINTS, TwinModel
from sim_check.verdict.clearances import ClearanceMeter

# Overlap in [m] at the start that is no collision: soft contacts of things at rest give way by less, and perception
# knows surfaces no better.
START_OVERLAP = 0.002
NO_CLEARANCE = SafetyLimits(self_clearance=0.0, arm_clearance=0.0, held_clearance=0.0, finger_clearance=0.0)


def start_collision(twin: TwinModel, q: np.ndarray | None = None) -> tuple[tuple[str, str], float] | None:
    """The deepest overlap of the robot with the world, with an object or with itself, at the start.

    What the hand holds may touch the fingers and what carries it; links that are joined overlap by construction.

    Args:
        twin: Built by `build_twin`; its objects are where they settled.
        q: Arm joints of the trajectory's first sample in [rad], shape (7,); the twin's own by default.

    Returns:
        The two bodies, the robot's part first, and how deep they are inside each other in [m]; None where no overlap
        exceeds `START_OVERLAP`.
    """
    qpos = np.array(twin.qpos)
    if q is not None:
        qpos[[int(twin.model.joint(name).qposadr[0]) for name in ARM_JOINTS]] = q
    look = CollisionFilter(twin, NO_CLEARANCE, twin.held, margin=0.0)
    near = ClearanceMeter(look, Phase.GRASP, reach=1e-6).at(qpos)
    worst = min((near[part] for part in ("self", "arm", "finger")), key=lambda n: n.distance)
    if worst.distance > -START_OVERLAP:
        return None
    return (worst.nearest[0], worst.nearest[1]), -worst.distance
