"""Grasps that the arm can really reach: free on the way in, around the object, and while lifting it."""

from dataclasses import dataclass

import numpy as np

from control.collision_filter import Held, Phase
from control.goal_predicates import PosedObject
from control.grasps import MAX_OPENING, Grasp, grasps
from control.limits import REST_Q
from control.trajectory import GripperCommand, PathSegment
from control.workbench import Workbench, straight_targets

BACK_OFF = 0.10  # [m] between pre-grasp and grasp
LIFT = 0.06  # [m] straight up after a grasp, and straight down before a release
SPARE_OPENING = 0.022  # [m] that fingers open beyond an object where they cannot open fully
MOST_READY = 24  # grasps that are looked for; more would only be joined with the same places
ASIDE_WEIGHT = 20.0  # [rad/m], of a grasp off the object's middle
SLOW, MEDIUM = 0.4, 0.7  # shares of the allowed speed near contacts


@dataclass(frozen=True)
class ReadyGrasp:
    """A grasp that the arm can reach without touching anything else.

    Attributes:
        grasp: Which one; None when the object is in the hand already.
        q: Arm at the grasp in [rad], shape (7,).
        arrive: From pre-grasp to grasp, shape (n, 7); empty when the object is in the hand.
        lift: From grasp upwards, shape (m, 7).
        held: How the object lies in the hand.
        opening: Distance between the pads on the way in, in [m].
        width: Distance between the pads around the object in [m].
    """

    grasp: Grasp | None
    q: np.ndarray
    arrive: np.ndarray
    lift: np.ndarray
    held: Held
    opening: float
    width: float

    @property
    def text(self) -> str:
        """For people."""
        return self.grasp.text if self.grasp else "already in the hand"


def ready_grasps(bench: Workbench) -> list[ReadyGrasp]:
    """Up to `MOST_READY` reachable, free grasps of the subject from which it can be lifted; least motion first."""
    subject = str(bench.subtask.subject)
    body = bench.objects[subject]
    if bench.twin.held == subject:
        return [_already_held(bench, body)]
    offered = grasps(body, bench.safety, bench.twin.support_height)
    bench.counts["grasps"] += len(offered)
    if not offered:
        return []
    owners, solutions = bench.solve(np.array([g.world_T_tcp for g in offered]))
    bench.counts["grasps_reachable"] += len(set(owners.tolist()))
    if not len(owners):
        return []
    chosen = [offered[i] for i in owners]
    outwards, ok_out = bench.follow(
        solutions, [straight_targets(g.world_T_tcp, -BACK_OFF * g.approach) for g in chosen]
    )
    up = np.array([0.0, 0.0, LIFT])
    upwards, ok_up = bench.follow(solutions, [straight_targets(g.world_T_tcp, up) for g in chosen])
    bench.counts["grasps_followed"] += int((ok_out & ok_up).sum())
    out: list[ReadyGrasp] = []
    efforts = [_effort(bench, q, g, body) for q, g in zip(solutions, chosen, strict=True)]
    for i in sorted(np.flatnonzero(ok_out & ok_up), key=lambda i: efforts[i]):
        if len(out) == MOST_READY:
            break
        grasp, q = chosen[i], solutions[i]
        held = Held(np.linalg.inv(grasp.world_T_tcp) @ body.pose)
        lift = np.vstack([q[None], upwards[i]])
        opening = _first_opening(bench, q, outwards[i], grasp.width)
        if opening is None or not bench.filter.clear(lift[-1], Phase.CARRY, grasp.width, held):
            continue
        if not bench.filter.path_clear(lift, Phase.CONTACT, grasp.width, held):
            continue
        out.append(ReadyGrasp(grasp, q, np.vstack([outwards[i][::-1], q[None]]), lift, held, opening, grasp.width))
    bench.counts["grasps_free"] += len(out)
    return out


def reach_path(bench: Workbench, grasp: ReadyGrasp, planner: bool = False) -> np.ndarray | None:
    """From the start to the pre-grasp, shape (n, 7); the start alone where the object is in the hand already."""
    if grasp.grasp is None:
        return bench.start_q[None]
    width = max(bench.twin.gripper_width, grasp.opening)
    return bench.way(bench.start_q, grasp.arrive[0], Phase.FREE, width, None, planner)


def pick_segments(bench: Workbench, grasp: ReadyGrasp, reach: np.ndarray) -> list[PathSegment]:
    """Reach, approach, grasp and lift; only the lift where the object is in the hand already."""
    subject = str(bench.subtask.subject)
    touching = tuple((subject, s) for s in bench.supports)
    if grasp.grasp is None:
        return [PathSegment("lift", grasp.lift, None, subject, touching, MEDIUM)] if len(grasp.lift) > 1 else []
    opens = abs(grasp.opening - bench.twin.gripper_width) > 0.002
    return [
        PathSegment("reach", reach, GripperCommand("move", grasp.opening) if opens else None),
        PathSegment("approach", grasp.arrive, GripperCommand("grasp", grasp.width), None, (), MEDIUM),
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


def _already_held(bench: Workbench, body: PosedObject) -> ReadyGrasp:
    tcp = bench.filter.tcp_pose(bench.start_q)
    lift = bench.start_q[None]
    if bench.supports:  # it still stands on something: lift it off first
        up, ok = bench.follow(bench.start_q[None], [straight_targets(tcp, np.array([0.0, 0.0, LIFT]))])
        if ok[0]:
            lift = np.vstack([lift, up[0]])
    bench.counts["grasps"] += 1
    bench.counts["grasps_free"] += 1
    width = bench.twin.gripper_width
    held = Held(np.linalg.inv(tcp) @ body.pose)
    return ReadyGrasp(None, bench.start_q, np.zeros((0, 7)), lift, held, width, width)


def _first_opening(bench: Workbench, q: np.ndarray, outwards: np.ndarray, width: float) -> float | None:
    """The widest opening with which the hand can come to a grasp freely, or None."""
    for opening in (MAX_OPENING, min(MAX_OPENING, width + SPARE_OPENING)):
        if (
            bench.filter.clear(outwards[-1], Phase.FREE, opening)
            and bench.filter.clear(q, Phase.GRASP, opening)
            and bench.filter.path_clear(outwards[:-1], Phase.GRASP, opening)
        ):
            return opening
    return None


def _effort(bench: Workbench, q: np.ndarray, grasp: Grasp, body: PosedObject) -> float:
    """Joint motion from the start and a little from rest in [rad]; steep hands and central grasps are preferred."""
    aside = float(np.linalg.norm(grasp.world_T_tcp[:3, 3] - body.position))
    near, rest = np.abs(q - bench.start_q).max(), np.abs(q - REST_Q).max()
    return float(near + 0.2 * rest + 0.3 * (np.pi / 2 - grasp.pitch) + ASIDE_WEIGHT * aside)
