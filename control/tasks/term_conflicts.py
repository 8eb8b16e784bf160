"""Terms of one reward spec that cannot hold together, found before any search.

The motion search reads the primary term and lets the others shape the cost, so it would happily meet one of two terms
that exclude each other. What is found here needs no simulation: some of it the terms alone say, some of it sizes and
places in the twin.

    same pair           near b, or on it, and at least d from b
    same joint          at two fractions further apart than both tolerances
    same turn           of one object by two angles, likewise
    two destinations    a on b and a on c, or on b and held in the air; unless one of b, c holds the other
    stacked both ways   a on b and b on a
    height              a held at height z and put down where its centre stays below z
    neighbours          near b and at least d from c, though b and c are nearer to each other than that
    two in the hand     two objects that both have to be held at the end

Terms about the palm beside a primary term about an object are meant for the way there (`control.tasks.motion_cost`):
they are held at different times and exclude nothing.
"""

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from control.errors import ContradictionError
from control.tasks.predicates import (
    DISTANCE_TOLERANCE,
    FRACTION_TOLERANCE,
    HEIGHT_TOLERANCE,
    NEAR_PALM,
    TURN_TOLERANCE,
    VERTICAL_TOLERANCE,
    PosedObject,
)
from control.tasks.reward_spec import PALM, REST_POSITION, RewardSpec, RewardTerm
from control.tasks.subtasks import posed_objects
from control.twin_model import TwinModel

_NEAR, _FAR = "minimize_l2_distance", "maximize_l2_distance"


def refuse_term_conflicts(spec: RewardSpec, twin: TwinModel | None = None) -> None:
    """Raise when two terms of a spec cannot both be met.

    Args:
        spec: What to achieve.
        twin: For sizes and places; without it only what the terms alone say is found.

    Raises:
        ContradictionError: Two terms exclude each other; the message names both and says why.
    """
    objects = {} if twin is None else posed_objects(twin, twin.start())
    table = None if twin is None else twin.support_height
    about_palm = PALM in (spec.primary.subject, spec.primary.target)
    lasting = [t for t in spec.terms if about_palm or PALM not in (t.subject, t.target)]
    for a, b in combinations(lasting, 2):
        why = _excluded(a, b, objects, table) or _excluded(b, a, objects, table)
        if why:
            raise ContradictionError(
                f"{a.text} and {b.text} cannot both be met: {why}; leave one of them out, or ask for one after the "
                "other"
            )


def _excluded(a: RewardTerm, b: RewardTerm, objects: Mapping[str, PosedObject], table: float | None) -> str:
    """Why two terms, in this order, exclude each other; "" where they do not."""
    if a.kind == b.kind == "set_joint_fraction":
        return _two_fractions(a, b)
    if a.kind == b.kind == "set_obj_orientation":
        return _two_turns(a, b)
    if a.kind == _NEAR and b.kind == _FAR:
        return _near_and_far(a, b, objects)
    if a.kind == b.kind == _NEAR and a.carries and b.carries:
        return _two_destinations(a, b, objects)
    if a.kind == "set_obj_z_position" and b.carries == a.subject:
        return _held_above(a, b, objects, table)
    if a.kind == b.kind == "set_obj_z_position" and a.subject != b.subject:
        return _two_lifted(a, b, objects)
    if a.kind == "set_obj_z_position" and b.kind == _NEAR and REST_POSITION in (b.subject, b.target):
        return _two_lifted(a, b, objects) if b.carries and b.carries != a.subject else ""
    return ""


def _two_fractions(a: RewardTerm, b: RewardTerm) -> str:
    apart = abs(float(a.value or 0.0) - float(b.value or 0.0))
    if a.subject != b.subject or apart <= 2 * FRACTION_TOLERANCE:
        return ""
    return f"'{a.subject}' can stand at one fraction only"


def _two_turns(a: RewardTerm, b: RewardTerm) -> str:
    apart = abs((float(a.value or 0.0) - float(b.value or 0.0) + np.pi) % (2 * np.pi) - np.pi)
    if a.subject != b.subject or apart <= 2 * TURN_TOLERANCE:
        return ""
    return f"'{a.subject}' can be turned by one angle only"


def _near_and_far(near: RewardTerm, far: RewardTerm, objects: Mapping[str, PosedObject]) -> str:
    """`near` brings something to a place that is within the distance that `far` keeps it from."""
    pair, distance = {near.subject, str(near.target)}, float(far.value or 0.0)
    other = {far.subject, str(far.target)}
    if pair == other:
        return f"being at '{near.target}' is being nearer than {distance:g} m to it"
    shared = pair & other
    if len(shared) != 1:
        return ""
    goes = next(iter(shared))
    to, away = next(iter(pair - shared)), next(iter(other - shared))
    # Only what stays where it is can be measured: a place that something is brought to, not one that is brought itself.
    if goes not in (near.carries, PALM) or to not in objects or away not in objects:
        return ""
    reach = float(np.linalg.norm(np.asarray(objects[to].extents)[:2])) / 2 + (NEAR_PALM if goes == PALM else 0.0)
    apart = float(np.linalg.norm((objects[to].position - objects[away].position)[: 3 if goes == PALM else 2]))
    if apart + reach >= distance - DISTANCE_TOLERANCE:
        return ""
    return f"'{to}' is {apart:.2f} m from '{away}', so nothing at '{to}' is {distance:g} m away from it"


def _two_destinations(a: RewardTerm, b: RewardTerm, objects: Mapping[str, PosedObject]) -> str:
    """Two terms that bring things somewhere: one thing to two places, two things onto each other or into the hand."""
    first, second = _destination(a), _destination(b)
    if a.carries == b.carries:
        if first == second:
            return ""
        if REST_POSITION not in (first, second) and any(_may_hold(objects.get(d)) for d in (first, second)):
            return ""
        return f"'{a.carries}' can be in one of these places only"
    if (a.carries, first) == (second, b.carries):
        return f"'{a.carries}' and '{b.carries}' cannot each lie on the other"
    if first == second == REST_POSITION:
        return f"the hand can hold one of '{a.carries}' and '{b.carries}' only"
    return ""


def _held_above(lift: RewardTerm, put: RewardTerm, objects: Mapping[str, PosedObject], table: float | None) -> str:
    """A height that the thing does not have where the other term puts it down."""
    thing, height = objects.get(lift.subject), float(lift.value or 0.0)
    if thing is None or table is None:
        return ""
    if put.kind == _FAR:
        top, where = table + VERTICAL_TOLERANCE, "on the table"
    else:
        to = objects.get(_destination(put))
        if to is None:
            return ""
        # Inside furniture a thing ends lower than on its top, in a bowl about as low as its rim: a bound from above.
        top, where = to.top + VERTICAL_TOLERANCE, f"at '{to.name}'"
    # As it stands or on its longest side: the highest that its centre can be.
    centre = top + float(np.max(thing.extents)) / 2
    if centre >= height - HEIGHT_TOLERANCE:
        return ""
    return f"put down {where}, the centre of '{thing.name}' is no higher than {centre:.2f} m, not {height:g} m"


def _two_lifted(a: RewardTerm, b: RewardTerm, objects: Mapping[str, PosedObject]) -> str:
    """Two things that have to be in the hand at the end; one that stands high enough need not be."""
    for term in (a, b):
        if term.kind != "set_obj_z_position":
            continue
        thing = objects.get(term.subject)
        if thing is None or float(thing.position[2]) >= float(term.value or 0.0) - HEIGHT_TOLERANCE:
            return ""
    first, second = a.carries or a.subject, b.carries or b.subject
    return f"the hand can hold one of '{first}' and '{second}' only"


def _destination(term: RewardTerm) -> str:
    return str(term.target if term.carries == term.subject else term.subject)


def _may_hold(thing: PosedObject | None) -> bool:
    """Whether what is on another thing can be inside this one as well; of an unknown thing nobody knows."""
    return thing is None or thing.container or thing.inside is not None
