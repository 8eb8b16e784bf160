"""Language to rewards: the whole goal becomes one motion description, one reward program, one motion.

No plan, no verifier, no diagnosis and no second try. The goal is reached when the term evaluator sees the program's
primary term met after the motion.
"""

from control.errors import ReasonerError
from control.tasks.failure import FailureCause
from planning.baselines.common import Trial
from planning.loop.context import RunContext
from planning.loop.results import GoalResult
from planning.loop.subtask import Scope, spec_for
from planning.loop.verifier import AsWritten


def run_language_to_rewards(context: RunContext) -> GoalResult:
    """Reach a goal by one motion, or say why not.

    The goal stands where the loop's prompts have a step. Of the settings only `tries` is used; none of the questions is
    about a picture.

    Raises:
        PerceptionError: Nothing can be seen.
        RobotGoneError, StoppedError, KeyboardInterrupt: Passed on untouched.
    """
    goal, log = context.goal, context.log
    trial, asker = Trial(context), context.asker()
    scene = trial.targets.look()
    try:
        spec = spec_for(goal, Scope(scene.names, context.joints(scene), (goal,), ()), asker, AsWritten(log), log)
    except ReasonerError as error:
        reason = trial.missing_sentence(scene) or str(error)
        trial.done(goal, FailureCause("reasoner_error", goal, reason))
        return trial.result(False, reason, scene)
    cause, scene, text = trial.motion(goal, spec, scene)
    return trial.result(cause is None, text, scene)
