"""The RePlan loop: task (which plan), subtask (eyes or hands), skill (which rewards), with diagnosis and replanning."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from control.errors import GoalError, ReasonerError
from control.tasks.failure import FailureCause
from control.tasks.reward_spec import PALM, RewardSpec
from perception.estimates import SceneEstimate
from planning.language.answers import Plan, parse_completion, parse_plan, parse_yes_no
from planning.language.furnishings import KnownFurniture
from planning.language.memory import NOBODY_KNOWS, FailedAttempt, FailedPlan, cause_sentences
from planning.language.names import mentioned
from planning.loop.attempt import attempt, judged
from planning.loop.diagnosis import diagnose
from planning.loop.interfaces import AttemptResult, MotionExecutor, SceneObserver, TermEvaluator
from planning.loop.learnt import CellMemory
from planning.loop.perceiver import Perceiver, about, describe
from planning.loop.results import GoalResult, LoopSettings, StepRecord
from planning.loop.subtask import Scope, spec_for
from planning.loop.verifier import AsWritten, Checker, Verifier
from planning.loop.visual_targets import VisualTargets
from planning.reasoners.reasoner import Asker, Log, Reasoner
from prompts.contracts import Role

__all__ = ["AttemptResult", "GoalResult", "LoopSettings", "StepRecord", "run_loop"]


def run_loop(
    goal: str,
    *,
    reasoner: Reasoner,
    observer: SceneObserver,
    executor: MotionExecutor,
    evaluator: TermEvaluator,
    known_names: Sequence[str],
    log: Log,
    say: Callable[[str], None] = lambda text: None,
    furniture: Mapping[str, KnownFurniture] | None = None,
    pictures: Callable[[], Sequence[Any]] = lambda: (),
    settings: LoopSettings | None = None,
    by_role: Mapping[Role, Reasoner] | None = None,
) -> GoalResult:
    """Reach a goal, or say why not.

    Args:
        goal: In plain language.
        reasoner: Answers all prompts that `by_role` names no other one for.
        observer, executor, evaluator: The world, see `planning.loop.interfaces`.
        known_names: Names that the cell says may be there; things that the goal speaks of are looked for besides.
        log: Gets every prompt, answer, fault, drop, reward, vote and verdict.
        say: Gets a line of progress for people at a time.
        furniture: What is known of the cell's furniture, by name.
        pictures: The latest colour pictures, uint8, shape (height, width, 3), for reasoners that see.
        settings: Bounds.
        by_role: Other reasoners for single roles.

    Raises:
        GoalError: The goal is empty or not understood; nothing moved.
        ReasonerError: No plan could be had from the reasoner.
        PerceptionError: Nothing can be seen.
        RobotGoneError, StoppedError, KeyboardInterrupt: Passed on untouched.
    """
    if not goal.strip():
        raise GoalError('the goal is empty; say what to reach, for instance "place the red cube on the crate"')
    settings = settings or LoopSettings()
    asker = Asker(reasoner, log, settings.tries, by_role)
    furniture = furniture or {}
    sight = VisualTargets(goal, known_names, observer, log, furniture)
    run = _Run(goal, sight, executor, evaluator, asker, log, say, furniture, pictures, settings)
    result = run.reach()
    log("goal_result", reached=result.reached, reason=result.reason, replans=result.replans, causes=result.causes)
    return result


@dataclass
class _Achieved:
    """A finished motion step, so that its result can be judged again at the end."""

    action: str
    spec: RewardSpec
    before: SceneEstimate


@dataclass
class _Run:
    """One run's state; `run_loop` is the way in."""

    goal: str
    sight: VisualTargets
    executor: MotionExecutor
    evaluator: TermEvaluator
    asker: Asker
    log: Log
    say: Callable[[str], None]
    furniture: Mapping[str, KnownFurniture]
    pictures: Callable[[], Sequence[Any]]
    settings: LoopSettings
    plans: list[Plan] = field(default_factory=list)
    steps: list[StepRecord] = field(default_factory=list)
    attempts: list[FailedAttempt] = field(default_factory=list)
    finished: list[str] = field(default_factory=list)
    achieved: list[_Achieved] = field(default_factory=list)
    observations: list[str] = field(default_factory=list)
    replans: int = 0

    def __post_init__(self) -> None:
        without = self.settings.without
        self.verifier: Checker = AsWritten(self.log) if "verifier" in without else Verifier(self.asker, self.log)
        self.perceiver = Perceiver(self.asker, self.log, self._facts)
        self.sees = "perceiver" not in without
        self.memory = CellMemory(self.furniture)
        self.plans_allowed, self.replans_allowed = self.settings.plans, self.settings.replans
        if "replan" in without:
            self.plans_allowed, self.replans_allowed = 1, 0

    def _facts(self, scene: SceneEstimate) -> tuple[str, ...]:
        """What is seen, in sentences; nothing where nobody perceives."""
        return describe(scene, self.furniture) if self.sees else ()

    def _look(self) -> SceneEstimate:
        scene = self.sight.look()
        self.memory.note_look(scene)
        return scene

    def _joints(self, scene: SceneEstimate) -> tuple[str, ...]:
        """Joints that a hand can drive, of furniture in view."""
        seen = [self.furniture[name] for name in scene.names if name in self.furniture]
        return tuple(j.name for thing in seen for j in thing.joints if j.by_hand)

    # -- task level --------------------------------------------------------------------------------------------------

    def reach(self) -> GoalResult:
        scene = self._look()
        failed_plans: list[FailedPlan] = []
        why = ""
        for k in range(self.plans_allowed):
            plan = self._new_plan(scene, failed_plans)
            if k > 0:
                self.replans += 1
            if not plan.steps:
                why = self._why_no_plan(plan, scene, first=not failed_plans)
                break
            why, scene = self._carry_out(plan, scene)
            if not why:
                return self._result(True, f"{self._held_true(scene)}", scene)
            failed_plans.append(FailedPlan(plan.thought, plan.steps, why))
            self.say(f"plan {k + 1} failed: {why}")
            self.log("plan_failed", number=k + 1, why=why)
        return self._result(False, why, scene)

    def _new_plan(self, scene: SceneEstimate, failed: Sequence[FailedPlan]) -> Plan:
        fields: dict[str, Any] = {"objects": scene.names, "goal": self.goal, "facts": self._facts(scene)}
        name = "high_level_plan"
        if failed:
            name = "new_plan"
            fields |= self._history(scene) | {"failed_plans": tuple(failed)}
        return self._noted(self.asker.ask(name, fields, parse_plan))

    def _history(self, scene: SceneEstimate) -> dict[str, Any]:
        learnt = self.memory.lines() if self.sees else ()
        return {
            "facts": self._facts(scene),
            "learnt": learnt,
            "finished": tuple(self.finished),
            "attempts": tuple(self.attempts),
        }

    def _noted(self, plan: Plan) -> Plan:
        self.plans.append(plan)
        self.log("plan", thought=plan.thought, steps=plan.steps)
        self.say(f"plan: {'; '.join(plan.steps) or 'none'} ({plan.thought})")
        return plan

    def _why_no_plan(self, plan: Plan, scene: SceneEstimate, first: bool) -> str:
        if self.sees and self.sight.missing(scene):
            claimed = [n for n in self.sight.missing(scene) if self.perceiver.claims_to_see(n, scene, self.pictures())]
            extra = f" (the perceiver sees {', '.join(claimed)}, but no pose was found)" if claimed else ""
            # The planner may have looked behind doors: its own words say what else it tried.
            # What was not understood matters more than what is not there.
            told = any(s.kind == "hands" for s in self.steps) or "in view" not in plan.thought
            tried = f"; {plan.thought}" if told else ""
            return self.sight.missing_sentence(scene) + extra + tried
        if first and not self.steps:
            raise GoalError(plan.thought)
        return plan.thought

    # -- subtask level -----------------------------------------------------------------------------------------------

    def _carry_out(self, plan: Plan, scene: SceneEstimate) -> tuple[str, SceneEstimate]:
        """Steps one after another, replanning failed ones: why it failed ("" if it did not), and the last look."""
        queue, replans, tried = list(plan.steps), Counter[str](), 0
        while queue:
            action = queue.pop(0)
            tried += 1
            if tried > self.settings.max_steps:
                return f"the plan took more than {self.settings.max_steps} steps", scene
            cause, scene, remaining = self._step(action, plan, scene)
            if remaining is not None:
                queue.insert(0, remaining)
                continue
            if cause is None:
                self.finished.append(action)
                if not queue:
                    why = self._undone(scene)
                    if not why:
                        return "", scene
                    return f"all steps were done, but {why}", scene
                continue
            self._diagnose(action, plan, cause, scene)
            if replans[action] >= self.replans_allowed:
                return f"'{action}' failed {replans[action] + 1} times, last: {self._last_reason(cause)}", scene
            replans[action] += 1
            self.replans += 1
            fields = {"objects": scene.names, "goal": self.goal, **self._history(scene)}
            plan = self._noted(self.asker.ask("replan", fields, parse_plan))
            if not plan.steps:
                return self._why_no_plan(plan, scene, first=False), scene
            queue = list(plan.steps)
        return "", scene

    def _step(
        self, action: str, plan: Plan, scene: SceneEstimate
    ) -> tuple[FailureCause | None, SceneEstimate, str | None]:
        """One step: its failure (None if none), the latest look, and a motion that remains to be done for it."""
        looks = self.asker.ask("action_kind", {"action": action}, parse_yes_no)
        self.log("route", action=action, kind="eyes" if looks else "hands")
        self.say(f"step: {action} ({'eyes' if looks else 'hands'})")
        if looks:
            return self._vision_step(action, plan)
        cause, scene = self._motion_step(action, plan, scene)
        self.steps.append(StepRecord(action, "hands", cause is None, cause))
        return cause, scene, None

    def _vision_step(self, action: str, plan: Plan) -> tuple[FailureCause | None, SceneEstimate, str | None]:
        scene = self._look()
        if not self.sees:
            self.log("looked", action=action, done=True, remaining=None, why="nobody perceives in this run")
            self.steps.append(StepRecord(action, "eyes", True, None))
            return None, scene, None
        seen = self.perceiver.observe(self.goal, plan.steps, action, scene, self._joints(scene), self.pictures())
        self.observations += [o for o in seen if o not in self.observations]
        fields = {"plan": plan.steps, "action": action, "observations": seen}
        done, remaining = self.asker.ask("action_completed", fields, parse_completion)
        self.log("looked", action=action, done=done, remaining=remaining)
        cause = None
        if not done and remaining is None:
            subject = (mentioned(action, self.sight.names) or self.sight.missing(scene) or [action])[0]
            cause = FailureCause("not_seen", subject, " ".join(seen) or "no question about it could be answered")
        self.steps.append(StepRecord(action, "eyes", done, cause))
        return cause, scene, remaining

    def _motion_step(self, action: str, plan: Plan, scene: SceneEstimate) -> tuple[FailureCause | None, SceneEstimate]:
        scope = Scope(scene.names, self._joints(scene), plan.steps, tuple(self.observations))
        try:
            spec = spec_for(action, scope, self.asker, self.verifier, self.log)
        except ReasonerError as error:
            self.log("undescribed", action=action, reason=str(error))
            return FailureCause("reasoner_error", action, str(error)), scene
        cause, after = attempt(self.executor, spec, scene, self.log)
        latest = after or self._look()  # a fresh look after every motion, whatever came of it
        if cause is None or cause.evidence.get("grasps_that_held"):
            # A handle that slipped out of the hand is a door that did not follow: what is seen tells whether it did.
            shown = self._judged(spec, latest, scene)
            if shown is not None and shown.kind == "not_achieved":
                shown = self.executor.explain(spec, latest) or shown
            cause = cause if cause is not None and shown is not None and shown.kind == "not_achieved" else shown
        if cause is not None:
            self.say(f"failed: {cause.kind}: {cause.message}")
        if cause is None:
            self.achieved.append(_Achieved(action, spec, scene))
        else:
            self.log("step_failed", action=action, cause=cause)
        return cause, latest

    def _judged(self, spec: RewardSpec, scene: SceneEstimate, before: SceneEstimate) -> FailureCause | None:
        """None when the primary term is seen to be met."""
        return judged(self.evaluator, spec.primary, scene, before, self.log, self.say)[0]

    def _diagnose(self, action: str, plan: Plan, cause: FailureCause, scene: SceneEstimate) -> None:
        self.memory.note_failure(cause)
        names = (*scene.names, *self._joints(scene))
        measured = cause_sentences(cause, scene.names) if self.sees else (NOBODY_KNOWS,)
        reasons: tuple[str, ...] = ()
        # What a reasoner could not put into words has no reason among the objects.
        if cause.kind != "reasoner_error" and self.sees:
            facts = self._facts(scene)
            self.log("evidence", action=action, measured=measured, seen=about(action, facts))
            reasons = diagnose(
                action, names, facts, measured, self.asker, self.verifier, self.log, self.pictures()
            ).reasons
        reason = " ".join(dict.fromkeys((*measured, *reasons)))
        self.attempts.append(FailedAttempt(plan.steps, action, reason, tuple(self.finished)))
        self.log("failed_attempt", action=action, reason=reason)
        self.say(f"supposed reason: {reasons[0] if reasons else reason}")

    def _last_reason(self, cause: FailureCause) -> str:
        return cause.message or cause.kind

    # -- the end -----------------------------------------------------------------------------------------------------

    def _lasting(self) -> list[_Achieved]:
        """Finished steps whose results should still hold: the last one per object, of what the goal speaks of.

        Where the palm is cannot be seen at the end, because motions end in the rest configuration.
        """
        last: dict[str, _Achieved] = {}
        for done in self.achieved:
            if PALM not in (done.spec.primary.subject, done.spec.primary.target):
                last[done.spec.primary.subject] = done
        named = {n: d for n, d in last.items() if n in self.sight.wanted}
        # A goal that only asks to find something wants nothing of what was moved on the way.
        return list((named or ({} if self.observations else last)).values())

    def _undone(self, scene: SceneEstimate) -> str:
        """What was achieved and no longer holds; "" if all does."""
        undone = []
        for done in self._lasting():
            cause = self._judged(done.spec, scene, done.before)
            if cause is not None:
                undone.append(cause.message)
                self.achieved = [d for d in self.achieved if d is not done]
                self.finished = [a for a in self.finished if a != done.action]
        # What was put somewhere has been judged there, and may be out of sight behind a door that was closed since.
        settled = {name for d in self.achieved for name in d.spec.primary.names}
        if any(name not in settled for name in self.sight.missing(scene)):
            undone.append(self.sight.missing_sentence(scene))
        return "; ".join(undone)

    def _held_true(self, scene: SceneEstimate) -> str:
        parts = []
        for done in self._lasting():
            parts.append(self.evaluator(done.spec.primary, scene, done.before).text)
        # The last answer to each question, without the question.
        answers = {o.split("? ", 1)[0]: o.split("? ", 1)[-1].rstrip(".") for o in self.observations}.values()
        return "; ".join(parts or answers) or "all steps were done"

    def _result(self, reached: bool, reason: str, scene: SceneEstimate) -> GoalResult:
        causes = tuple(s.cause for s in self.steps if s.cause is not None)
        return GoalResult(reached, reason, tuple(self.plans), tuple(self.steps), self.replans, causes, scene)
