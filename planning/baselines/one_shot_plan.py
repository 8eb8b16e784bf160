"""The whole plan in one go: a model that sees the picture writes it, and it is carried out as it stands.

Each step becomes rewards or a look as in the loop, but nothing is verified, no failure is diagnosed and nothing is
planned anew. The run ends at the first step that is not seen to be done. The goal itself is not looked at again: that
the last step is seen to be done is all.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from control.errors import ReasonerError
from control.tasks.failure import FailureCause
from perception.estimates import SceneEstimate
from planning.baselines.common import Trial
from planning.language.answers import Plan, parse_completion, parse_plan, parse_yes_no
from planning.language.furnishings import KnownFurniture
from planning.language.names import mentioned
from planning.loop.interfaces import MotionExecutor, SceneObserver, TermEvaluator
from planning.loop.perceiver import Perceiver, describe
from planning.loop.results import GoalResult, LoopSettings
from planning.loop.subtask import Scope, spec_for
from planning.loop.verifier import AsWritten
from planning.reasoners.reasoner import Asker, Log, Reasoner
from prompts.contracts import Role


def run_one_shot_plan(
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
    """Reach a goal by one plan, or say why not.

    Args:
        goal: In plain language.
        reasoner, observer, executor, evaluator, known_names, log, say, by_role: As for the loop.
        furniture: What is known of the cell's furniture, by name.
        pictures: The latest colour pictures, uint8, shape (height, width, 3); they go along with the question for the
            plan, and with the perceiver's.
        settings: Only `tries` and `max_steps` are used.

    Raises:
        GoalError: The goal is empty.
        ReasonerError: No plan could be had from the reasoner.
        PerceptionError: Nothing can be seen.
        RobotGoneError, StoppedError, KeyboardInterrupt: Passed on untouched.
    """
    settings = settings or LoopSettings()
    trial = Trial(goal, observer, executor, evaluator, known_names, furniture, log, say)
    asker = Asker(reasoner, log, settings.tries, by_role)
    scene = trial.sight.look()
    fields = {"objects": scene.names, "goal": goal, "facts": describe(scene, furniture)}
    plan = trial.planned(asker.ask("high_level_plan", fields, parse_plan, pictures(), always_show=True))
    if not plan.steps:
        return trial.result(False, trial.missing_sentence(scene) or plan.thought, scene)
    run = _OneShot(trial, asker, plan, pictures, furniture)
    queue = list(plan.steps)
    text = ""
    while queue:
        action = queue.pop(0)
        if len(trial.steps) == settings.max_steps:
            return trial.result(False, f"the plan took more than {settings.max_steps} steps", scene)
        cause, scene, text = run.step(action, scene, queue)
        if cause is not None:
            return trial.result(False, f"'{action}' failed: {text}", scene)
    return trial.result(True, text, scene)


class _OneShot:
    """Carries out the steps of the one plan."""

    def __init__(
        self,
        trial: Trial,
        asker: Asker,
        plan: Plan,
        pictures: Callable[[], Sequence[Any]],
        furniture: Mapping[str, KnownFurniture],
    ) -> None:
        self._trial = trial
        self._asker = asker
        self._plan = plan
        self._pictures = pictures
        self._perceiver = Perceiver(asker, trial.log, lambda scene: describe(scene, furniture))
        self._observations: list[str] = []

    def step(
        self, action: str, scene: SceneEstimate, queue: list[str]
    ) -> tuple[FailureCause | None, SceneEstimate, str]:
        """One step: why it failed (None if it did not), the latest look, and what was seen.

        A look that leaves a motion to be done puts it in front of the queue.
        """
        looks = self._asker.ask("action_kind", {"action": action}, parse_yes_no)
        self._trial.log("route", action=action, kind="eyes" if looks else "hands")
        self._trial.say(f"step: {action} ({'eyes' if looks else 'hands'})")
        if looks:
            return self._look(action, queue)
        scope = Scope(scene.names, self._trial.joints(scene), self._plan.steps, tuple(self._observations))
        try:
            spec = spec_for(action, scope, self._asker, AsWritten(self._trial.log), self._trial.log)
        except ReasonerError as error:
            cause = FailureCause("reasoner_error", action, str(error))
            self._trial.done(action, cause)
            return cause, scene, cause.message
        return self._trial.motion(action, spec, scene)

    def _look(self, action: str, queue: list[str]) -> tuple[FailureCause | None, SceneEstimate, str]:
        trial = self._trial
        scene = trial.sight.look()
        seen = self._perceiver.observe(
            trial.goal, self._plan.steps, action, scene, trial.joints(scene), self._pictures()
        )
        self._observations += [o for o in seen if o not in self._observations]
        fields = {"plan": self._plan.steps, "action": action, "observations": seen}
        done, remaining = self._asker.ask("action_completed", fields, parse_completion)
        trial.log("looked", action=action, done=done, remaining=remaining)
        text = " ".join(o.split("? ", 1)[-1] for o in seen) or "no question about it could be answered"
        cause = None
        if remaining is not None:
            queue.insert(0, remaining)
        elif not done:
            subject = (mentioned(action, trial.sight.names) or trial.sight.missing(scene) or [action])[0]
            text = trial.missing_sentence(scene) or text
            cause = FailureCause("not_seen", subject, text)
        trial.done(action, cause, kind="eyes")
        return cause, scene, text
