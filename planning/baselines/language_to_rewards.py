"""Language to rewards: the whole goal becomes one motion description, one reward program, one motion.

No plan, no verifier, no diagnosis and no second try. The goal is reached when the judge sees the program's primary term
met after the motion.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from control.errors import ReasonerError
from control.tasks.failure import FailureCause
from planning.baselines.common import Trial
from planning.language.furnishings import KnownFurniture
from planning.loop.interfaces import MotionExecutor, SceneObserver, TermEvaluator
from planning.loop.results import GoalResult, LoopSettings
from planning.loop.subtask import Scope, spec_for
from planning.loop.verifier import AsWritten
from planning.reasoners.reasoner import Asker, Log, Reasoner
from prompts.contracts import Role


def run_language_to_rewards(
    goal: str,
    *,
    reasoner: Reasoner,
    observer: SceneObserver,
    executor: MotionExecutor,
    evaluator: TermEvaluator,
    known_names: Sequence[str],
    furniture: Mapping[str, KnownFurniture],
    log: Log,
    say: Callable[[str], None] = lambda text: None,
    pictures: Callable[[], Sequence[Any]] = lambda: (),
    settings: LoopSettings | None = None,
    by_role: Mapping[Role, Reasoner] | None = None,
) -> GoalResult:
    """Reach a goal by one motion, or say why not.

    Args:
        goal: In plain language; it stands where the loop's prompts have a step.
        reasoner, observer, executor, evaluator, known_names, log, say, by_role: As for the loop.
        furniture: What is known of the cell's furniture, by name.
        pictures: Not used: none of the questions is about a picture.
        settings: Only `tries` is used.

    Raises:
        GoalError: The goal is empty.
        PerceptionError: Nothing can be seen.
        RobotGoneError, StoppedError, KeyboardInterrupt: Passed on untouched.
    """
    trial = Trial(goal, observer, executor, evaluator, known_names, furniture, log, say)
    asker = Asker(reasoner, log, (settings or LoopSettings()).tries, by_role)
    scene = trial.sight.look()
    try:
        spec = spec_for(goal, Scope(scene.names, trial.joints(scene), (goal,), ()), asker, AsWritten(log), log)
    except ReasonerError as error:
        reason = trial.missing_sentence(scene) or str(error)
        trial.done(goal, FailureCause("reasoner_error", goal, reason))
        return trial.result(False, reason, scene)
    cause, scene, text = trial.motion(goal, spec, scene)
    return trial.result(cause is None, text, scene)
