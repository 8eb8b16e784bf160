"""What a run of the loop has at hand, and what it has planned, tried, seen and achieved so far."""

from dataclasses import dataclass
from typing import Any

from control.tasks.reward_spec import RewardSpec
from perception.estimates import SceneEstimate
from planning.language.answers import Plan
from planning.language.memory import FailedAttempt
from planning.loop.context import RunContext
from planning.loop.learnt import CellMemory
from planning.loop.perceiver import Perceiver, describe
from planning.loop.results import StepRecord
from planning.loop.verifier import AsWritten, Checker, Verifier
from planning.loop.visual_targets import VisualTargets


@dataclass(frozen=True)
class Achieved:
    """A finished motion step, so that its result can be judged again at the end.

    Attributes:
        action: As the plan has it.
        spec: What it achieved.
        before: What was seen before it.
    """

    action: str
    spec: RewardSpec
    before: SceneEstimate


class LoopState:
    """One run's state; task, subtask and skill level share it.

    Args:
        context: What the run is given.

    Attributes:
        context: The same.
        asker: Puts questions.
        targets: What is looked for.
        verifier, perceiver, memory: Parts of the method.
        sees: Whether the perceiver takes part.
        plans, steps, attempts: Every plan made, every step tried, and every failed one with its reason, in order.
        finished, achieved: Steps that are done; the motions among them with what they achieved.
        observations: Questions about the scene with their answers.
        replans: How often a step or the whole plan was made anew.
    """

    def __init__(self, context: RunContext) -> None:
        without = context.settings.without
        self.context = context
        self.asker = context.asker()
        self.targets = VisualTargets(
            context.goal, context.known_names, context.observer, context.log, context.furniture
        )
        self.verifier: Checker = AsWritten(context.log) if "verifier" in without else Verifier(self.asker, context.log)
        self.perceiver = Perceiver(self.asker, context.log, self.facts)
        self.sees = "perceiver" not in without
        self.memory = CellMemory(context.furniture)
        self.plans: list[Plan] = []
        self.steps: list[StepRecord] = []
        self.attempts: list[FailedAttempt] = []
        self.finished: list[str] = []
        self.achieved: list[Achieved] = []
        self.observations: list[str] = []
        self.replans = 0

    def look(self) -> SceneEstimate:
        """A fresh look, from which the memory learns.

        Raises:
            PerceptionError: Nothing can be seen.
        """
        scene = self.targets.look()
        self.memory.note_look(scene)
        return scene

    def facts(self, scene: SceneEstimate) -> tuple[str, ...]:
        """What is seen, in sentences; nothing where nobody perceives."""
        return describe(scene, self.context.furniture) if self.sees else ()

    def history(self, scene: SceneEstimate) -> dict[str, Any]:
        """What a new plan should know, as fields of its prompt."""
        return {
            "facts": self.facts(scene),
            "learnt": self.memory.lines() if self.sees else (),
            "finished": tuple(self.finished),
            "attempts": tuple(self.attempts),
        }

    def planned(self, plan: Plan) -> Plan:
        """Note a plan."""
        self.plans.append(plan)
        self.context.log("plan", thought=plan.thought, steps=plan.steps)
        self.context.say(f"plan: {'; '.join(plan.steps) or 'none'} ({plan.thought})")
        return plan

    def why_no_plan(self, plan: Plan, scene: SceneEstimate) -> str:
        """Why the planner has no steps: what is missing, where something is, else its own words."""
        missing = self.targets.missing(scene)
        if not self.sees or not missing:
            return plan.thought
        pictures = self.context.pictures
        claimed = [n for n in missing if self.perceiver.claims_to_see(n, scene, pictures())]
        extra = f" (the perceiver sees {', '.join(claimed)}, but no pose was found)" if claimed else ""
        # The planner may have looked behind doors: its own words say what else it tried.
        # What was not understood matters more than what is not there.
        told = any(s.kind == "hands" for s in self.steps) or "in view" not in plan.thought
        return self.targets.missing_sentence(scene) + extra + (f"; {plan.thought}" if told else "")
