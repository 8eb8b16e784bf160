"""Following a motion closed-loop in the twin, and planning the rest of it anew where the twin departs from it.

A candidate predicts where things are when the arm rests: what the hand holds moves with the hand, a joint stands where
its handle was taken to, and what was let go stays there. The twin, stepped from stop to stop, need not agree: a grasp
slips while the fingers close, a handle rolls between the pads, a door swings on. At the first stop that departs by more
than perception errs, the rest of the motion is planned again from the state that was reached, with the horizon at the
end of the subtask; then it goes on from there. So what is retimed and judged is a motion that was planned from the
states that it meets.

    departs when   |p - p'| > SLIPPED or angle(R, R') > TURNED      of a held object, in the hand
                   |x - x'| > LAGS (x_open - x_closed)              of the driven joint
                   |p - p'| > ROLLED and a term is not met          of an object that was let go

The plan so far is only replaced by one that is as good and departs less, or better.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice

import mujoco
import numpy as np

from control.grasping.articulated_objects import continued_moves
from control.grasping.picking import MEDIUM, SLOW
from control.path_planning.collision_filter import JointAt, Phase
from control.path_planning.planning_context import PlanningContext, path_length
from control.planners.candidate_search import Search, Tried
from control.planners.candidates import Candidate, candidates
from control.robot.limits import REST_Q
from control.robot.rotations import rotation_log
from control.trajectory.samples import FINGERS, GripperCommand, PathSegment
from control.twin_model import FINGER_JOINTS, TCP_SITE, TwinJoint, TwinModel

SLIPPED, TURNED = 0.006, 0.10  # [m], [rad], of a held object in the hand since it was lifted
LAGS = 0.02  # share of a joint's range
ROLLED = 0.02  # [m]
NEAR_HANDLE = 0.015  # [m] of the tool from a handle's axis: further away, the handle is no longer between the pads
MOST_REPLANS = 3
FRESH = 2  # plans for the rest that are simulated at one departure


@dataclass(frozen=True)
class Departure:
    """Where the twin leaves what a candidate predicts.

    Attributes:
        segment: Index of the segment at whose end it was found.
        row: Row of the rollout there.
        at_handle: Whether the hand is at the handle of the driven joint, which it has not let go yet.
        text: For people.
    """

    segment: int
    row: int
    at_handle: bool
    text: str


def follow(search: Search, tried: Tried) -> Tried:
    """Follow a simulated candidate from stop to stop; plan anew from where it departs, up to `MOST_REPLANS` times.

    Args:
        search: Simulates and scores; what is planned anew is added to what it tried.
        tried: Where to begin.

    Returns:
        The motion that was followed to its end: `tried` itself where nothing departs or nothing better is found.
    """
    done = -1  # stops up to this one were met as planned or planned anew from
    for _ in range(MOST_REPLANS):
        departure = first_departure(search.context, tried, done)
        if departure is None:
            return tried
        search.context.counts["departures"] += 1
        done = departure.segment
        fresh = list(islice(_planned_anew(search.context, tried, departure), FRESH))
        if not fresh:
            continue
        search.context.counts["replanned"] += len(fresh)
        again = search.simulate(fresh)
        search.tried += again
        tried = min((tried, *again), key=lambda t: _rank(search.context, t, done - 1))
    return tried


def _rank(context: PlanningContext, tried: Tried, after: int) -> tuple[bool, bool, bool, float]:
    """Sorts best first: success, then clean, then whether it goes as it predicts from a stop on, then cost."""
    failed, unclean, cost = tried.score.rank
    return failed, unclean, first_departure(context, tried, after) is not None, cost


def first_departure(context: PlanningContext, tried: Tried, after: int = -1) -> Departure | None:
    """The first stop, after segment `after`, at which the twin is not where the candidate predicts."""
    candidate, rollout, task = tried.candidate, tried.rollout, context.subtask
    if rollout.exploded:
        return None
    joint = context.twin.joint(str(task.subject)) if task.manipulation == "drive" else None
    address = None if joint is None else int(context.twin.model.joint(joint.name).qposadr[0])
    held: np.ndarray | None = None  # pose of the object in the hand's frame when it was lifted
    for i, (segment, (arrived, rested)) in enumerate(zip(candidate.segments, rollout.commands.stops, strict=True)):
        row = arrived if segment.held or i in candidate.joint_ends else rested
        if joint is not None and address is not None and i in candidate.joint_ends and i > after:
            expected = candidate.joint_ends[i]
            off = float(rollout.qpos[row, address]) - expected
            if abs(off) > LAGS * abs(joint.opened - joint.closed):
                text = f"{joint.name} is {joint.fraction(off + expected):.0%} open, not {joint.fraction(expected):.0%}"
                taken = _at_handle(context.twin, rollout.qpos[row], joint)
                return Departure(i, row if taken else rested, taken, text)
        if segment.held is not None:
            tool, thing = _poses(context.twin, rollout.qpos[row], segment.held)
            now = np.linalg.inv(tool) @ thing
            if held is None:
                held = now
            elif i > after and _differ(held, now):
                return Departure(i, row, False, f"{segment.held} has moved in the hand")
    last = len(candidate.segments) - 1
    if held is None or not task.releases or tried.score.success or last <= after:
        return None
    return Departure(last, len(rollout.qpos) - 1, False, f"{task.subject} is not where it was put")


def _planned_anew(context: PlanningContext, tried: Tried, departure: Departure) -> Iterator[Candidate]:
    """What was done so far, each with another rest of the motion."""
    segments = tried.candidate.segments[: departure.segment + 1]
    twin = twin_at(context.twin, tried, departure)
    opened = None
    if departure.at_handle:
        opened = segments[-1].gripper or GripperCommand("move", context.twin.gripper.opening)
        segments = (*segments[:-1], replace(segments[-1], gripper=None))
    elif twin.held is not None and segments[-1].gripper is not None:
        segments = (*segments[:-1], replace(segments[-1], gripper=None))
    here = PlanningContext(
        twin, context.subtask, context.safety, context.limits, context.arm, context.rng, context.spec
    )
    rest = _driven_on(here, opened) if opened is not None else candidates(here)
    for more in rest:
        ends = {k: v for k, v in tried.candidate.joint_ends.items() if k < departure.segment}
        ends |= {k + len(segments): v for k, v in more.joint_ends.items()}
        text = f"{tried.candidate.description}; as {departure.text}: {more.description}"
        yield Candidate((*segments, *more.segments), text, tried.candidate.preference + more.preference, ends)
    context.filter.checks += here.filter.checks


def _driven_on(context: PlanningContext, opened: GripperCommand) -> Iterator[Candidate]:
    """Take the handle on to where the joint should stand, let go and go home."""
    joint = context.twin.joint(str(context.subtask.subject))
    assert joint is not None
    goal = joint.position(context.subtask.amount)
    for move in continued_moves(context, joint, goal, opened.width):
        home = context.way(move.leave[-1], np.array(REST_Q), Phase.FREE, move.opening, JointAt(goal), planner=True)
        if home is None:
            continue
        touching = ((joint.name, FINGERS),)
        segments = (
            PathSegment("drive", move.along, opened, None, touching, SLOW),
            PathSegment("retreat", move.leave, None, None, touching, MEDIUM),
            PathSegment("home", home),
        )
        yield Candidate(segments, move.text, path_length(move.along) + path_length(home), {0: goal})


def twin_at(twin: TwinModel, tried: Tried, departure: Departure) -> TwinModel:
    """The twin in the state at a departure, at rest, with what is in the hand held there."""
    segment, qpos = tried.candidate.segments[departure.segment], tried.rollout.qpos[departure.row].copy()
    fingers = [int(twin.model.joint(name).qposadr[0]) for name in FINGER_JOINTS]
    held = segment.held if departure.row == tried.rollout.commands.stops[departure.segment][0] else None
    return replace(twin, qpos=qpos, q=segment.q[-1].copy(), gripper_width=float(qpos[fingers].sum()), held=held)


def _at_handle(twin: TwinModel, qpos: np.ndarray, joint: TwinJoint) -> bool:
    """Whether the tool is still at the bar of a joint's handle."""
    tool, body = _poses(twin, qpos, joint.body)
    local = np.linalg.inv(body) @ tool[:, 3] - np.append(joint.handle.centre, 1.0)
    along = float(local[:3] @ joint.handle.axis)
    across = float(np.linalg.norm(local[:3] - along * joint.handle.axis))
    return across <= NEAR_HANDLE and abs(along) <= joint.handle.half_length + NEAR_HANDLE


def _poses(twin: TwinModel, qpos: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Poses (4, 4) of the tool and of a body in a configuration."""
    data = mujoco.MjData(twin.model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(twin.model, data)
    site, body = data.site(TCP_SITE), data.body(name)
    return _pose(site.xmat, site.xpos), _pose(body.xmat, body.xpos)


def _pose(rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation.reshape(3, 3), position
    return out


def _differ(a: np.ndarray, b: np.ndarray) -> bool:
    turned = float(np.linalg.norm(rotation_log(a[:3, :3].T @ b[:3, :3])))
    return bool(np.linalg.norm(a[:3, 3] - b[:3, 3]) > SLIPPED or turned > TURNED)
