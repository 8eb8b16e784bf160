"""minimize_l2_distance(a, b): a lies on b or in it, the palm is at b, or a is brought to the rest position."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from control.tasks.posed_object import EDGE_MARGIN, VERTICAL_TOLERANCE, Inside, PosedObject, half_heights
from control.tasks.terms.definition import (
    PALM,
    PLACES,
    REST_POSITION,
    HandTask,
    NameArgument,
    TermDefinition,
    brought,
)
from control.tasks.terms.lines import LineForm
from control.tasks.terms.maximize_distance import DISTANCE_TOLERANCE, MaximizeDistance
from control.tasks.terms.views import Layout, SampledMotions, SceneState, TermJudgement

if TYPE_CHECKING:
    from control.tasks.reward_spec import RewardTerm

NEAR_PALM = 0.03  # [m]


class MinimizeDistance(TermDefinition):
    """Two things together.

    Two objects: a lies at the nearest supported place at b: on top of b, or in a container b; where b is furniture with
    an inside, in there, on its floor. With p_a a's centre and p its place at b, in [m]:

    judged:  r = |(how far p_a is beyond what carries it, how far a's underside is from it beyond a tolerance)| in [m]
    costed:  r = p_a - p in [m], 3 components

    The palm and an object: with s the way from the surface of the object's box to the palm in [m]; judged, the
    object's handles count as its surface:

    judged:  r = max(0, |s| - `NEAR_PALM`) in [m]
    costed:  r = s in [m], 3 components

    The rest position and an object's centre, or the palm: likewise with s the way between the two points.
    """

    name = "minimize_l2_distance"
    names = (NameArgument("a", "place"), NameArgument("b", "place"))
    prompt = "brings a and b together"
    lines = (LineForm("close", "A is close to B"),)
    hand = (
        "puts a on b, or in it: a bowl, a cabinet with an open door. With `palm`: goes there, and stops before it. "
        "With `rest_position`: brings a there"
    )
    met = (
        f"a's centre is over what can carry it, {EDGE_MARGIN * 1e3:g} mm from its edge, and its underside within "
        f"{VERTICAL_TOLERANCE * 1e3:g} mm of its top or floor; in a container, within its opening. With `palm`: it is "
        f"within {NEAR_PALM * 1e3:g} mm of the surface of the object's box or of a handle. With `rest_position`: the "
        "centre is as near to it as that"
    )
    cost = (
        "r = p_a - p in [m]; p_a is a's centre, p its place on top of b, in the container b, or the nearest one inside "
        "the furniture b. With `palm`: its way from the surface of the object's box. With `rest_position`: the way "
        "from there to the centre"
    )
    conflicts = (
        "kept at a distance from the same thing, or from a neighbour that is nearer than that; one object at two "
        "places of which neither may hold the other; two objects on each other; two objects brought to the rest "
        "position"
    )

    def judge(self, term: RewardTerm, scene: SceneState) -> TermJudgement:
        """Of two objects by support, else by distance."""
        if not {*PLACES} & {term.subject, term.target}:
            return judge_placed(scene.objects[term.subject], scene.objects[str(term.target)])
        first, second = term.subject, str(term.target)
        if first in scene.objects:
            first, second = second, first
        point = scene.palm if first == PALM else scene.rest_palm
        if second in scene.objects:
            # Beside the palm an object counts with its surface; at the rest position, as a place, with its centre.
            body = scene.objects[second]
            distance = body.distance_to(point) if first == PALM else float(np.linalg.norm(body.position - point))
        else:
            distance = float(np.linalg.norm(scene.palm - scene.rest_palm))
        residual = max(0.0, distance - NEAR_PALM)
        return TermJudgement(residual == 0.0, residual, f"{first} is {distance * 1e3:.0f} mm from {second}")

    def residual_along(self, term: RewardTerm, motions: SampledMotions) -> np.ndarray:
        """The way that is left, shape (n, t, 3)."""
        first, second = term.subject, str(term.target)
        start, palm = motions.start, motions.palm
        if first in start and second in start:
            return _from_its_place(start[first], start[second], motions)
        if first in start:
            first, second = second, first
        if second not in start:
            return palm - motions.rest_palm
        centre, turn = motions.place(second)
        if first == REST_POSITION:
            return centre - motions.rest_palm
        local = np.einsum("ntji,ntj->nti", np.broadcast_to(turn, (*palm.shape[:2], 3, 3)), palm - centre)
        return np.maximum(np.abs(local) - np.asarray(start[second].extents) / 2, 0.0)

    def asks_of_hand(self, term: RewardTerm) -> HandTask:
        """Put one on the other; with the palm, go there; with the rest position, bring it there."""
        first, second = term.subject, term.target
        if first in PLACES and second in PLACES:
            return HandTask("rest", None, REST_POSITION, term.number)
        if PALM in (first, second):
            return HandTask("reach", None, second if first == PALM else first, term.number)
        if REST_POSITION in (first, second):
            return HandTask("bring", second if first == REST_POSITION else first, REST_POSITION, term.number)
        return HandTask("place", first, second, term.number)

    def excludes(self, term: RewardTerm, other: RewardTerm, layout: Layout) -> str:
        """Near and far, or two destinations."""
        if isinstance(other.definition, MaximizeDistance):
            return _near_and_far(term, other, layout.objects)
        if isinstance(other.definition, MinimizeDistance) and term.carries and other.carries:
            return _two_destinations(term, other, layout.objects)
        return ""

    def carries(self, term: RewardTerm) -> str | None:
        """Of two objects the first, beside the rest position the object, beside the palm none."""
        return brought(term)

    def handles(self, term: RewardTerm) -> str | None:
        """What it carries; with the palm, the first name."""
        return self.carries(term) or term.subject

    def approaches(self, term: RewardTerm) -> str | None:
        """What the palm is brought to."""
        if PALM not in (term.subject, term.target):
            return None
        return term.target if term.subject == PALM else term.subject


def judge_placed(a: PosedObject, b: PosedObject) -> TermJudgement:
    """Whether `a` rests on top of `b`, or in it when it is a container; r = sqrt(horizontal^2 + vertical^2) in [m]."""
    if b.inside is not None:
        return _judge_inside(a, b, b.inside)
    if b.container:
        horizontal = max(0.0, float(np.linalg.norm(a.position[:2] - b.position[:2])) - b.inner_radius)
        floor = b.bottom + b.inner_floor
        vertical = max(0.0, a.bottom - b.top, floor - VERTICAL_TOLERANCE - a.bottom)
        residual = float(np.hypot(horizontal, vertical))
        if residual == 0.0:
            return TermJudgement(True, 0.0, f"{a.name} is in {b.name}")
        return TermJudgement(
            False,
            residual,
            f"{a.name} is not in {b.name}: {horizontal * 1e3:.0f} mm outside its opening, "
            f"{vertical * 1e3:.0f} mm above its rim or below its floor",
        )
    horizontal = b.beyond_footprint(a.position, EDGE_MARGIN)
    gap = a.bottom - b.top
    residual = float(np.hypot(horizontal, max(0.0, abs(gap) - VERTICAL_TOLERANCE)))
    if residual == 0.0:
        return TermJudgement(True, 0.0, f"{a.name} is on {b.name}")
    return TermJudgement(
        False,
        residual,
        f"{a.name} is not on {b.name}: its centre is {horizontal * 1e3:.0f} mm beyond what can carry it, "
        f"its underside {gap * 1e3:+.0f} mm from the top",
    )


def _judge_inside(a: PosedObject, b: PosedObject, inside: Inside) -> TermJudgement:
    """In upright furniture: the centre between the walls and behind the opening, the underside on the floor."""
    local = b.pose[:3, :3].T @ (a.position - b.position)
    beyond = np.maximum(inside.low - local, 0.0) + np.maximum(local - inside.high, 0.0)
    horizontal = float(np.linalg.norm(beyond[:2]))
    gap = a.bottom - (float(b.position[2]) + float(inside.low[2]))
    residual = float(np.hypot(horizontal, max(0.0, abs(gap) - VERTICAL_TOLERANCE)))
    if residual == 0.0:
        return TermJudgement(True, 0.0, f"{a.name} is in {b.name}")
    return TermJudgement(
        False,
        residual,
        f"{a.name} is not in {b.name}: its centre is {horizontal * 1e3:.0f} mm outside, its underside "
        f"{gap * 1e3:+.0f} mm from the floor",
    )


def _from_its_place(a: PosedObject, b: PosedObject, motions: SampledMotions) -> np.ndarray:
    """Vector in [m] from an object's place on or in another one to its centre, shape (n, t, 3)."""
    centre, turn = motions.place(a.name)
    half = half_heights(a, turn)
    there, there_turn = motions.place(b.name)
    if b.inside is not None:
        return _to_inside(centre, half, there, there_turn, b.inside)
    height = half_heights(b, there_turn)
    rest = there[..., 2] - height + b.inner_floor if b.container else there[..., 2] + height
    goal = np.stack(np.broadcast_arrays(there[..., 0], there[..., 1], rest + half), axis=-1)
    return centre - goal


def _to_inside(centre: np.ndarray, half: np.ndarray, there: np.ndarray, turn: np.ndarray, inside: Inside) -> np.ndarray:
    """Vector in [m] from a centre to the nearest place on the floor of furniture's inside, in the furniture's axes."""
    local = np.einsum("ntji,ntj->nti", np.broadcast_to(turn, (*centre.shape[:2], 3, 3)), centre - there)
    nearest = np.clip(local, inside.low, inside.high)
    nearest[..., 2] = inside.low[2] + half
    return local - nearest


def _near_and_far(near: RewardTerm, far: RewardTerm, objects: Mapping[str, PosedObject]) -> str:
    """`near` brings something to a place that is within the distance that `far` keeps it from."""
    pair, distance = {near.subject, str(near.target)}, far.number
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
    first, second = a.destination, b.destination
    if a.carries == b.carries:
        if first == second:
            return ""
        if REST_POSITION not in (first, second) and any(_may_hold(objects.get(str(d))) for d in (first, second)):
            return ""
        return f"'{a.carries}' can be in one of these places only"
    if (a.carries, first) == (second, b.carries):
        return f"'{a.carries}' and '{b.carries}' cannot each lie on the other"
    if first == second == REST_POSITION:
        return f"the hand can hold one of '{a.carries}' and '{b.carries}' only"
    return ""


def _may_hold(thing: PosedObject | None) -> bool:
    """Whether what is on another thing can be inside this one as well; of an unknown thing nobody knows."""
    return thing is None or thing.container or thing.inside is not None
