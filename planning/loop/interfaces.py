"""What the loop needs from outside: a scene observer, a motion executor and a term evaluator. Light: numpy at most."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from control.tasks.failure import FailureCause
from control.tasks.reward_spec import RewardSpec, RewardTerm
from perception.estimates import SceneEstimate


class SceneObserver(Protocol):
    """Cameras with perception behind them."""

    def look(self, names: Sequence[str]) -> SceneEstimate:
        """A fresh look for these names ("red_cube"); those not found are in `unseen`.

        Raises:
            UnknownPhraseError: One of the names is nothing that the detector can look for.
            PerceptionError: Nothing can be seen at all.
        """
        ...


@dataclass(frozen=True)
class AttemptResult:
    """What came of one attempt at a subtask.

    Attributes:
        ok: Whether a motion was played to its end as planned.
        cause: Why not; None when ok.
        scene_after: A look taken after the motion, if there was one; else the loop looks itself.
        stats: Numbers for the record.
    """

    ok: bool
    cause: FailureCause | None = None
    scene_after: SceneEstimate | None = None
    stats: dict[str, Any] = field(default_factory=dict)


class MotionExecutor(Protocol):
    """Motion search, verdict, robot: everything between a reward spec and a played motion."""

    def attempt(self, spec: RewardSpec, scene: SceneEstimate) -> AttemptResult:
        """Try to meet a spec, starting from what was seen.

        Raises:
            RefusedError: The driver refused the motion.
            RobotGoneError, StoppedError: The run cannot go on.
        """
        ...

    def explain(self, spec: RewardSpec, scene: SceneEstimate) -> FailureCause | None:
        """Why a motion that was played as planned does not show on what is seen now; None where nothing explains it."""
        ...


class TermResult(Protocol):
    """Whether a term is met (`control.tasks.predicates.TermJudgement` is one)."""

    @property
    def met(self) -> bool:
        """Whether the term is met."""
        ...

    @property
    def residual(self) -> float:
        """How far it is from being met, in the unit of the term; 0 where it is met."""
        ...

    @property
    def text(self) -> str:
        """What was seen, in a sentence."""
        ...


class TermEvaluator(Protocol):
    """Judges a primary term on what is seen."""

    def __call__(self, term: RewardTerm, scene: SceneEstimate, before: SceneEstimate, /) -> TermResult:
        """Judge `term` on `scene`.

        Args:
            term: What was wanted.
            scene: What is seen now.
            before: What was seen before the motion ("away from b" is measured from where b stood then).

        Raises:
            UnknownObjectError: An object of the term is not seen now.
        """
        ...
