"""What the loop is compared with, made of the same parts: world, prompts and parsers.

Each method is a function of a `planning.loop.context.RunContext`, as the loop is. `METHODS` names them all, the loop
first.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

from planning.loop.results import GoalResult

if TYPE_CHECKING:
    from planning.loop.context import RunContext


@dataclass(frozen=True)
class Method:
    """One way of reaching a goal.

    Attributes:
        what: In a few words, for help texts and reports.
        module, function: Where it is; imported when it is first used, for some need what others do not.
        symbolic: Whether it plans with symbols, and so can be told facts.
    """

    what: str
    module: str
    function: str
    symbolic: bool = False

    def run(self, context: "RunContext") -> GoalResult:
        """Reach a goal, or say why not; see the function for its errors."""
        return getattr(import_module(self.module), self.function)(context)


METHODS: Mapping[str, Method] = {
    "replan": Method("the loop: plan, rewards, motion, diagnosis, replanning", "planning.loop.loop", "run_loop"),
    "language-to-rewards": Method(
        "one reward program for the whole goal, one motion",
        "planning.baselines.language_to_rewards",
        "run_language_to_rewards",
    ),
    "one-shot-plan": Method(
        "one plan from the picture, no verifier, no replanning",
        "planning.baselines.one_shot_plan",
        "run_one_shot_plan",
    ),
    "pddl": Method(
        "a classical planner on what is seen and told", "planning.baselines.pddl", "run_pddl", symbolic=True
    ),
    "task-and-motion": Method(
        "a search over symbolic plans whose motions the twin checks",
        "planning.baselines.task_and_motion",
        "run_task_and_motion",
        symbolic=True,
    ),
}
