"""What a run is given: its goal, the world that it looks at and acts in, who answers its questions, and its bounds."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from control.errors import GoalError
from perception.estimates import SceneEstimate
from planning.language.furnishings import KnownFurniture
from planning.loop.interfaces import MotionExecutor, SceneObserver, TermEvaluator
from planning.loop.results import LoopSettings
from planning.reasoners.reasoner import Asker, Log, Reasoner
from prompts.contracts import Role


def _silent(text: str, /) -> None:
    """Tell nobody."""


def _kept_nowhere(name: str, text: str, /) -> None:
    """Keep no file."""


def _no_pictures() -> Sequence[Any]:
    return ()


@dataclass(frozen=True, kw_only=True)
class RunContext:
    """One run's inputs, the same for the loop and for every baseline; a method uses those that it needs.

    Attributes:
        goal: In plain language.
        observer, executor, evaluator: The world, see `planning.loop.interfaces`.
        reasoner: Answers all prompts that `by_role` names no other one for.
        by_role: Other reasoners for single roles.
        known_names: Names that the cell says may be there; things that the goal speaks of are looked for besides.
        furniture: What is known of the cell's furniture, by name; looked for as well.
        told: What no camera sees, in the form of `planning.baselines.told`; only for methods that plan with symbols.
        log: Gets every prompt, answer, fault, drop, reward, vote and verdict.
        say: Gets a line of progress for people at a time.
        keep: Keeps a text as a file of the run, by its name.
        pictures: The latest colour pictures, uint8, shape (height, width, 3), for reasoners that see.
        settings: Bounds.

    Raises:
        GoalError: On construction, for an empty goal.
    """

    goal: str
    observer: SceneObserver
    executor: MotionExecutor
    evaluator: TermEvaluator
    reasoner: Reasoner
    by_role: Mapping[Role, Reasoner] = field(default_factory=lambda: MappingProxyType({}))
    known_names: Sequence[str]
    furniture: Mapping[str, KnownFurniture] = field(default_factory=lambda: MappingProxyType({}))
    told: Sequence[str] = ()
    log: Log
    say: Callable[[str], None] = _silent
    keep: Callable[[str, str], None] = _kept_nowhere
    pictures: Callable[[], Sequence[Any]] = _no_pictures
    settings: LoopSettings = field(default_factory=LoopSettings)

    def __post_init__(self) -> None:
        if not self.goal.strip():
            raise GoalError('the goal is empty; say what to reach, for instance "place the red cube on the crate"')

    def asker(self) -> Asker:
        """Puts questions to the run's reasoners, each as often as the settings allow."""
        return Asker(self.reasoner, self.log, self.settings.tries, self.by_role)

    def joints(self, scene: SceneEstimate) -> tuple[str, ...]:
        """Joints that a hand can drive, of furniture in view."""
        seen = [self.furniture[name] for name in scene.names if name in self.furniture]
        return tuple(j.name for thing in seen for j in thing.joints if j.by_hand)
