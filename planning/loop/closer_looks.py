"""Which things have to be seen better before a motion handles them: what is known of them against what it tolerates.

With s the largest horizontal spread of a thing's place, 2 s must not exceed

    a thing to be grasped   (o - w) / 2 - c
    what carries it         w / 2 - e

with the gripper's opening o, the thing's own least horizontal size w, the fingers' clearance c and the edge e of a
carrier beside which things tip; what is wider than the opening is taken by a handle, if at all. A spread of `LEAST` is
tolerated in any case: closing fingers centre what they take. Nor may anything speak against the thing's estimate.
"""

from dataclasses import dataclass

import numpy as np

from control.robot.gripper import GripperModel
from control.safety.limits import SafetyLimits
from control.tasks.posed_object import EDGE_MARGIN
from control.tasks.reward_spec import RewardSpec
from control.tasks.subtasks import read_subtask
from perception.estimates import ObjectEstimate, SceneEstimate

LEAST = 0.005  # [m]
SPREADS = 2.0


@dataclass(frozen=True)
class Doubted:
    """A thing that has to be seen better.

    Attributes:
        name: Which.
        why: In words.
    """

    name: str
    why: str


def doubted_things(
    spec: RewardSpec, scene: SceneEstimate, gripper: GripperModel, safety: SafetyLimits, held: str | None = None
) -> tuple[Doubted, ...]:
    """Things that a motion for a spec would handle without knowing them well enough.

    Args:
        spec: Of the motion.
        scene: What is known.
        gripper: On the hand.
        safety: For the fingers' clearance.
        held: What is in the hand already.
    """
    task = read_subtask(spec)
    out = []
    grasped = scene.get(task.subject) if task.subject and task.subject != held else None
    if grasped is not None and not grasped.joint_fractions:
        room = (gripper.opening - float(np.min(grasped.extents[:2]))) / 2 - safety.finger_clearance
        if room >= 0.0:
            out += _doubts(grasped, "grasp", max(room, LEAST))
    carrier = scene.get(task.target) if task.target and task.manipulation == "place" else None
    if carrier is not None and not carrier.joint_fractions:
        room = float(np.min(carrier.extents[:2])) / 2 - EDGE_MARGIN
        out += _doubts(carrier, "placement", max(room, LEAST))
    return tuple(out)


def _doubts(thing: ObjectEstimate, what: str, tolerated: float) -> list[Doubted]:
    spread = SPREADS * float(np.max(thing.position_std[:2]))
    if spread > tolerated:
        why = f"its place is known to {spread * 1e3:.0f} mm only, and the {what} tolerates {tolerated * 1e3:.0f} mm"
        return [Doubted(thing.name, why)]
    if thing.doubts:
        return [Doubted(thing.name, "; ".join(thing.doubts))]
    return []
