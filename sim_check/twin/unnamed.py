"""What nobody named, in the twin: a body that a hand could move where that is sure enough, else a fixed obstacle."""

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from control.twin_model import ARM_BODIES, FINGER_BODIES, HAND_BODY, TABLE_BODY
from perception.estimates import ObjectEstimate
from sim_check.objects.library import ObjectModel, object_model
from sim_check.twin.settling import free_bodies

HAND_ROOM = 0.012  # [m] that the pads need besides what they close around
SURE_SIZE = 0.02  # [m]: spread of a size up to which fingers may be sent to it
LIGHT = 1.5e-3  # [m^3]: larger things are likely too heavy to be pushed about on a guess
DEEP = 0.003  # [m]: overlap up to which things are moved apart
# The box of an obstacle is on the safe side already, so it is varied by no more than this in [m].
FIXED_STD = 0.005


def model_of(estimate: ObjectEstimate, loose: bool) -> ObjectModel:
    """What stands for a perceived thing.

    Args:
        estimate: As perceived.
        loose: Whether it is a free body, if nobody named it; named things are what their nouns say.

    Raises:
        ConfigError: As `sim_check.objects.library.object_model` does.
    """
    thing = object_model(estimate.name, estimate.extents, estimate.shape)
    return thing if estimate.named else replace(thing, movable=loose)


def can_be_held(estimate: ObjectEstimate, opening: float) -> bool:
    """Whether fingers fit around a thing that nobody named, its sizes are known well enough, and it is no big one."""
    std = np.zeros(3) if estimate.extents_std is None else estimate.extents_std
    fits = float(np.min(estimate.extents[:2])) < opening - HAND_ROOM
    return fits and float(np.max(std)) < SURE_SIZE and float(np.prod(estimate.extents)) < LIGHT


def overlaps(model: mujoco.MjModel, deeper: float = DEEP) -> list[tuple[str, str]]:
    """Pairs of bodies, at least one of them free, that are inside each other as they are placed, table and robot apart.

    Args:
        model: Of a scene.
        deeper: By how much they must be, in [m].
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_collision(model, data)
    robot = {model.body(name).id for name in (TABLE_BODY, *ARM_BODIES, HAND_BODY, *FINGER_BODIES)}
    free, pairs = set(free_bodies(model)), set()
    for contact in data.contact[: data.ncon]:
        bodies = [int(model.geom_bodyid[g]) for g in contact.geom]
        names = tuple(sorted(model.body(b).name for b in bodies))
        if -float(contact.dist) > deeper and not robot & set(bodies) and free & set(names):
            pairs.add(names)
    return sorted(pairs)


def without_contacts_of(spec: mujoco.MjSpec, pairs: Sequence[tuple[str, str]]) -> mujoco.MjModel:
    """Compile a scene in which pairs of bodies ignore each other.

    An obstacle's box has margins. Where these reach into something that was seen beside it, neither is pushed away:
    the pair has no contacts, and each has those with everything else.

    Args:
        spec: The scene; exclusions are added to it.
        pairs: Names of bodies.
    """
    for first, second in pairs:
        spec.add_exclude(bodyname1=first, bodyname2=second)
    return spec.compile()
