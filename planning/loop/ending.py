"""The end of a plan: whether what was achieved still holds, on what is seen now."""

from control.tasks.reward_spec import PALM
from perception.estimates import SceneEstimate
from planning.loop.attempt import judged
from planning.loop.state import Achieved, LoopState


def undone(state: LoopState, scene: SceneEstimate) -> str:
    """What was achieved and no longer holds, which counts as unfinished from now on; "" if all does."""
    context = state.context
    lost = []
    for done in _lasting(state):
        cause, _ = judged(context.evaluator, done.spec.primary, scene, done.before, context.log, context.say)
        if cause is not None:
            lost.append(cause.message)
            state.achieved = [d for d in state.achieved if d is not done]
            state.finished = [a for a in state.finished if a != done.action]
    # What was put somewhere has been judged there, and may be out of sight behind a door that was closed since.
    settled = {name for d in state.achieved for name in d.spec.primary.names}
    if any(name not in settled for name in state.targets.missing(scene)):
        lost.append(state.targets.missing_sentence(scene))
    return "; ".join(lost)


def what_holds(state: LoopState, scene: SceneEstimate) -> str:
    """What the run has come to, in a sentence for people."""
    parts = [state.context.evaluator(d.spec.primary, scene, d.before).text for d in _lasting(state)]
    # The last answer to each question, without the question.
    answers = {o.split("? ", 1)[0]: o.split("? ", 1)[-1].rstrip(".") for o in state.observations}.values()
    return "; ".join(parts or answers) or "all steps were done"


def _lasting(state: LoopState) -> list[Achieved]:
    """Finished steps whose results should still hold: the last one per object, of what the goal speaks of.

    Where the palm is cannot be seen at the end, because motions end in the rest configuration.
    """
    last: dict[str, Achieved] = {}
    for done in state.achieved:
        if PALM not in (done.spec.primary.subject, done.spec.primary.target):
            last[done.spec.primary.subject] = done
    named = {n: d for n, d in last.items() if n in state.targets.wanted}
    # A goal that only asks to find something wants nothing of what was moved on the way.
    return list((named or ({} if state.observations else last)).values())
