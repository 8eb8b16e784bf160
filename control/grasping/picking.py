"""Grasps that the arm can really reach: free on the way in, around the object, and on its way out.

There are three manners of taking something. The usual one keeps well off everything; things with a handle are taken by
it as well. Only where it finds nothing, hands are tried that come between close walls: more directions, higher holds,
fingers that open less; and where that is not enough, a smaller planning margin on the last stretch. At last a level
hand takes the object from the side. All keep the clearances of the safety table.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from control.grasping.grasps import BETWEEN_WALLS, USUAL, Grasp, grasps
from control.grasping.retreat import WayOut, ways_out
from control.grasping.side_grasps import grasps_by_handle, grasps_from_the_side
from control.path_planning.collision_filter import CollisionFilter, Held, Phase
from control.path_planning.planning_context import PlanningContext, other_terms, straight_targets
from control.robot.limits import REST_Q
from control.robot.rotations import rolled
from control.tasks.posed_object import PosedObject
from control.trajectory.samples import FINGERS, GripperCommand, PathSegment

BACK_OFF = 0.10  # [m] between pre-grasp and grasp
SPARE_OPENING = 0.022  # [m] that fingers open beyond an object where they cannot open fully
# The same between close walls, in steps down to what the finger clearance on either side leaves.
NARROWER_OPENINGS = (0.022, 0.016, 0.012, 0.009)
LEAST_SPARE = 0.002  # [m] that an opening is wider than an object and its finger clearances: errors of its width
NARROW_WEIGHT = 20.0  # [rad/m], of fingers that open less than fully, in the choice between close walls
MOST_READY = 24  # grasps that are looked for; more would only be joined with the same places
ASIDE_WEIGHT = 20.0  # [rad/m], of a grasp off the object's middle
LEAST_DOWN = 0.2  # least downward part of the approach direction where an object is put down
OUT_WEIGHT = 5.0  # [rad/m], of a way out that is longer than the shortest one
SLOW, MEDIUM = 0.4, 0.7  # shares of the allowed speed near contacts


@dataclass(frozen=True)
class ReadyGrasp:
    """A grasp that the arm can reach without touching anything else.

    Attributes:
        grasp: Which one; None when the object is in the hand already.
        q: Arm at the grasp in [rad], shape (7,).
        arrive: From pre-grasp to grasp, shape (n, 7); empty when the object is in the hand.
        lift: From grasp upwards, or out of what the object stands in, shape (m, 7).
        held: How the object lies in the hand.
        opening: Distance between the pads on the way in, in [m].
        width: Distance between the pads around the object in [m].
    """

    grasp: Grasp | None
    q: NDArray[np.float64]
    arrive: NDArray[np.float64]
    lift: NDArray[np.float64]
    held: Held
    opening: float
    width: float

    @property
    def text(self) -> str:
        """For people."""
        return self.grasp.text if self.grasp else "already in the hand"


def ready_grasps(context: PlanningContext) -> list[ReadyGrasp]:
    """Up to `MOST_READY` reachable, free grasps of the subject from which it can be lifted; least motion first."""
    subject = str(context.subtask.subject)
    body = context.objects[subject]
    if context.twin.held == subject:
        return [_already_held(context, body)]
    outs = ways_out(context)
    out = _usual(context, body, outs)
    if not out and context.counts["grasps_reachable"]:
        out = _between_walls(context, body, outs)
    if not out:
        out = _from_the_side(context, body, outs)
    context.counts["grasps_free"] += len(out)
    return out


@dataclass(frozen=True)
class _Ways:
    """Grasps that the arm reaches along straight ways in and out; row by row.

    Attributes:
        grasps: Which grasps.
        q: Arm at the grasp in [rad], shape (n, 7).
        outwards: From the grasp to the pre-grasp, n arrays of shape (k, 7).
        upwards: From the grasp to where the object has come free, n arrays of shape (m, 7).
        efforts: Lower is better, shape (n,).
    """

    grasps: list[Grasp]
    q: NDArray[np.float64]
    outwards: list[np.ndarray]
    upwards: list[np.ndarray]
    efforts: NDArray[np.float64]


def _usual(context: PlanningContext, body: PosedObject, outs: list[WayOut]) -> list[ReadyGrasp]:
    """Least effort first, with fully open fingers wherever there is room."""
    offered = grasps(body, context.safety, context.twin.support_height, USUAL, context.twin.gripper)
    thing = context.twin.get(body.name)
    if thing is not None and thing.handle is not None:
        offered += grasps_by_handle(thing.handle, body.pose)
    return _easiest(context, body, _ways(context, body, offered, outs), context.filter)


def _from_the_side(context: PlanningContext, body: PosedObject, outs: list[WayOut]) -> list[ReadyGrasp]:
    """With one finger above and one below, where there is room for the hand."""
    offered = grasps_from_the_side(body, context.safety, context.twin.gripper)
    if not offered:
        return []
    ways = _ways(context, body, offered, outs)
    out = _easiest(context, body, ways, context.filter)
    if not out:
        near = context.near_filter()
        out = _easiest(context, body, ways, near)
        context.filter.checks += near.checks
    return out


def _easiest(context: PlanningContext, body: PosedObject, ways: _Ways, near: CollisionFilter) -> list[ReadyGrasp]:
    """Up to `MOST_READY` of some ways that are free, least effort first; `near` judges next to the grasp."""
    widest = context.twin.gripper.opening
    out: list[ReadyGrasp] = []
    for i in np.argsort(ways.efforts, kind="stable"):
        openings = (widest, min(widest, ways.grasps[i].width + SPARE_OPENING))
        ready = _ready(context, body, ways, int(i), openings, near)
        out += [ready] if ready else []
        if len(out) == MOST_READY:
            break
    return out


def _between_walls(context: PlanningContext, body: PosedObject, outs: list[WayOut]) -> list[ReadyGrasp]:
    """With the whole planning margin where that finds something, else with the small one next to the grasp."""
    offered = grasps(body, context.safety, context.twin.support_height, BETWEEN_WALLS, context.twin.gripper)
    ways = _ways(context, body, offered, outs)
    context.counts["looks_between_walls"] += 1
    out = _roomiest(context, body, ways, context.filter)
    if not out:
        near = context.near_filter()
        context.counts["looks_between_walls"] += 1
        out = _roomiest(context, body, ways, near)
        context.filter.checks += near.checks
    return out


def _roomiest(context: PlanningContext, body: PosedObject, ways: _Ways, check: CollisionFilter) -> list[ReadyGrasp]:
    """Least effort first, where fingers that open less count as effort: these may touch what is wider than it seems."""
    widest = context.twin.gripper.opening
    least = 2 * context.safety.finger_clearance + LEAST_SPARE
    spares = [s for s in NARROWER_OPENINGS if s > least] + [least]
    rows: list[tuple[float, int, tuple[float, ...]]] = []
    for i, grasp in enumerate(ways.grasps):
        openings = (widest, *(grasp.width + s for s in spares if grasp.width + s < widest))
        free = tuple(o for o in openings if check.clear(ways.q[i], Phase.GRASP, o))
        if free:
            rows.append((ways.efforts[i] + NARROW_WEIGHT * (widest - free[0]), i, free))
    out: list[ReadyGrasp] = []
    for _, i, openings in sorted(rows):
        ready = _ready(context, body, ways, i, openings, check)
        out += [ready] if ready else []
        if len(out) == MOST_READY:
            break
    return out


def _ways(context: PlanningContext, body: PosedObject, offered: list[Grasp], outs: list[WayOut]) -> _Ways:
    """Of some grasps those that the arm reaches, comes to, and from which it follows a way out, in straight lines."""
    offered = [g for g in offered if _points_down_later(context, body, g)]
    context.counts["grasps"] += len(offered)
    owners, solutions = context.solve(np.array([g.world_T_tcp for g in offered]).reshape(-1, 4, 4))
    context.counts["grasps_reachable"] += len(set(owners.tolist()))
    chosen = [offered[i] for i in owners]
    outwards, ok = context.follow(solutions, [straight_targets(g.world_T_tcp, -BACK_OFF * g.approach) for g in chosen])
    rows = [(int(i), out) for out in outs for i in np.flatnonzero(ok)]
    upwards, followed = context.follow(
        np.array([solutions[i] for i, _ in rows]).reshape(-1, 7),
        [out.targets(chosen[i].world_T_tcp) for i, out in rows],
    )
    kept = np.flatnonzero(followed)
    context.counts["grasps_followed"] += len(kept)
    shortest = min(out.length for out in outs)
    efforts = [
        _effort(context, solutions[rows[k][0]], chosen[rows[k][0]], body) + OUT_WEIGHT * (rows[k][1].length - shortest)
        for k in kept
    ]
    return _Ways(
        [chosen[rows[k][0]] for k in kept],
        np.array([solutions[rows[k][0]] for k in kept]).reshape(-1, 7),
        [outwards[rows[k][0]] for k in kept],
        [upwards[k] for k in kept],
        np.array(efforts),
    )


def turn_asked(context: PlanningContext) -> float | None:
    """By how much in [rad] the subject has to be turned about its own x axis, or None where nothing asks for it."""
    asked = (t.definition.turns_by(t) for t in (context.subtask.term, *other_terms(context)))
    return next((angle for angle in asked if angle is not None), None)


def _points_down_later(context: PlanningContext, body: PosedObject, grasp: Grasp) -> bool:
    """Whether the hand still points downwards when the object has been turned over in it, where that is asked for."""
    turn = turn_asked(context)
    if turn is None:
        return True
    turned = rolled(body.pose, 0, turn)[:3, :3]
    return bool((turned @ body.pose[:3, :3].T @ grasp.approach)[2] < -LEAST_DOWN)


def _ready(
    context: PlanningContext, body: PosedObject, ways: _Ways, i: int, openings: tuple[float, ...], near: CollisionFilter
) -> ReadyGrasp | None:
    """One grasp with the first of some openings that is free all the way in and up; `near` judges next to the grasp."""
    grasp, q, outwards = ways.grasps[i], ways.q[i], ways.outwards[i]
    opening = next((o for o in openings if _way_in_clear(context, q, outwards, o, near)), None)
    if opening is None:
        return None
    held = Held(np.linalg.inv(grasp.world_T_tcp) @ body.pose)
    lift = np.vstack([q[None], ways.upwards[i]])
    if not context.filter.clear(lift[-1], Phase.CARRY, grasp.width, held):
        return None
    if not near.path_clear(lift, Phase.RETREAT, grasp.width, held):
        return None
    return ReadyGrasp(grasp, q, np.vstack([outwards[::-1], q[None]]), lift, held, opening, grasp.width)


def reach_path(context: PlanningContext, grasp: ReadyGrasp, planner: bool = False) -> np.ndarray | None:
    """From the start to the pre-grasp, shape (n, 7); the start alone where the object is in the hand already."""
    if grasp.grasp is None:
        return context.start_q[None]
    width = max(context.twin.gripper_width, grasp.opening)
    return context.way(context.start_q, grasp.arrive[0], Phase.FREE, width, None, planner)


def pick_segments(context: PlanningContext, grasp: ReadyGrasp, reach: np.ndarray) -> list[PathSegment]:
    """Reach, approach, grasp and lift; only the lift where the object is in the hand already."""
    subject = str(context.subtask.subject)
    touching = tuple((subject, s) for s in context.supports)
    if grasp.grasp is None:
        return [PathSegment("lift", grasp.lift, None, subject, touching, MEDIUM)] if len(grasp.lift) > 1 else []
    opens, at = abs(grasp.opening - context.twin.gripper_width) > 0.002, ((subject, FINGERS),)
    return [
        PathSegment("reach", reach, GripperCommand("move", grasp.opening) if opens else None),
        PathSegment("approach", grasp.arrive, GripperCommand("grasp", grasp.width), None, at, MEDIUM),
        PathSegment("lift", grasp.lift, None, subject, touching, MEDIUM),
    ]


def diverse(ready: list[ReadyGrasp], count: int) -> list[ReadyGrasp]:
    """The first `count`, preferring ones whose approach or closing direction is new."""
    fresh: list[ReadyGrasp] = []
    similar: list[ReadyGrasp] = []
    seen: list[np.ndarray] = []
    for g in ready:
        if g.grasp is None:
            return [g]
        key = np.concatenate([g.grasp.approach, g.grasp.world_T_tcp[:3, 1]])
        if any(np.linalg.norm(key - k) < 0.3 for k in seen):
            similar.append(g)
        else:
            seen.append(key)
            fresh.append(g)
    return [*fresh, *similar][:count]


def _already_held(context: PlanningContext, body: PosedObject) -> ReadyGrasp:
    tcp = context.filter.tcp_pose(context.start_q)
    lift = context.start_q[None]
    if context.supports:  # it still stands on something: take it off first
        for out in ways_out(context):
            up, ok = context.follow(context.start_q[None], [out.targets(tcp)])
            if ok[0]:
                lift = np.vstack([lift, up[0]])
                break
    context.counts["grasps"] += 1
    context.counts["grasps_free"] += 1
    width = context.twin.gripper_width
    held = Held(np.linalg.inv(tcp) @ body.pose)
    return ReadyGrasp(None, context.start_q, np.zeros((0, 7)), lift, held, width, width)


def _way_in_clear(
    context: PlanningContext, q: np.ndarray, outwards: np.ndarray, opening: float, near: CollisionFilter
) -> bool:
    """Whether the hand can come to a grasp with this opening; the pre-grasp is a free posture like any other."""
    return (
        context.filter.clear(outwards[-1], Phase.FREE, opening)
        and near.clear(q, Phase.GRASP, opening)
        and near.path_clear(outwards[:-1], Phase.GRASP, opening)
    )


def _effort(context: PlanningContext, q: np.ndarray, grasp: Grasp, body: PosedObject) -> float:
    """Joint motion from the start and a little from rest in [rad]; steep hands and central grasps are preferred."""
    aside = float(np.linalg.norm(grasp.world_T_tcp[:3, 3] - body.position))
    near, rest = np.abs(q - context.start_q).max(), np.abs(q - REST_Q).max()
    return float(near + 0.2 * rest + 0.3 * (np.pi / 2 - grasp.pitch) + ASIDE_WEIGHT * aside)
