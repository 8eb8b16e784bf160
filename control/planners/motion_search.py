"""Finding a motion for one subtask: geometric candidates, full-horizon rollouts in the twin, refinement, choice.

Candidates are simulated a few at a time, and no more once enough of them succeeded cleanly: simulated steps are what a
search costs. The best one is followed closed-loop and planned anew where the twin departs from what it predicts
(`control.planners.receding_horizon`). Only when no candidate is clean are the best ones varied and tried again. Where a
spec has several terms that each need a motion of their own, these are planned one after the other
(`control.planners.several_terms`).
"""

import time
from collections.abc import Sequence

import numpy as np

from control.path_planning.collision_filter import Phase
from control.path_planning.planning_context import PlanningContext, path_length
from control.planners.candidate_search import Search, Tried
from control.planners.candidates import candidates
from control.planners.early_refusals import start_contact, too_high
from control.planners.receding_horizon import follow
from control.planners.result import MotionPlan, MotionStats
from control.planners.search_causes import closed, hindrance, lost
from control.planners.several_terms import Surroundings, plan_in_turn, stages_of
from control.robot.kinematics import ArmKinematics
from control.robot.limits import REST_Q, RobotLimits, panda_limits
from control.safety.limits import SafetyLimits
from control.simulation.batches import Observer
from control.tasks.failure import FailureCause
from control.tasks.predicates import judge_term
from control.tasks.reward_spec import RewardSpec
from control.tasks.subtasks import Subtask, read_subtask
from control.tasks.term_conflicts import refuse_term_conflicts
from control.trajectory.samples import JointPath, PathSegment
from control.twin_model import TwinModel


def plan_motion(
    twin: TwinModel,
    spec: RewardSpec,
    safety: SafetyLimits,
    rng: np.random.Generator,
    kinematics: ArmKinematics | None = None,
    max_rollouts: int = 24,
    nthread: int = 2,
    variants: Sequence[TwinModel] = (),
    observe: Observer | None = None,
    limits: RobotLimits | None = None,
) -> MotionPlan | FailureCause:
    """Find a motion that meets a spec's terms in the twin and keeps every safety residual.

    Args:
        twin: What is believed to stand around.
        spec: What to achieve. Terms about the palm beside a primary term about something else are meant for the way;
            all others have to hold at the end.
        safety: The safety table.
        rng: Source of randomness; the same state gives the same plan at any number of threads.
        kinematics: The arm; read from its URDF when left out.
        max_rollouts: Most candidates to simulate.
        nthread: Threads for simulation.
        variants: Perturbed twins of the same layout. Where given, the best plans are tried in them as well and the one
            that succeeds most often is chosen.
        observe: Told of each batch of motions that is simulated.
        limits: Published limits of the robot; the Panda's if None.

    Returns:
        The plan; or why there is none: `not_seen`, `no_candidate` (with counts of where candidates were lost) or
        `unsafe` (motions reach the goal, but break a check).

    Raises:
        RewardSpecError: Two terms conflict.
    """
    refuse_term_conflicts(spec, twin)
    arm = kinematics or ArmKinematics.from_urdf(gripper=twin.gripper)
    around = Surroundings(safety, limits or panda_limits(), rng, arm, max_rollouts, nthread, observe)
    stages = stages_of(spec, twin)
    if isinstance(stages, FailureCause):
        return stages
    if len(stages) > 1:
        return plan_in_turn(twin, stages, around, plan_one)
    return plan_one(twin, spec, around, variants)


def plan_one(
    twin: TwinModel, spec: RewardSpec, around: Surroundings, variants: Sequence[TwinModel] = ()
) -> MotionPlan | FailureCause:
    """The same for a spec whose primary term asks for the only manipulation."""
    began = time.perf_counter()
    task, safety, arm = read_subtask(spec), around.safety, around.arm
    refused = hindrance(twin, spec, task, safety) or closed(twin, task) or too_high(twin, task, arm)
    if refused is not None:
        return refused
    context = PlanningContext(twin, task, safety, around.limits, arm, around.rng, spec)
    palm = context.filter.tcp_pose(context.start_q)[:3, 3]
    judged = judge_term(
        spec.primary, context.objects, palm, context.rest_palm, None, twin.support_height, twin.joint_fractions()
    )
    if judged.met and twin.held is None and not task.holds:
        return _already_done(context, task, judged.text, began)
    search = Search(context, spec, candidates(context), around.max_rollouts, around.nthread, around.observe)
    search.try_until()
    if search.tried and not search.good():
        follow(search, search.ranked()[0])
    if search.tried and not search.good():
        search.refine()
    good = search.good()
    if good:
        follow(search, good[0])
        good = search.most_robust(variants) if variants else search.good()
    stats = MotionStats(search.steps, time.perf_counter() - began, _counts(search))
    if not good:
        return start_contact(twin) or lost(context, [t.score for t in search.ranked()], stats)
    return _plan(good, stats)


def _plan(good: list[Tried], stats: MotionStats) -> MotionPlan:
    best = good[0]
    return MotionPlan(
        path=JointPath(best.candidate.segments),
        description=best.candidate.description,
        cost=best.score.cost,
        stats=stats,
        end=best.rollout.end,
        alternatives=tuple(JointPath(t.candidate.segments) for t in good[1:]),
    )


def _already_done(context: PlanningContext, task: Subtask, text: str, began: float) -> MotionPlan | FailureCause:
    """Nothing to do but to come to rest (or to stay, where the palm itself is the point)."""
    stays = task.manipulation in ("reach", "retreat")
    end = context.start_q if stays else np.array(REST_Q)
    path = context.way(context.start_q, end, Phase.FREE, context.twin.gripper_width, None, planner=True)
    stats = MotionStats(0, time.perf_counter() - began, dict(context.counts))
    if path is None:
        return FailureCause("no_candidate", task.subject or "palm", "no free way back to the rest position")
    name = "reach" if stays else "home"
    return MotionPlan(JointPath((PathSegment(name, path),)), f"met already: {text}", path_length(path), stats)


def _counts(search: Search) -> dict[str, int]:
    return {
        **search.context.counts,
        "configurations_checked": search.context.filter.checks,
        "rollouts": len(search.tried),
        "successes": sum(t.score.success for t in search.tried),
        "clean": len(search.good()),
    }
