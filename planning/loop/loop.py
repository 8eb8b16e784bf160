"""The RePlan loop, from its task level: which plan, and a new one where a plan failed.

Below it are the subtask level (`planning.loop.steps`: one plan's steps, with diagnosis and replanning) and the skill
level (`planning.loop.skills`: look or motion, which rewards).
"""

from collections.abc import Sequence
from typing import Any

from control.errors import GoalError
from perception.estimates import SceneEstimate
from planning.language.answers import Plan, parse_plan
from planning.language.memory import FailedPlan
from planning.loop.context import RunContext
from planning.loop.ending import what_holds
from planning.loop.results import GoalResult
from planning.loop.state import LoopState
from planning.loop.steps import carry_out


def run_loop(context: RunContext) -> GoalResult:
    """Reach a goal, or say why not.

    Raises:
        GoalError: The goal is not understood; nothing moved.
        ReasonerError: No plan could be had from the reasoner.
        PerceptionError: Nothing can be seen.
        RobotGoneError, StoppedError, KeyboardInterrupt: Passed on untouched.
    """
    state = LoopState(context)
    reached, reason, scene = _reach(state)
    causes = tuple(s.cause for s in state.steps if s.cause is not None)
    context.log("goal_result", reached=reached, reason=reason, replans=state.replans, causes=causes)
    return GoalResult(reached, reason, tuple(state.plans), tuple(state.steps), state.replans, causes, scene)


def _reach(state: LoopState) -> tuple[bool, str, SceneEstimate]:
    """Whether the goal was reached, why or why not, and the last look."""
    scene = state.look()
    failed: list[FailedPlan] = []
    why = ""
    for k in range(state.context.settings.plans_allowed):
        plan = _new_plan(state, scene, failed)
        if k > 0:
            state.replans += 1
        if not plan.steps:
            if not failed and not state.steps and not (state.sees and state.targets.missing(scene)):
                raise GoalError(plan.thought)  # nothing is missing: the goal was not understood
            why = state.why_no_plan(plan, scene)
            break
        why, scene = carry_out(state, plan, scene)
        if not why:
            return True, what_holds(state, scene), scene
        failed.append(FailedPlan(plan.thought, plan.steps, why))
        state.context.say(f"plan {k + 1} failed: {why}")
        state.context.log("plan_failed", number=k + 1, why=why)
    return False, why, scene


def _new_plan(state: LoopState, scene: SceneEstimate, failed: Sequence[FailedPlan]) -> Plan:
    fields: dict[str, Any] = {"objects": scene.names, "goal": state.context.goal, "facts": state.facts(scene)}
    if failed:
        fields |= state.history(scene) | {"failed_plans": tuple(failed)}
    return state.planned(state.asker.ask("new_plan" if failed else "high_level_plan", fields, parse_plan))
