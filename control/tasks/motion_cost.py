"""What a motion costs: how far the reward terms are from being met, how far residuals are beyond their limits.

    cost = w_p r_primary(T) + sum over other terms of w_s r_i + sum over residuals of excess / scale + w_e length

Terms are judged at the end, over a horizon that covers the whole motion. A term about the palm in a spec whose primary
term is about something else ("come near the cube" beside "put the cube on the crate") is meant for the way there: its
best moment counts. Success is a predicate of its own, never a small cost, and every term is part of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from control.safety.certificate import CheckResult
from control.safety.residuals import SafetyResidual, TwinMotion
from control.tasks.predicates import judge_term
from control.tasks.reward_spec import PALM, RewardSpec, RewardTerm
from control.tasks.subtasks import posed
from control.tasks.terms.views import TermJudgement
from control.twin_model import TwinModel

PRIMARY_WEIGHT = 20.0  # per [m], or per range of a joint
SECONDARY_WEIGHT = 2.0  # likewise
EFFORT_WEIGHT = 0.05  # per [rad] of the candidate's preference
MOMENTS = 25  # samples over which the best moment of a palm term is sought


@dataclass(frozen=True)
class Score:
    """How one simulated motion did.

    Attributes:
        success: The primary term is met at the end, and every other term at its time.
        checks: Every safety residual against its limit.
        cost: Lower is better.
        judgement: Of the primary term at the end.
        unmet: Of other terms that are not met.
    """

    success: bool
    checks: tuple[CheckResult, ...]
    cost: float
    judgement: TermJudgement
    unmet: tuple[TermJudgement, ...] = ()

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
    judged = judge_terms(motion, twin, spec, [len(motion.time) - 1], rest_palm)
    primary = judged[spec.terms.index(spec.primary)]
    others = [j for j, term in zip(judged, spec.terms, strict=True) if not term.primary]
    cost = PRIMARY_WEIGHT * primary.residual + EFFORT_WEIGHT * effort
    cost += SECONDARY_WEIGHT * sum(j.residual for j in others)
    checks = tuple(r.check(motion) for r in residuals)
    cost += sum(r.cost(motion) for r in residuals)
    unmet = tuple(j for j in others if not j.met)
    return Score(primary.met and not unmet, checks, float(cost), primary, unmet)


def judge_terms(
    motion: TwinMotion, twin: TwinModel, spec: RewardSpec, samples: Sequence[int], rest_palm: np.ndarray
) -> list[TermJudgement]:
    """Judge all terms, in their order: at the worst of some samples, or on the way where a term is meant for it.

    Args:
        motion: As it went.
        twin: For the objects' sizes.
        spec: What was wanted.
        samples: Where terms have to hold that are meant to last, indices.
        rest_palm: Tool centre point at rest in [m], shape (3,).
    """
    terms = [term for term in spec.terms if not _on_the_way(term, spec)]
    judged = _judge_moments(motion, twin, terms, samples, rest_palm)
    out = {term: max(moments, key=lambda j: j.residual) for term, moments in zip(terms, judged, strict=True)}
    passing = [term for term in spec.terms if _on_the_way(term, spec)]
    rows = np.unique(np.linspace(0, len(motion.time) - 1, MOMENTS).astype(int)).tolist()
    judged = _judge_moments(motion, twin, passing, rows, rest_palm)
    out |= {term: min(moments, key=lambda j: j.residual) for term, moments in zip(passing, judged, strict=True)}
    return [out[term] for term in spec.terms]


def _on_the_way(term: RewardTerm, spec: RewardSpec) -> bool:
    """Whether a term about the palm stands beside a primary term about something else."""
    about_palm = PALM in (spec.primary.subject, spec.primary.target)
    return not term.primary and not about_palm and PALM in (term.subject, term.target)


def _judge_moments(
    motion: TwinMotion, twin: TwinModel, terms: Sequence[RewardTerm], samples: Sequence[int], rest_palm: np.ndarray
) -> list[list[TermJudgement]]:
    """For each term its judgements at some samples."""
    if not terms:
        return []
    start = {name: posed(twin, name, poses[0]) for name, poses in motion.objects.items()}
    handles = {o.name: [j.name for j in twin.joints if j.owner == o.name] for o in twin.objects}
    out: list[list[TermJudgement]] = [[] for _ in terms]
    for k in samples:
        now = {
            name: replace(
                thing,
                pose=motion.objects[name][k],
                handles=np.array([motion.handles[j][k] for j in handles[name]]).reshape(-1, 3),
            )
            for name, thing in start.items()
        }
        palm = motion.tcp[k, :3, 3]
        fractions = {name: float(values[k]) for name, values in motion.fractions.items()}
        for term, judged in zip(terms, out, strict=True):
            judged.append(judge_term(term, now, palm, rest_palm, start, twin.support_height, fractions))
    return out
