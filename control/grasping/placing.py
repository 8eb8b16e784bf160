"""Places that the arm can really reach with an object in the hand: lowering, letting go and leaving are free."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from control.grasping.door_swings import door_swings
from control.grasping.picking import BACK_OFF, LEAST_DOWN, SPARE_OPENING, ReadyGrasp, turn_asked
from control.grasping.placements import RELEASE_GAP, Placement, away_from, on_or_in
from control.grasping.retreat import LIFT
from control.grasping.side_grasps import ROLLED_DROP
from control.path_planning.collision_filter import Phase
from control.path_planning.planning_context import PlanningContext, other_terms, straight_targets
from control.robot.limits import REST_Q, RobotLimits
from control.robot.rotations import rolled
from control.tasks.posed_object import PosedObject
from control.tasks.predicates import judge_term

ABOVE_FLOOR = 0.03  # [m] between a shelf and the object that is brought in over it
BEFORE_OPENING = 0.12  # [m] in front of an opening where the object's centre is brought to first
ABOVE_RIM = 0.02  # [m] between a container's rim and the object brought over it
NARROW_OPENING = 0.010  # [m] beyond the object: the least release
LEVEL_HAND = 0.35  # downward part of the approach direction of a hand that cannot put things on a table
HEADINGS = 8  # of a thing that is turned over, about the vertical
AT_ONE_SPOT = 12  # places that are offered together
AT_ONCE = 60  # combinations that are checked together; more only where none of them is free


@dataclass(frozen=True)
class ReadyPlace:
    """A way to put the object down that the arm can reach.

    Attributes:
        placement: Where the object goes.
        lower: From above the place down to it, shape (n, 7).
        leave: From the place outwards after the release, shape (m, 7).
        opening: Distance between the pads after the release in [m].
    """

    placement: Placement
    lower: NDArray[np.float64]
    leave: NDArray[np.float64]
    opening: float


def offered_places(context: PlanningContext, ready: list[ReadyGrasp]) -> list[Placement]:
    """Poses in which the subject would meet the primary term, best first.

    Args:
        context: Surroundings of the search.
        ready: How it can be taken: what only a level hand takes has to be rolled until the hand points down.
    """
    body = context.objects[str(context.subtask.subject)]
    attitudes = [replace(body, pose=pose) for pose in _attitudes(context, body, ready)]
    offered = [_places_of(context, a) for a in attitudes]
    if len(attitudes) > 1:
        offered = [[_raised(p, ROLLED_DROP) for p in places] for places in offered]
    # All attitudes at one spot before the next spot.
    longest = max(map(len, offered))
    turns = max(1, AT_ONE_SPOT // len(offered))
    mixed = [p for first in range(0, longest, turns) for places in offered for p in places[first : first + turns]]
    return _meeting_others(context, body, mixed if len(offered) > 1 else offered[0])


def _raised(place: Placement, by: float) -> Placement:
    pose = place.world_T_object.copy()
    pose[2, 3] += by
    return replace(place, world_T_object=pose)


def _meeting_others(context: PlanningContext, body: PosedObject, places: list[Placement]) -> list[Placement]:
    """Those places at which the spec's other terms about the subject hold as well."""
    others = [t for t in other_terms(context) if t.definition.turns_by(t) is None]
    if not others:
        return places
    out = []
    for place in places:
        there = {**context.objects, body.name: replace(body, pose=place.world_T_object)}
        judged = [
            judge_term(t, there, context.rest_palm, context.rest_palm, context.objects, context.twin.support_height)
            for t in others
        ]
        if all(j.residual <= RELEASE_GAP + ROLLED_DROP for j in judged):
            out.append(place)
    return out


def _places_of(context: PlanningContext, body: PosedObject) -> list[Placement]:
    """The same for one attitude of the subject."""
    task = context.subtask
    if task.manipulation == "place":
        places = on_or_in(body, context.objects[str(task.target)], context.rng)
        return sorted(places, key=lambda p: p.preference)
    others = [o for name, o in context.objects.items() if name != task.subject]
    if task.manipulation == "turn":  # near where it stands, on the table, in any heading
        turns = np.arange(HEADINGS) * 2 * np.pi / HEADINGS
        height = context.twin.support_height
        return away_from(body, body.position, -np.inf, others, context.safety, height, context.rng, turns=turns)
    at = context.objects[str(task.target)].position if task.target in context.objects else context.rest_palm
    distance = task.amount
    height, swings = context.twin.support_height, door_swings(context.twin)
    return away_from(body, at, distance, others, context.safety, height, context.rng, swings=swings, owner=task.target)


def _attitudes(context: PlanningContext, body: PosedObject, ready: list[ReadyGrasp]) -> list[np.ndarray]:
    """Poses of the subject where it is, in the attitudes in which it may be put down."""
    turn = turn_asked(context)
    if turn is not None:
        return [rolled(body.pose, 0, turn)]
    thing = context.twin.get(body.name)
    has_handle = thing is not None and thing.handle is not None
    down = [-(body.pose @ np.linalg.inv(g.held.tcp_T_object))[2, 2] for g in ready]
    if body.shape != "box" or body.container or has_handle or max(down, default=1.0) > LEVEL_HAND:
        return [body.pose]
    upright = int(np.argmax(np.abs(body.pose[2, :3])))
    longest = max((i for i in range(3) if i != upright), key=lambda i: body.extents[i])
    return [rolled(body.pose, longest, angle) for angle in (np.pi / 2, -np.pi / 2)] + [body.pose]


def ready_pairs(
    context: PlanningContext, ready: list[ReadyGrasp], places: list[Placement]
) -> list[tuple[int, ReadyPlace]]:
    """Combinations of a grasp (its index) and a place that the arm reaches freely, least joint motion first."""
    index: list[tuple[int, int]] = []
    targets, seeds = [], []
    for i, grasp in enumerate(ready):
        object_T_tcp = np.linalg.inv(grasp.held.tcp_T_object)
        lifted = context.filter.tcp_pose(grasp.lift[-1])
        for j, place in enumerate(places):
            target = place.world_T_object @ object_T_tcp
            if -target[2, 2] < LEAST_DOWN:
                continue
            index.append((i, j))
            targets.append(target)
            seeds.append(_swung(grasp.lift[-1], lifted, target, context.limits))
    if not index:
        return []
    if turn_asked(context) is not None:  # the hand ends in quite another posture
        owners, solutions = context.solve(np.array(targets))
    else:
        owners, solutions = context.solve_from(np.array(targets), np.array(seeds))
    context.counts["places_reachable"] += len(owners)
    out: list[tuple[int, ReadyPlace]] = []
    effort = [
        float(np.abs(q - ready[index[k][0]].lift[-1]).max() + 0.3 * np.abs(q - REST_Q).max())
        for k, q in zip(owners, solutions, strict=True)
    ]
    order = np.argsort(effort, kind="stable")
    for first in range(0, len(order), AT_ONCE):
        out = _free_pairs(context, ready, places, index, targets, owners, solutions, order[first : first + AT_ONCE])
        if out:
            break
    context.counts["places_free"] += len(out)
    return out


def _free_pairs(
    context: PlanningContext,
    ready: list[ReadyGrasp],
    places: list[Placement],
    index: list[tuple[int, int]],
    targets: list[np.ndarray],
    owners: np.ndarray,
    solutions: np.ndarray,
    chosen: np.ndarray,
) -> list[tuple[int, ReadyPlace]]:
    """Those of the chosen combinations that are free while lowering, opening and leaving."""
    owners, solutions = owners[chosen], solutions[chosen]
    rises = [_way_up(context, places[index[k][1]], targets[k]) for k in owners]
    leaves = [_way_back(context, places[index[k][1]], targets[k]) for k in owners]
    up, ok_up = context.follow(solutions, rises)
    back, ok_back = context.follow(solutions, leaves)
    out = []
    for n in np.flatnonzero(ok_up):
        i, j = index[owners[n]]
        place = _free_place(context, ready[i], places[j], solutions[n], up[n], back[n] if ok_back[n] else None)
        if place is not None:
            out.append((i, place))
    return out


def _way_up(context: PlanningContext, place: Placement, target: np.ndarray) -> np.ndarray:
    """Poses of the tool from a place to where the object is brought to first, shape (n, 4, 4)."""
    out = _way_out(context, place)
    if out is None:
        return straight_targets(target, np.array([0.0, 0.0, _rise(context, place)]))
    up = straight_targets(target, np.array([0.0, 0.0, ABOVE_FLOOR]))
    return np.vstack([up, straight_targets(up[-1], out)])


def _way_back(context: PlanningContext, place: Placement, target: np.ndarray) -> np.ndarray:
    """Poses of the tool from a place backwards after the release, shape (n, 4, 4); out of furniture altogether."""
    out = _way_out(context, place)
    back = straight_targets(target, -BACK_OFF * target[:3, 2])
    return back if out is None else np.vstack([back, straight_targets(back[-1], out)])


def _way_out(context: PlanningContext, place: Placement) -> np.ndarray | None:
    """From a place in furniture through its opening and a hand's depth further in [m], shape (3,); else None."""
    task = context.subtask
    owner = context.objects[str(task.target)] if task.manipulation == "place" else None
    if owner is None or owner.inside is None:
        return None
    outward = owner.pose[:3, :3] @ owner.inside.outward
    inside, local = owner.inside, owner.pose[:3, :3].T @ (place.world_T_object[:3, 3] - owner.position)
    edge = np.where(inside.outward < 0, inside.low, inside.high)
    return outward * (float((edge - local) @ inside.outward) + BEFORE_OPENING)


def _rise(context: PlanningContext, place: Placement) -> float:
    """How far above its place the object is brought in [m]: clear of a container's rim."""
    task = context.subtask
    if task.manipulation == "place" and context.objects[str(task.target)].container:
        subject = replace(context.objects[str(task.subject)], pose=place.world_T_object)
        return max(LIFT, context.objects[str(task.target)].top - subject.bottom + ABOVE_RIM)
    return LIFT


def _free_place(
    context: PlanningContext,
    grasp: ReadyGrasp,
    place: Placement,
    q: np.ndarray,
    up: np.ndarray,
    back: np.ndarray | None,
) -> ReadyPlace | None:
    """Check lowering, opening and leaving at one place."""
    check = context.filter
    if not check.clear(q, Phase.CONTACT, grasp.width, grasp.held):
        return None
    if not check.clear(up[-1], Phase.CARRY, grasp.width, grasp.held):
        return None
    if not check.path_clear(up[:-1], Phase.CONTACT, grasp.width, grasp.held):
        return None
    at, widest = place.world_T_object, context.twin.gripper.opening
    for opening in (widest, min(widest, grasp.width + SPARE_OPENING), grasp.width + NARROW_OPENING):
        if not check.clear(q, Phase.GRASP, opening, at):
            continue
        for leave in [back, up] if back is not None else [up]:
            if check.clear(leave[-1], Phase.FREE, opening, at) and check.path_clear(
                leave[:-1], Phase.GRASP, opening, at
            ):
                return ReadyPlace(place, np.vstack([up[::-1], q[None]]), np.vstack([q[None], leave]), opening)
    return None


def _swung(q: np.ndarray, tcp: np.ndarray, target: np.ndarray, limits: RobotLimits) -> np.ndarray:
    """A seed for a pose elsewhere: the same posture turned about the base, the hand turned back about its own axis."""
    seed = q.copy()
    swing = np.arctan2(target[1, 3], target[0, 3]) - np.arctan2(tcp[1, 3], tcp[0, 3])
    seed[0] += swing
    # What the turn of the base does not give, the last joint has to.
    heading = np.arctan2(target[1, 1], target[0, 1]) - np.arctan2(tcp[1, 1], tcp[0, 1])
    seed[6] -= (heading - swing + np.pi) % (2 * np.pi) - np.pi
    for joint in (0, 6):
        low, high = limits.q_min[joint] + 0.05, limits.q_max[joint] - 0.05
        if seed[joint] < low and seed[joint] + 2 * np.pi < high:
            seed[joint] += 2 * np.pi
        if seed[joint] > high and seed[joint] - 2 * np.pi > low:
            seed[joint] -= 2 * np.pi
    return np.clip(seed, limits.q_min + 0.05, limits.q_max - 0.05)
