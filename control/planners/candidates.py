"""Motions that might do a subtask: grasps, places and free paths, each filtered on its own, then joined.

A candidate is a complete joint path with gripper commands from where the arm is to its end. All of it has passed the
geometric filter; nothing has been simulated. Candidates come one by one, promising ones first, so that a search can
stop as soon as a few of them have proved themselves.
"""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import islice, product
from types import MappingProxyType

import numpy as np

from control.grasping.articulated_objects import ALONG_FROM_END, ROUGH_STEPS, HandleMotion, Holds, handle_segments
from control.grasping.grasps import pose, tcp_frame
from control.grasping.picking import MEDIUM, SLOW, ReadyGrasp, diverse, pick_segments, reach_path, ready_grasps
from control.grasping.placing import ReadyPlace, offered_places, ready_pairs
from control.path_planning.collision_filter import Held, JointAt, Phase
from control.path_planning.planning_context import PlanningContext, path_length, straight_targets
from control.robot.limits import REST_Q
from control.tasks.posed_object import PosedObject
from control.tasks.predicates import judge_term
from control.trajectory.samples import FINGERS, GripperCommand, PathSegment
from control.twin_model import TABLE_BODY

READY_GRASPS = 10  # grasps that are joined with places
USES = 3  # candidates of one group of places that share one grasp
GROUP = 12  # places that are looked at together, about one spot in all its turns
NEW_HOLDS = 3  # stations on a joint's way at which the hand may take a new hold
JOINED = 60  # combinations of holds of a handle for which ways are looked for
PLANNED = 4  # pairs for which RRT-connect is tried, where straight ways are obstructed
HOVER = 0.018  # [m] between an object's surface and the tool centre point that "reaches" it
REACH_PITCHES = np.radians([90.0, 65.0, 45.0, 30.0])


@dataclass(frozen=True)
class Candidate:
    """A motion that geometry allows.

    Attributes:
        segments: The joint path in pieces, first waypoint = the twin's start.
        description: For people: which grasp, which place.
        preference: Lower is better; joint motion in [rad] and extras.
        joint_ends: Where the joint should stand in [rad] or [m] when a segment ends, by the segment's index.
    """

    segments: tuple[PathSegment, ...]
    description: str
    preference: float
    joint_ends: Mapping[int, float] = field(default_factory=lambda: MappingProxyType({}))


def candidates(context: PlanningContext) -> Iterator[Candidate]:
    """Candidates for the subtask, promising ones first."""
    kind = context.subtask.manipulation
    if kind in ("rest", "retreat"):
        yield from _palm_moves(context)
    elif kind == "reach":
        yield from _reaches(context)
    elif kind in ("lift", "bring"):
        yield from _lifts(context)
    elif kind == "drive":
        yield from _drives(context)
    else:
        yield from _placings(context)


def _palm_moves(context: PlanningContext) -> Iterator[Candidate]:
    """Move to rest, or to another posture far enough away."""
    term, ends = context.subtask.term, [np.array(REST_Q)]
    if context.subtask.manipulation == "retreat":
        ends += context.vias
    held, phase = _carried(context)
    for end in ends:
        palm = context.filter.tcp_pose(end)[:3, 3]
        if not judge_term(term, context.objects, palm, context.rest_palm).met:
            continue
        context.counts["ends"] += 1
        path = context.way(context.start_q, end, phase, context.twin.gripper_width, held, planner=True)
        if path is not None:
            yield Candidate((PathSegment("home", path, held=context.twin.held),), "move the palm", path_length(path))


def _reaches(context: PlanningContext) -> Iterator[Candidate]:
    """Bring the palm just above or beside an object, from many sides."""
    body = context.objects[str(context.subtask.target)]
    held, phase = _carried(context)
    targets, pitches = [], []
    for pitch in REACH_PITCHES:
        for angle in np.arange(12) * np.pi / 6:
            forward = np.array([np.cos(angle), np.sin(angle), 0.0])
            approach = forward * np.cos(pitch) - np.array([0.0, 0.0, np.sin(pitch)])
            rotation = tcp_frame(approach, np.array([-forward[1], forward[0], 0.0]))
            targets.append(pose(rotation, body.position - approach * (_exit_distance(body, -approach) + HOVER)))
            pitches.append(float(pitch))
    owners, solutions = context.solve(np.array(targets))
    context.counts["grasps"] += len(targets)
    context.counts["grasps_reachable"] += len(set(owners.tolist()))
    width = context.twin.gripper_width
    for i in np.argsort([np.abs(q - context.start_q).max() for q in solutions], kind="stable"):
        q = solutions[i]
        palm = context.filter.tcp_pose(q)[:3, 3]
        if not judge_term(context.subtask.term, context.objects, palm, context.rest_palm).met:
            continue
        if not context.filter.clear(q, phase, width, held):
            continue
        context.counts["grasps_free"] += 1
        path = context.way(context.start_q, q, phase, width, held)
        if path is not None:
            text = f"reach at pitch {np.degrees(pitches[owners[i]]):.0f} deg"
            yield Candidate((PathSegment("reach", path, held=context.twin.held),), text, path_length(path))


def _lifts(context: PlanningContext) -> Iterator[Candidate]:
    """Pick the subject up and keep it: as high as asked for, or at the rest position."""
    subject = str(context.subtask.subject)
    ready = ready_grasps(context)
    for planner in (False, True):
        found = 0
        for grasp in ready[: PLANNED if planner else None]:
            reach = reach_path(context, grasp, planner)
            if reach is None:
                continue
            context.counts["pairs"] += 1
            start = grasp.lift[-1]
            if context.subtask.manipulation == "bring":
                up = context.way(start, np.array(REST_Q), Phase.CARRY, grasp.width, grasp.held, planner)
            else:
                up = _raise(context, grasp, start, context.subtask.amount, planner)
            if up is None:
                continue
            found += 1
            segments = pick_segments(context, grasp, reach)
            if len(up) > 1:
                segments.append(PathSegment("carry", up, None, subject))
            if segments:
                yield Candidate(tuple(segments), f"lift ({grasp.text})", path_length(reach) + path_length(up))
        if found:
            return


def _raise(
    context: PlanningContext, grasp: ReadyGrasp, start: np.ndarray, height: float, planner: bool
) -> np.ndarray | None:
    """From the lifted pose to one where the object's centre is at `height` [m]: straight up, or to a new posture."""
    tcp = context.filter.tcp_pose(start)
    rise = height + 0.01 - float((tcp @ grasp.held.tcp_T_object)[2, 3])
    if rise <= 0:
        return start[None]
    up, ok = context.follow(start[None], [straight_targets(tcp, np.array([0.0, 0.0, rise]))])
    if ok[0]:
        path = np.vstack([start[None], up[0]])
        if context.filter.path_clear(path, Phase.CARRY, grasp.width, grasp.held):
            return path
    targets = []
    for _ in range(24):
        point = np.array([context.rng.uniform(0.3, 0.6), context.rng.uniform(-0.4, 0.4), tcp[2, 3] + rise])
        swing = np.arctan2(point[1], point[0]) - np.arctan2(tcp[1, 3], tcp[0, 3])
        c, s = np.cos(swing), np.sin(swing)
        targets.append(pose(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ tcp[:3, :3], point))
    _, solutions = context.solve(np.array(targets))
    for q in solutions:
        if context.filter.clear(q, Phase.CARRY, grasp.width, grasp.held):
            path = context.way(start, q, Phase.CARRY, grasp.width, grasp.held, planner)
            if path is not None:
                return path
    return None


def _drives(context: PlanningContext) -> Iterator[Candidate]:
    """Take a joint's handle along to where the joint should stand; halfway with a new hold where one does not do."""
    joint = context.twin.joint(str(context.subtask.subject))
    if joint is None:
        return
    goal = joint.position(context.subtask.amount)
    holds = Holds(context, joint, goal)
    found, shorter = False, []
    for candidate in _articulated(context, joint.name, [holds.ready()]):
        found = True
        yield candidate
    # As far as one hold goes, or a little less.
    furthest = min(holds.furthest, ROUGH_STEPS - 1)
    for stations in range(furthest, max(0, furthest - NEW_HOLDS), -1):
        if found:
            return
        first = holds.ready(stations)
        if first:
            shorter.append(first)
            between = float(holds.stations[stations - 1])
            second = Holds(context, joint, goal, between, first[0].leave[-1]).ready()
            for candidate in _articulated(context, joint.name, [first, second]):
                found = True
                yield candidate
    if not found:
        free = (first for first in shorter if next(_articulated(context, joint.name, [first]), None) is not None)
        ends = (joint.fraction(float(first[0].positions[-1])) for first in free)
        context.driven_to = next(ends, None)


def _articulated(context: PlanningContext, joint: str, legs: list[list[HandleMotion]]) -> Iterator[Candidate]:
    """Holds joined by free ways, one of each leg in turn; with RRT-connect only where nothing else is free."""
    for planner in (False, True):
        found = False
        blocked: set[int] = set()  # first holds that cannot be reached
        # Best with best first, then one of them second best, and so on.
        ranks = sorted(product(*(range(len(leg)) for leg in legs)), key=sum)
        for rank in islice((r for r in ranks if r[0] not in blocked), PLANNED if planner else JOINED):
            moves = [leg[i] for leg, i in zip(legs, rank, strict=True)]
            context.counts["pairs"] += 1
            segments: list[PathSegment] = []
            ends: dict[int, float] = {}
            q, width, effort = context.start_q, context.twin.gripper_width, 0.0
            for move in moves:
                at = JointAt(float(move.positions[0]))
                reach = context.way(q, move.arrive[0], Phase.FREE, max(width, move.opening), at, planner)
                if reach is None:
                    if move is moves[0]:
                        blocked.add(rank[0])
                    break
                segments += handle_segments(move, joint, reach, width)
                ends[len(segments) - ALONG_FROM_END] = float(move.positions[-1])
                q, width = move.leave[-1], move.opening
                effort += path_length(reach) + path_length(move.along)
            else:
                at = JointAt(float(moves[-1].positions[-1]))
                home = context.way(q, np.array(REST_Q), Phase.FREE, width, at, planner)
                if home is not None:
                    found = True
                    text = ", then ".join(m.text for m in moves)
                    segments.append(PathSegment("home", home))
                    yield Candidate(tuple(segments), f"drive ({text})", effort + path_length(home), ends)
        if found:
            return


def _placings(context: PlanningContext) -> Iterator[Candidate]:
    """Pick the subject and put it down: free grasps x free places x free ways, cheapest pairs first."""
    ready = diverse(ready_grasps(context), READY_GRASPS)
    if not ready:
        return
    places = offered_places(context, ready)
    context.counts["places"] += len(places)
    reaches: dict[int, np.ndarray | None] = {}
    pairs: list[tuple[int, ReadyPlace]] = []
    found = 0
    for first in range(0, len(places), GROUP):
        fresh = ready_pairs(context, ready, places[first : first + GROUP])
        pairs += fresh
        for i, place in _taking_turns(fresh):
            candidate = _join(context, ready[i], place, reaches, i, planner=False)
            if candidate is not None:
                found += 1
                yield candidate
    if not found:
        reaches = {}
        for i, place in pairs[:PLANNED]:
            candidate = _join(context, ready[i], place, reaches, i, planner=True)
            if candidate is not None:
                yield candidate


def _taking_turns(pairs: list[tuple[int, ReadyPlace]]) -> list[tuple[int, ReadyPlace]]:
    """Every grasp's best place first, then every grasp's second, up to `USES`: unlike candidates come first."""
    turn: Counter[int] = Counter()
    ranked = []
    for i, place in pairs:
        turn[i] += 1
        if turn[i] <= USES:
            ranked.append((turn[i], i, place))
    return [(i, place) for _, i, place in sorted(ranked, key=lambda r: r[0])]


def _join(
    context: PlanningContext,
    grasp: ReadyGrasp,
    place: ReadyPlace,
    reaches: dict[int, np.ndarray | None],
    index: int,
    planner: bool,
) -> Candidate | None:
    """Connect start, grasp, place and rest; None when a way is obstructed."""
    context.counts["pairs"] += 1
    if index not in reaches:
        reaches[index] = reach_path(context, grasp, planner)
    reach = reaches[index]
    if reach is None:
        return None
    carry = context.way(grasp.lift[-1], place.lower[0], Phase.CARRY, grasp.width, grasp.held, planner)
    if carry is None:
        return None
    at = place.placement.world_T_object
    home = context.way(place.leave[-1], np.array(REST_Q), Phase.FREE, place.opening, at, planner)
    if home is None:
        return None
    subject = str(context.subtask.subject)
    carrier = str(context.subtask.target) if context.subtask.manipulation == "place" else TABLE_BODY
    release = GripperCommand("move", place.opening)
    segments = [
        *pick_segments(context, grasp, reach),
        PathSegment("carry", carry, None, subject),
        PathSegment("lower", place.lower, release, subject, ((subject, carrier),), SLOW),
        PathSegment("retreat", place.leave, None, None, ((subject, carrier), (subject, FINGERS)), MEDIUM),
        PathSegment("home", home),
    ]
    effort = path_length(reach) + path_length(carry) + path_length(home) + 5.0 * place.placement.preference
    return Candidate(tuple(segments), f"pick ({grasp.text}), put {place.placement.text}", effort)


def _carried(context: PlanningContext) -> tuple[Held | None, Phase]:
    """What the hand holds at the start, for motions of the palm alone."""
    name = context.twin.held
    if name is None:
        return None, Phase.FREE
    return Held(np.linalg.inv(context.filter.tcp_pose(context.start_q)) @ context.objects[name].pose), Phase.CARRY


def _exit_distance(body: PosedObject, direction: np.ndarray) -> float:
    """Distance in [m] from an object's centre to its surface along a direction."""
    half = np.asarray(body.extents) / 2
    if body.shape == "sphere":
        return float(half.max())
    local = np.abs(body.pose[:3, :3].T @ direction)
    return float(np.min(half / np.maximum(local, 1e-9)))
