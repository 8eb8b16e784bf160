"""Bounds of a run, and what it leaves behind."""

from dataclasses import dataclass
from typing import Literal

from control.tasks.failure import FailureCause
from perception.estimates import SceneEstimate
from planning.language.answers import Plan
from planning.reasoners.reasoner import TRIES

Part = Literal["verifier", "perceiver", "replan"]


@dataclass(frozen=True)
class LoopSettings:
    """Bounds of a run.

    Attributes:
        replans: How often a failed step may be replanned within one plan.
        plans: How many plans may be made from scratch.
        tries: How often one question may be put to a reasoner.
        without: Parts that are left out, to see what they are worth. Without `verifier` reward programs are taken as
            they were written and names are not repaired; without `perceiver` nobody says what stands where, why a step
            failed or what a look shows; without `replan` the first failure is the end.
        max_steps: Steps carried out or attempted in one plan, replans included; the paper's longest task took 17.
    """

    replans: int = 3
    plans: int = 2
    tries: int = TRIES
    max_steps: int = 20
    without: frozenset[Part] = frozenset()

    @property
    def plans_allowed(self) -> int:
        """How many plans, with parts left out taken into account."""
        return 1 if "replan" in self.without else self.plans

    @property
    def replans_allowed(self) -> int:
        """How many replans of one step, with parts left out taken into account."""
        return 0 if "replan" in self.without else self.replans


@dataclass(frozen=True)
class StepRecord:
    """One step that was carried out or attempted.

    Attributes:
        action: As the plan has it.
        kind: "eyes" for a look, "hands" for a motion.
        ok: Whether it was achieved, as seen afterwards.
        cause: Why not; None when ok.
    """

    action: str
    kind: str
    ok: bool
    cause: FailureCause | None = None


@dataclass(frozen=True)
class GoalResult:
    """How a run ended.

    Attributes:
        reached: Whether everything that was wanted is seen to hold at the end.
        reason: One sentence for people.
        plans: Every plan, replans included, in order.
        steps: Every step tried, in order.
        replans: How often a step or the whole plan was made anew.
        causes: Every failure cause, in order.
        scene: What was seen last.
    """

    reached: bool
    reason: str
    plans: tuple[Plan, ...]
    steps: tuple[StepRecord, ...]
    replans: int
    causes: tuple[FailureCause, ...]
    scene: SceneEstimate | None = None
