"""One trajectory replayed in one twin and held against every residual there."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from control.safety.certificate import CheckResult
from control.safety.limits import SafetyLimits
from control.safety.residuals import TwinMotion, safety_residuals
from control.safety.swept_volume import SweptUnseen, unseen_on_the_way
from control.simulation.motion_recording import Purpose, record_motion
from control.simulation.rollouts import Rollout
from control.tasks.motion_cost import judge_terms
from control.tasks.reward_spec import RewardSpec
from control.trajectory.samples import Trajectory
from control.twin_model import TwinModel
from sim_check.verdict.clearances import measure_clearances, phase_when_free
from sim_check.verdict.replay import replay

NOMINAL_STRIDE = 2  # every second state (4 ms) is looked at for contacts
PERTURBED_STRIDE = 5


@dataclass(frozen=True)
class ReplayQuestion:
    """What a trajectory is held against, whatever the twin.

    Attributes:
        trajectory: Retimed, 1 kHz.
        spec: What it should achieve, or None.
        handled: Objects and joints that may be touched, held and moved beside those of the spec.
        safety: The safety table.
        rest_palm: Tool centre point at rest in [m], shape (3,); it is the same in every twin of a cell.
    """

    trajectory: Trajectory
    spec: RewardSpec | None
    handled: frozenset[str]
    safety: SafetyLimits
    rest_palm: NDArray[np.float64]


@dataclass(frozen=True)
class Replayed:
    """How it went in one twin.

    Attributes:
        checks: Residuals and, with a spec, the reward; `simulation` alone where it exploded.
        steps: Simulated steps.
        rollout: Simulated states; None for a perturbed twin, of which there are too many to keep them.
        motion: As recorded, with clearances; None for a perturbed twin and where the simulation exploded.
        unseen: What of the way no camera has seen; None as for `motion`, and where no camera has looked.
    """

    checks: tuple[CheckResult, ...]
    steps: int
    rollout: Rollout | None = None
    motion: TwinMotion | None = None
    unseen: SweptUnseen | None = None

    @property
    def kept(self) -> bool:
        """Whether every check is kept."""
        return all(c.ok for c in self.checks)


def judge_replay(question: ReplayQuestion, twin: TwinModel, nominal: bool) -> Replayed:
    """Replay a trajectory in one twin and judge how it went.

    Args:
        question: The trajectory and what it is held against.
        twin: Where.
        nominal: Whether this is the twin as perceived: clearances are measured there, and more moments looked at.
    """
    safety = question.safety
    (rollout,), steps = replay(question.trajectory, [twin], safety.settle_time, nthread=1)
    if rollout.exploded:
        broken = CheckResult("simulation", float("inf"), 0.0, "m", False)
        return Replayed((broken,), steps, rollout if nominal else None)
    purpose = Purpose.in_twin(twin, question.spec, question.handled)
    motion = record_motion(rollout, twin, purpose, NOMINAL_STRIDE if nominal else PERTURBED_STRIDE)
    if nominal:
        near = measure_clearances(rollout, motion.time, twin, purpose, safety, phase_when_free(question.trajectory))
        motion = replace(motion, clearances=near)
    checks = tuple(r.check(motion) for r in safety_residuals(safety))
    if question.spec is not None:
        checks = (*checks, _reward(motion, twin, question.spec, safety, question.rest_palm))
    if not nominal:
        return Replayed(checks, steps)
    unseen = None
    if twin.seen is not None:
        unseen = unseen_on_the_way(twin.seen, rollout.model, rollout.qpos, rollout.time, rollout.commands.held)
        checks = (*checks, *unseen.checks(safety))
    return Replayed(checks, steps, rollout, motion, unseen)


def _reward(
    motion: TwinMotion, twin: TwinModel, spec: RewardSpec, safety: SafetyLimits, rest_palm: np.ndarray
) -> CheckResult:
    """The reward's terms, at their worst over the settling time: met early and lost again does not count.

    A term that is meant for the way counts at its best moment there.
    """
    first = int(np.searchsorted(motion.time, motion.time[-1] - safety.settle_time))
    rows = np.unique(np.linspace(first, len(motion.time) - 1, 6).astype(int))
    judged = judge_terms(motion, twin, spec, [int(k) for k in rows], rest_palm)
    worst = max(range(len(judged)), key=lambda i: (judged[i].residual, spec.terms[i].primary))
    lacks = judged[worst].residual
    at, names = float(motion.time[-1]), tuple(sorted(spec.terms[worst].names))
    return CheckResult("reward_met", lacks, 0.0, "m", lacks == 0.0, at, names)
