"""What all baselines share: names to look for, motions that are played and judged once, and the result."""

from collections.abc import Iterable

from control.tasks.failure import FailureCause
from control.tasks.reward_spec import RewardSpec, RewardTerm
from perception.estimates import SceneEstimate
from planning.language.answers import Plan
from planning.loop.attempt import attempt, judged
from planning.loop.context import RunContext
from planning.loop.results import GoalResult, StepRecord
from planning.loop.visual_targets import VisualTargets


class Trial:
    """One run of a baseline: looks, plays, judges and keeps count; it never tries anything twice.

    Args:
        context: What the run is given; its log gets the same events as the loop's.

    Attributes:
        context: The same.
        targets: Looks for the names.
        plans, steps: What was planned and tried so far.
    """

    def __init__(self, context: RunContext) -> None:
        self.context = context
        self.targets = VisualTargets(
            context.goal, context.known_names, context.observer, context.log, context.furniture
        )
        self.plans: list[Plan] = []
        self.steps: list[StepRecord] = []

    def planned(self, plan: Plan) -> Plan:
        """Note a plan."""
        self.plans.append(plan)
        self.context.log("plan", thought=plan.thought, steps=plan.steps)
        self.context.say(f"plan: {'; '.join(plan.steps) or 'none'} ({plan.thought})")
        return plan

    def motion(
        self, action: str, spec: RewardSpec, scene: SceneEstimate
    ) -> tuple[FailureCause | None, SceneEstimate, str]:
        """Attempt a spec once, look, and judge its primary term on what is seen.

        Returns:
            Why it failed (None if it did not), the latest look, and what was seen, in a sentence.
        """
        cause = self.attempted(spec, scene)
        latest = self.targets.look()
        text = "" if cause is None else cause.message
        if cause is None or cause.evidence.get("grasps_that_held"):
            # Of a handle that slipped out of the hand, what is seen tells whether the door followed.
            failed, seen = self.judged(spec.primary, latest, scene)
            if cause is None or failed is None:
                cause, text = failed, seen
        self.done(action, cause)
        return cause, latest, text

    def attempted(self, spec: RewardSpec, scene: SceneEstimate) -> FailureCause | None:
        """One attempt of the executor; why nothing was played to its end, or None."""
        return attempt(self.context.executor, spec, scene, self.context.log)[0]

    def judged(self, term: RewardTerm, scene: SceneEstimate, before: SceneEstimate) -> tuple[FailureCause | None, str]:
        """Why a term is not seen to be met (None if it is), and what is seen, in a sentence."""
        context = self.context
        return judged(context.evaluator, term, scene, before, context.log, context.say)

    def done(self, action: str, cause: FailureCause | None, kind: str = "hands") -> None:
        """Note a step that was tried."""
        self.steps.append(StepRecord(action, kind, cause is None, cause))
        if cause is not None:
            self.context.log("step_failed", action=action, cause=cause)
            self.context.say(f"failed: {cause.kind}: {cause.message}")

    def missing_sentence(self, scene: SceneEstimate) -> str:
        """What the goal speaks of and is not in view, for people; "" when all is there."""
        return self.targets.missing_sentence(scene) if self.targets.missing(scene) else ""

    def result(
        self, reached: bool, reason: str, scene: SceneEstimate, causes: Iterable[FailureCause] = ()
    ) -> GoalResult:
        """How the run ended.

        Args:
            reached: Whether the goal is seen to hold.
            reason: One sentence for people.
            scene: What was seen last.
            causes: Causes besides those of the steps tried.
        """
        of_steps = tuple(s.cause for s in self.steps if s.cause is not None)
        result = GoalResult(reached, reason, tuple(self.plans), tuple(self.steps), 0, (*causes, *of_steps), scene)
        self.context.log("goal_result", reached=reached, reason=reason, replans=0, causes=result.causes)
        return result
