"""The whole plan in one go: a model that sees the picture writes it, and it is carried out as it stands.

Each step becomes rewards or a look as in the loop, but nothing is verified, no failure is diagnosed and nothing is
planned anew. The run ends at the first step that is not seen to be done. The goal itself is not looked at again: that
the last step is seen to be done is all.
"""

from control.errors import ReasonerError
from control.tasks.failure import FailureCause
from perception.estimates import SceneEstimate
from planning.baselines.common import Trial
from planning.language.answers import Plan, parse_completion, parse_plan, parse_yes_no
from planning.language.names import mentioned
from planning.loop.context import RunContext
from planning.loop.perceiver import Perceiver, describe
from planning.loop.results import GoalResult
from planning.loop.subtask import Scope, spec_for
from planning.loop.verifier import AsWritten
from planning.reasoners.reasoner import Asker


def run_one_shot_plan(context: RunContext) -> GoalResult:
    """Reach a goal by one plan, or say why not.

    The latest pictures go along with the question for the plan, and with the perceiver's. Of the settings only `tries`
    and `max_steps` are used.

    Raises:
        ReasonerError: No plan could be had from the reasoner.
        PerceptionError: Nothing can be seen.
        RobotGoneError, StoppedError, KeyboardInterrupt: Passed on untouched.
    """
    settings = context.settings
    trial, asker = Trial(context), context.asker()
    scene = trial.targets.look()
    fields = {"objects": scene.names, "goal": context.goal, "facts": describe(scene, context.furniture)}
    plan = trial.planned(asker.ask("high_level_plan", fields, parse_plan, context.pictures(), always_show=True))
    if not plan.steps:
        return trial.result(False, trial.missing_sentence(scene) or plan.thought, scene)
    run = _OneShot(trial, asker, plan)
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

    def __init__(self, trial: Trial, asker: Asker, plan: Plan) -> None:
        self._trial = trial
        self._context = trial.context
        self._asker = asker
        self._plan = plan
        furniture = trial.context.furniture
        self._perceiver = Perceiver(asker, trial.context.log, lambda scene: describe(scene, furniture))
        self._observations: list[str] = []

    def step(
        self, action: str, scene: SceneEstimate, queue: list[str]
    ) -> tuple[FailureCause | None, SceneEstimate, str]:
        """One step: why it failed (None if it did not), the latest look, and what was seen.

        A look that leaves a motion to be done puts it in front of the queue.
        """
        looks = self._asker.ask("action_kind", {"action": action}, parse_yes_no)
        self._context.log("route", action=action, kind="eyes" if looks else "hands")
        self._context.say(f"step: {action} ({'eyes' if looks else 'hands'})")
        if looks:
            return self._look(action, queue)
        scope = Scope(scene.names, self._context.joints(scene), self._plan.steps, tuple(self._observations))
        try:
            spec = spec_for(action, scope, self._asker, AsWritten(self._context.log), self._context.log)
        except ReasonerError as error:
            cause = FailureCause("reasoner_error", action, str(error))
            self._trial.done(action, cause)
            return cause, scene, cause.message
        return self._trial.motion(action, spec, scene)

    def _look(self, action: str, queue: list[str]) -> tuple[FailureCause | None, SceneEstimate, str]:
        trial, context = self._trial, self._context
        scene = trial.targets.look()
        joints = context.joints(scene)
        seen = self._perceiver.observe(context.goal, self._plan.steps, action, scene, joints, context.pictures())
        self._observations += [o for o in seen if o not in self._observations]
        fields = {"plan": self._plan.steps, "action": action, "observations": seen}
        done, remaining = self._asker.ask("action_completed", fields, parse_completion)
        context.log("looked", action=action, done=done, remaining=remaining)
        text = " ".join(o.split("? ", 1)[-1] for o in seen) or "no question about it could be answered"
        cause = None
        if remaining is not None:
            queue.insert(0, remaining)
        elif not done:
            subject = (mentioned(action, trial.targets.names) or trial.targets.missing(scene) or [action])[0]
            text = trial.missing_sentence(scene) or text
            cause = FailureCause("not_seen", subject, text)
        trial.done(action, cause, kind="eyes")
        return cause, scene, text
