"""What a motion costs: how far the reward terms are from being met, how far residuals are beyond their limits.

    cost = w_p r_primary(T) + sum over other terms of w_s r_i + sum over residuals of excess / scale + w_e length

The primary term is judged at the end, over a horizon that covers the whole motion. A term about the palm and an object
of a spec whose primary term is about the object ("come near the cube" beside "put the cube on the crate") is meant for
the way there: its best moment counts. Success is a predicate of its own, never a small cost.
"""

from dataclasses import dataclass

import numpy as np

from control.certificate import CheckResult
from control.goal_predicates import TermJudgement, judge_term
from control.residuals import SafetyResidual, TwinMotion
from control.rewards import PALM, RewardSpec
from control.subtasks import posed
from control.twin_model import TwinModel

PRIMARY_WEIGHT = 20.0  # per [m], or per range of a joint
SECONDARY_WEIGHT = 2.0  # likewise
EFFORT_WEIGHT = 0.05  # per [rad] of the candidate's preference
MOMENTS = 25  # samples over which the best moment of a palm term is sought


@dataclass(frozen=True)
class Score:
    """How one simulated motion did.

    Attributes:
        success: The primary term is met at the end.
        checks: Every safety residual against its limit.
        cost: Lower is better.
        judgement: Of the primary term at the end.
    """

    success: bool
    checks: tuple[CheckResult, ...]
    cost: float
    judgement: TermJudgement

    @property
    def clean(self) -> bool:
        """Whether every residual is within its limit."""
        return all(c.ok for c in self.checks)

    @property
    def rank(self) -> tuple[bool, bool, float]:
        """Sorts best first: success, then clean, then cost."""
        return (not self.success, not (self.success and self.clean), self.cost)


def score_motion(
    motion: TwinMotion,
    twin: TwinModel,
    spec: RewardSpec,
    residuals: tuple[SafetyResidual, ...],
    rest_palm: np.ndarray,
    effort: float = 0.0,
) -> Score:
    """Judge a recorded motion.

    Args:
        motion: As it went.
        twin: For the objects' sizes.
        spec: What was wanted.
        residuals: The safety table.
        rest_palm: Tool centre point at rest in [m], shape (3,).
        effort: The candidate's own preference in [rad].
    """
    last = judge_at(motion, twin, spec, len(motion.time) - 1, rest_palm)
    primary = last[spec.terms.index(spec.primary)]
    cost = PRIMARY_WEIGHT * primary.residual + EFFORT_WEIGHT * effort
    about_object = PALM not in (spec.primary.subject, spec.primary.target)
    for i, term in enumerate(spec.terms):
        if term.primary:
            continue
        residual = last[i].residual
        if about_object and PALM in (term.subject, term.target):
            rows = np.unique(np.linspace(0, len(motion.time) - 1, MOMENTS).astype(int))
            residual = min(judge_at(motion, twin, spec, int(k), rest_palm)[i].residual for k in rows)
        cost += SECONDARY_WEIGHT * residual
    checks = tuple(r.check(motion) for r in residuals)
    cost += sum(r.cost(motion) for r in residuals)
    return Score(primary.met, checks, float(cost), primary)


def judge_at(
    motion: TwinMotion, twin: TwinModel, spec: RewardSpec, k: int, rest_palm: np.ndarray
) -> list[TermJudgement]:
    """Judgements of all terms at sample k, in their order."""
    now = {name: posed(twin, name, poses[k]) for name, poses in motion.objects.items()}
    start = {name: posed(twin, name, poses[0]) for name, poses in motion.objects.items()}
    palm = motion.tcp[k, :3, 3]
    fractions = {name: float(values[k]) for name, values in motion.fractions.items()}
    return [judge_term(t, now, palm, rest_palm, start, twin.support_height, fractions) for t in spec.terms]
