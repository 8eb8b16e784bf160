"""What a reward spec asks the hand to do: one manipulation, read from the primary term alone.

The primary term decides which object is handled and where the motion ends; the other terms only shape the cost. No
name of a scene or task enters here.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from control.tasks.failure import FailureCause
from control.tasks.posed_object import Inside, PosedObject
from control.tasks.reward_spec import RewardSpec, RewardTerm
from control.tasks.terms.definition import HandTask
from control.twin_model import ARM_JOINTS, TCP_SITE, TwinModel


@dataclass(frozen=True)
class Subtask(HandTask):
    """A spec made concrete.

    Attributes:
        term: The primary term.
    """

    term: RewardTerm


def read_subtask(spec: RewardSpec) -> Subtask:
    """The manipulation that a spec's primary term asks for."""
    term = spec.primary
    task = term.definition.asks_of_hand(term)
    return Subtask(task.manipulation, task.subject, task.target, task.amount, term)


def unseen(twin: TwinModel, spec: RewardSpec) -> FailureCause | None:
    """The first name of a spec that the twin does not have, as a `not_seen` cause that lists what was seen; or None."""
    for term in spec.terms:
        for name in term.names:
            if name in term.joints:
                if twin.joint(name) is None:
                    known = sorted(j.name for j in twin.joints)
                    return FailureCause("not_seen", name, f"no joint named '{name}' was seen; seen were {known}")
            elif twin.get(name) is None:
                seen = sorted(o.name for o in twin.objects)
                return FailureCause("not_seen", name, f"'{name}' has no pose; seen were {seen}")
    return None


def posed_objects(twin: TwinModel, data: mujoco.MjData) -> dict[str, PosedObject]:
    """The twin's objects where `data` has them (its kinematics must be up to date)."""
    out = {}
    for thing in twin.objects:
        body = data.body(thing.name)
        world_T_object = np.eye(4)
        world_T_object[:3, :3] = body.xmat.reshape(3, 3)
        world_T_object[:3, 3] = body.xpos
        out[thing.name] = posed(twin, thing.name, world_T_object)
    return out


def palm_at(twin: TwinModel, q: Sequence[float] | np.ndarray) -> np.ndarray:
    """Tool centre point in the world in [m] at arm joints q in [rad], shape (3,)."""
    data = mujoco.MjData(twin.model)
    data.qpos[:] = twin.qpos
    for name, value in zip(ARM_JOINTS, q, strict=True):
        data.qpos[twin.model.joint(name).qposadr[0]] = value
    mujoco.mj_kinematics(twin.model, data)
    return data.site(TCP_SITE).xpos.copy()


def posed(twin: TwinModel, name: str, world_T_object: np.ndarray) -> PosedObject:
    """One of the twin's objects at a pose (4, 4)."""
    thing = next(o for o in twin.objects if o.name == name)
    return PosedObject(
        name,
        world_T_object,
        np.asarray(thing.extents),
        thing.shape,
        thing.container,
        thing.inner_floor,
        thing.inner_radius,
        next((Inside(c.low, c.high, c.outward) for c in twin.compartments if c.owner == name), None),
    )
