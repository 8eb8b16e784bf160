"""One attempt of the executor and one look at its result, as typed causes, for loop and baselines."""

from collections.abc import Callable

from control.errors import RefusedError, RewardSpecError, UnknownObjectError
from control.tasks.failure import FailureCause
from control.tasks.reward_spec import RewardSpec, RewardTerm
from perception.estimates import SceneEstimate
from planning.loop.interfaces import MotionExecutor, TermEvaluator
from planning.reasoners.reasoner import Log


def attempt(
    executor: MotionExecutor, spec: RewardSpec, scene: SceneEstimate, log: Log
) -> tuple[FailureCause | None, SceneEstimate | None]:
    """Why nothing was played to its end (None if it was), and the look taken after the motion, if there was one.

    Raises:
        RobotGoneError, StoppedError: The run cannot go on.
    """
    subject = spec.primary.subject
    try:
        result = executor.attempt(spec, scene)
    except RefusedError as error:
        return FailureCause("refused_by_robot", subject, str(error), check=error.code), None
    except UnknownObjectError as error:
        return FailureCause("not_seen", subject, str(error)), None
    except RewardSpecError as error:
        # Well-formed, yet nothing that this executor can do: the planner may ask for it in another way.
        return FailureCause("reasoner_error", subject, str(error)), None
    log("attempt", ok=result.ok, cause=result.cause, stats=result.stats)
    if not result.ok and result.cause is None:
        return FailureCause("not_achieved", subject, "the motion failed without a cause"), result.scene_after
    return (None if result.ok else result.cause), result.scene_after


def judged(
    evaluator: TermEvaluator,
    term: RewardTerm,
    scene: SceneEstimate,
    before: SceneEstimate,
    log: Log,
    say: Callable[[str], None],
) -> tuple[FailureCause | None, str]:
    """Why a term is not seen to be met (None if it is), and what is seen, in a sentence."""
    try:
        judgement = evaluator(term, scene, before)
    except UnknownObjectError as error:
        return FailureCause("not_seen", term.subject, str(error)), str(error)
    log("judgement", term=term, met=judgement.met, residual=judgement.residual, text=judgement.text)
    say(f"seen: {judgement.text}" + ("" if judgement.met else " (not what was wanted)"))
    if judgement.met:
        return None, judgement.text
    evidence = {"residual": judgement.residual}
    return FailureCause("not_achieved", term.subject, judgement.text, evidence=evidence), judgement.text
