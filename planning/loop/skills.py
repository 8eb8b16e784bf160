"""The skill level: one step of a plan, carried out once, as a look with questions or as a motion."""

from dataclasses import dataclass

from control.errors import ReasonerError
from control.tasks.failure import FailureCause
from perception.estimates import SceneEstimate
from planning.language.answers import Plan, parse_completion, parse_yes_no
from planning.language.names import mentioned
from planning.loop.attempt import attempt, judged
from planning.loop.results import StepRecord
from planning.loop.state import Achieved, LoopState
from planning.loop.subtask import Scope, spec_for


@dataclass(frozen=True)
class StepOutcome:
    """What came of one step.

    Attributes:
        cause: Why it failed; None if it did not.
        scene: The latest look.
        remaining: A motion that remains to be done for it, or None.
    """

    cause: FailureCause | None
    scene: SceneEstimate
    remaining: str | None = None


def carry_out_step(state: LoopState, action: str, plan: Plan, scene: SceneEstimate) -> StepOutcome:
    """Ask whether a step is a look or a motion, and carry it out.

    Args:
        state: Of the run; gets the step's record, and what it achieved.
        action: The step.
        plan: That it is part of.
        scene: What was seen last.

    Raises:
        PerceptionError: Nothing can be seen.
        RobotGoneError, StoppedError: The run cannot go on.
    """
    looks = state.asker.ask("action_kind", {"action": action}, parse_yes_no)
    state.context.log("route", action=action, kind="eyes" if looks else "hands")
    state.context.say(f"step: {action} ({'eyes' if looks else 'hands'})")
    return _look(state, action, plan) if looks else _move(state, action, plan, scene)


def _look(state: LoopState, action: str, plan: Plan) -> StepOutcome:
    context = state.context
    scene = state.look()
    if not state.sees:
        context.log("looked", action=action, done=True, remaining=None, why="nobody perceives in this run")
        state.steps.append(StepRecord(action, "eyes", True, None))
        return StepOutcome(None, scene)
    joints = context.joints(scene)
    seen = state.perceiver.observe(context.goal, plan.steps, action, scene, joints, context.pictures())
    state.observations += [o for o in seen if o not in state.observations]
    fields = {"plan": plan.steps, "action": action, "observations": seen}
    done, remaining = state.asker.ask("action_completed", fields, parse_completion)
    context.log("looked", action=action, done=done, remaining=remaining)
    cause = None
    if not done and remaining is None:
        subject = (mentioned(action, state.targets.names) or state.targets.missing(scene) or [action])[0]
        cause = FailureCause("not_seen", subject, " ".join(seen) or "no question about it could be answered")
    state.steps.append(StepRecord(action, "eyes", done, cause))
    return StepOutcome(cause, scene, remaining)


def _move(state: LoopState, action: str, plan: Plan, scene: SceneEstimate) -> StepOutcome:
    cause, latest = _moved(state, action, plan, scene)
    state.steps.append(StepRecord(action, "hands", cause is None, cause))
    return StepOutcome(cause, latest)


def _moved(
    state: LoopState, action: str, plan: Plan, scene: SceneEstimate
) -> tuple[FailureCause | None, SceneEstimate]:
    """Why a motion step failed (None if it did not), and the latest look."""
    context = state.context
    scope = Scope(scene.names, context.joints(scene), plan.steps, tuple(state.observations))
    try:
        spec = spec_for(action, scope, state.asker, state.verifier, context.log)
    except ReasonerError as error:
        context.log("undescribed", action=action, reason=str(error))
        return FailureCause("reasoner_error", action, str(error)), scene
    cause, after = attempt(context.executor, spec, scene, context.log)
    latest = after or state.look()  # a fresh look after every motion, whatever came of it
    if cause is None or cause.evidence.get("grasps_that_held"):
        # A handle that slipped out of the hand is a door that did not follow: what is seen tells whether it did.
        shown, _ = judged(context.evaluator, spec.primary, latest, scene, context.log, context.say)
        if shown is not None and shown.kind == "not_achieved":
            shown = context.executor.explain(spec, latest) or shown
        cause = cause if cause is not None and shown is not None and shown.kind == "not_achieved" else shown
    if cause is None:
        state.achieved.append(Achieved(action, spec, scene))
    else:
        context.say(f"failed: {cause.kind}: {cause.message}")
        context.log("step_failed", action=action, cause=cause)
    return cause, latest
