"""Several reward terms at once: which of them need a motion of their own, and one motion that does them in turn.

A term that holds already, or that says where the primary term's subject should end up, is part of one manipulation.
Another one ("the right door open" beside "the cube in the cabinet") is a stage: stages come in the order of their
terms, the primary one last, and each is planned from the state in which the one before left the twin.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from control.planners.result import MotionPlan, MotionStats
from control.robot.kinematics import ArmKinematics
from control.robot.limits import REST_Q, RobotLimits
from control.safety.limits import SafetyLimits
from control.simulation.batches import Observer
from control.tasks.failure import FailureCause
from control.tasks.predicates import judge_term
from control.tasks.reward_spec import PALM, RewardSpec, RewardTerm
from control.tasks.subtasks import palm_at, posed_objects, unseen
from control.trajectory.samples import JointPath
from control.twin_model import ARM_JOINTS, FINGER_JOINTS, TwinModel


@dataclass(frozen=True)
class Surroundings:
    """What all stages of a search share; see `control.planners.motion_search.plan_motion`."""

    safety: SafetyLimits
    limits: RobotLimits
    rng: np.random.Generator
    arm: ArmKinematics
    max_rollouts: int
    nthread: int
    observe: Observer | None


PlanOne = Callable[[TwinModel, RewardSpec, Surroundings], MotionPlan | FailureCause]


def stages_of(spec: RewardSpec, twin: TwinModel) -> list[RewardSpec] | FailureCause:
    """One spec for each manipulation that a spec asks for, in the order in which they are done.

    Each stage keeps the terms of those before it, so that what was achieved has to last.

    Args:
        spec: What to achieve.
        twin: To see which terms hold already.

    Returns:
        At least one spec, the last of them with all terms; or `not_seen` where a name is missing.
    """
    missing = unseen(twin, spec)
    if missing is not None:
        return missing
    data = twin.start()
    objects, palm, rest = posed_objects(twin, data), palm_at(twin, twin.q), palm_at(twin, REST_Q)
    done: list[RewardTerm] = []
    out = []
    for term in spec.terms:
        if term.primary or PALM in (term.subject, term.target) or _handled(term) == _handled(spec.primary):
            continue
        met = judge_term(term, objects, palm, rest, None, twin.support_height, twin.joint_fractions()).met
        if not met:
            on_the_way = tuple(t for t in spec.terms if _leads_to(t, term))
            out.append(RewardSpec((*on_the_way, *done, replace(term, primary=True))))
        done.append(term)
    return [*out, spec]


def plan_in_turn(
    twin: TwinModel, stages: list[RewardSpec], around: Surroundings, plan_one: PlanOne
) -> MotionPlan | FailureCause:
    """Plan stages one after the other and join their motions.

    Args:
        twin: As it stands before the first stage.
        stages: From `stages_of`.
        around: What all stages share.
        plan_one: Plans a single one.

    Returns:
        One plan, without alternatives; or the cause of the first stage that cannot be planned, which names its term.
    """
    plans: list[MotionPlan] = []
    for spec in stages:
        plan = plan_one(twin, spec, around)
        if isinstance(plan, FailureCause):
            return replace(plan, message=f"of {len(stages)} terms in turn, {spec.primary.text}: {plan.message}")
        plans.append(plan)
        twin = after(twin, plan)
    counts = Counter[str]()
    for plan in plans:
        counts.update(plan.stats.counts)
    return MotionPlan(
        path=JointPath(tuple(s for plan in plans for s in plan.path.segments)),
        description="; then ".join(plan.description for plan in plans),
        cost=sum(plan.cost for plan in plans),
        stats=MotionStats(
            sum(plan.stats.steps for plan in plans), sum(plan.stats.seconds for plan in plans), dict(counts)
        ),
        end=twin.qpos,
    )


def after(twin: TwinModel, plan: MotionPlan) -> TwinModel:
    """The twin as a plan leaves it, at rest."""
    q = plan.path.segments[-1].q[-1].copy()
    if plan.end is None:  # nothing but the arm has moved
        qpos = twin.qpos.copy()
        qpos[[int(twin.model.joint(name).qposadr[0]) for name in ARM_JOINTS]] = q
        return replace(twin, q=q, qpos=qpos)
    qpos = plan.end.copy()
    width = float(sum(qpos[int(twin.model.joint(name).qposadr[0])] for name in FINGER_JOINTS))
    return replace(twin, q=q, qpos=qpos, gripper_width=width, held=plan.path.segments[-1].held)


def _handled(term: RewardTerm) -> str | None:
    """The object or joint that a term is about: what would have to be handled to meet it."""
    return term.definition.handles(term)


def _leads_to(palm: RewardTerm, term: RewardTerm) -> bool:
    """Whether a term about the palm is meant for the way to what another term handles."""
    goes_to = palm.definition.approaches(palm)
    return goes_to is not None and goes_to == _handled(term)
