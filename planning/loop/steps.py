"""The subtask level: the steps of one plan, one after another; what fails is diagnosed and planned anew."""

from collections import Counter

from control.tasks.failure import FailureCause
from perception.estimates import SceneEstimate
from planning.language.answers import Plan, parse_plan
from planning.language.memory import NOBODY_KNOWS, FailedAttempt, cause_sentences
from planning.loop.diagnosis import diagnose
from planning.loop.ending import undone
from planning.loop.perceiver import about
from planning.loop.skills import carry_out_step
from planning.loop.state import LoopState


def carry_out(state: LoopState, plan: Plan, scene: SceneEstimate) -> tuple[str, SceneEstimate]:
    """Carry out a plan, with replanning as far as the settings allow.

    Args:
        state: Of the run.
        plan: With at least one step.
        scene: What was seen last.

    Returns:
        Why it failed ("" if it did not), and the last look.

    Raises:
        ReasonerError: No new plan could be had from the reasoner.
        PerceptionError: Nothing can be seen.
        RobotGoneError, StoppedError: The run cannot go on.
    """
    settings = state.context.settings
    queue, replans, tried = list(plan.steps), Counter[str](), 0
    while queue:
        action = queue.pop(0)
        tried += 1
        if tried > settings.max_steps:
            return f"the plan took more than {settings.max_steps} steps", scene
        outcome = carry_out_step(state, action, plan, scene)
        cause, scene = outcome.cause, outcome.scene
        if outcome.remaining is not None:
            queue.insert(0, outcome.remaining)
            continue
        if cause is None:
            state.finished.append(action)
            if not queue:
                why = undone(state, scene)
                return (f"all steps were done, but {why}" if why else ""), scene
            continue
        _diagnose(state, action, plan, cause, scene)
        if replans[action] >= settings.replans_allowed:
            return f"'{action}' failed {replans[action] + 1} times, last: {cause.message or cause.kind}", scene
        replans[action] += 1
        state.replans += 1
        fields = {"objects": scene.names, "goal": state.context.goal, **state.history(scene)}
        plan = state.planned(state.asker.ask("replan", fields, parse_plan))
        if not plan.steps:
            return state.why_no_plan(plan, scene), scene
        queue = list(plan.steps)
    return "", scene


def _diagnose(state: LoopState, action: str, plan: Plan, cause: FailureCause, scene: SceneEstimate) -> None:
    """Keep why a step failed: what was measured, and what the votes blame."""
    context = state.context
    state.memory.note_failure(cause)
    measured = cause_sentences(cause, scene.names) if state.sees else (NOBODY_KNOWS,)
    reasons: tuple[str, ...] = ()
    # What a reasoner could not put into words has no reason among the objects.
    if cause.kind != "reasoner_error" and state.sees:
        names, facts = (*scene.names, *context.joints(scene)), state.facts(scene)
        context.log("evidence", action=action, measured=measured, seen=about(action, facts))
        reasons = diagnose(
            action, names, facts, measured, state.asker, state.verifier, context.log, context.pictures()
        ).reasons
    reason = " ".join(dict.fromkeys((*measured, *reasons)))
    state.attempts.append(FailedAttempt(plan.steps, action, reason, tuple(state.finished)))
    context.log("failed_attempt", action=action, reason=reason)
    context.say(f"supposed reason: {reasons[0] if reasons else reason}")
