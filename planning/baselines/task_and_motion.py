"""Task and motion planning: a search over symbolic actions whose motions the twin checks before anything moves.

The actions are those of the classical planner (`planning.baselines.domain`). Sequences are searched best first, by
their length so far and the number of actions that symbols alone still ask for. When a sequence comes up, the motion of
its last action is found and judged in the twin, from where the sequence before it leads; a motion that is not possible
ends the sequence. Where the twin says which things are in the way, "this action needs them moved away" becomes a
condition of it, and the search goes on: what symbols lack comes from geometry. The first sequence that reaches the goal
in the twin is played as it was checked, and only then the cameras look again.

What no camera sees (bolts, things behind doors) is in no twin: such a plan is found sound and fails in the cell.

Simplifications: the scene after an action is predicted, not seen: things stand where the motion puts them in the twin,
without more spread than they had, and joints where it leaves them; later motions are checked on that. One motion is
checked per action and place in a sequence; another spot for the same thing is not tried.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from control.errors import GoalError, RefusedError, RewardSpecError, UnknownObjectError
from control.tasks.failure import FailureCause
from perception.estimates import SceneEstimate
from planning.baselines.common import Trial
from planning.baselines.domain import LOOSE, Distances, distances, sentence, spec_of, symbolic_problem
from planning.baselines.pddl import judged_goal
from planning.baselines.rehearsal import Rehearsal, RehearsingExecutor
from planning.baselines.strips import Action, State, SymbolicProblem, TooManyStatesError, shortest_plan, useful
from planning.baselines.symbolic_goals import UnplannableError, read_symbolic_goals
from planning.baselines.told import read_told
from planning.language.answers import Plan
from planning.loop.context import RunContext
from planning.loop.results import GoalResult
from planning.reasoners.reasoner import Log

MAX_CHECKS = 20  # motions checked in the twin; each takes seconds


def run_task_and_motion(context: RunContext, max_checks: int = MAX_CHECKS) -> GoalResult:
    """Reach a goal by one plan whose motions were all checked in the twin before, or say why not.

    The goal is in the small language of goals (`planning.language.goal_language`). No language model is asked and no
    file is written.

    Args:
        context: What the run is given, with an executor that is able to rehearse.
        max_checks: How many motions may be checked in the twin.

    Raises:
        ConfigError: A told fact cannot be read.
        PerceptionError: Nothing can be seen.
        RobotGoneError, StoppedError, KeyboardInterrupt: Passed on untouched.
    """
    furniture, executor = context.furniture, cast(RehearsingExecutor, context.executor)
    trial = Trial(context)
    facts = read_told(context.told, furniture, trial.targets.names)
    first = trial.targets.look()
    try:
        goals = read_symbolic_goals(context.goal, first, furniture, facts)
    except (GoalError, UnplannableError) as error:
        return trial.result(False, str(error), first)
    problem = symbolic_problem(first, furniture, goals.told, goals.facts)
    owners = {j.name: f.name for f in furniture.values() for j in f.joints}
    search = _Search(problem, owners, distances(first, furniture), executor, context.log, context.say)
    found = search.run(first, max_checks)
    if isinstance(found, str):
        return trial.result(False, found, first, search.causes)
    trial.planned(Plan(f"checked in the twin, {search.checks} motions", tuple(sentence(a) for a in found.actions)))
    for action, rehearsal in zip(found.actions, found.rehearsals, strict=True):
        if rehearsal is None:
            continue  # a look inside changes nothing here; the end looks anyway
        context.say(f"step: {sentence(action)}")
        cause = _played(executor, rehearsal, str(action.skill[1]))
        trial.done(sentence(action), cause)
        if cause is not None:
            return trial.result(False, f"'{sentence(action)}' failed: {cause.message}", trial.targets.look())
    return judged_goal(trial, goals, trial.targets.look() if found.actions else first, first)


def _played(executor: RehearsingExecutor, rehearsal: Rehearsal, subject: str) -> FailureCause | None:
    try:
        result = executor.play(rehearsal)
    except RefusedError as error:
        return FailureCause("refused_by_robot", subject, str(error), check=error.code)
    if result.ok:
        return None
    return result.cause or FailureCause("not_achieved", subject, "the motion failed without a cause")


@dataclass(frozen=True)
class _Sequence:
    """Actions whose motions were checked one after another.

    Attributes:
        actions, rehearsals: In order; no rehearsal for a look.
        facts: What is true after them.
        scene: What would be seen after them.
    """

    actions: tuple[Action, ...]
    rehearsals: tuple[Rehearsal | None, ...]
    facts: State
    scene: SceneEstimate

    @property
    def last_motion(self) -> Rehearsal | None:
        """The rehearsal that the next one follows."""
        return next((r for r in reversed(self.rehearsals) if r is not None), None)


_Key = tuple[str, tuple[str, ...]]  # an action's name and arguments


class _Search:
    """Best first over sequences; a motion is checked only when its sequence comes up.

    Attributes:
        checks: Motions checked so far.
        causes: Why motions were not possible, in order.
    """

    def __init__(
        self,
        problem: SymbolicProblem,
        owners: Mapping[str, str],
        away: Distances,
        executor: RehearsingExecutor,
        log: Log,
        say: Callable[[str], None],
    ) -> None:
        self._problem = problem
        self._owners = owners
        self._away = away
        self._executor = executor
        self._log = log
        self._say = say
        self._needs: dict[_Key, State] = {}
        self._apply_learned()
        self.checks = 0
        self.causes: list[FailureCause] = []

    def run(self, scene: SceneEstimate, max_checks: int) -> _Sequence | str:
        """The first sequence that reaches the goal with all of its motions checked; or why there is none.

        Args:
            scene: What is seen.
            max_checks: How many motions may be checked.
        """
        sequences = [_Sequence((), (), self._problem.initial, scene)]
        tried: set[tuple[int, _Key]] = set()
        if self._problem.goal <= self._problem.initial:
            return sequences[0]
        while self.checks < max_checks:
            try:
                best = self._best(sequences, tried)
            except TooManyStatesError as error:
                return str(error)
            if best is None:
                return f"no sequence of actions reaches the goal{self._last_words()}"
            number, action = best
            tried.add((number, _key(action)))
            longer = self._checked(sequences[number], action)
            if longer is not None and self._problem.goal <= longer.facts:
                return longer
            if longer is not None:
                sequences.append(longer)
        return f"no plan was found within {max_checks} checked motions{self._last_words()}"

    def _last_words(self) -> str:
        return f"; the last motion that was not possible: {self.causes[-1].message}" if self.causes else ""

    def _best(self, sequences: Sequence[_Sequence], tried: set[tuple[int, _Key]]) -> tuple[int, Action] | None:
        """The number of a sequence and the action to try after it; None when nothing is left.

        It is of the least length in all, and of equals the one that goes furthest.
        """
        best: tuple[int, int, int] | None = None
        choice = None
        for number, sequence in enumerate(sequences):
            length = len(sequence.actions) + 1
            for k, action in enumerate(self._actions):
                if (number, _key(action)) in tried or not action.possible_in(sequence.facts):
                    continue
                to_go = self._distance(action.result(sequence.facts))
                if to_go is not None and (best is None or (length + to_go, -length, k) < best):
                    best, choice = (length + to_go, -length, k), (number, action)
        return choice

    def _distance(self, facts: State) -> int | None:
        """How many actions symbols alone still ask for; None when nothing leads to the goal."""
        if facts not in self._to_go:
            plan = shortest_plan(self._actions, facts, self._problem.goal)
            self._to_go[facts] = None if plan is None else len(plan)
        return self._to_go[facts]

    def _checked(self, before: _Sequence, action: Action) -> _Sequence | None:
        """The sequence with one action more, if its motion is possible; else what is in the way is learned."""
        spec = spec_of(action.skill, self._away)
        facts = action.result(before.facts)
        if spec is None:
            return _Sequence((*before.actions, action), (*before.rehearsals, None), facts, before.scene)
        self.checks += 1
        self._say(f"checking in the twin: {'; '.join(sentence(a) for a in (*before.actions, action))}")
        subject = spec.primary.subject
        try:
            found = self._executor.rehearse(spec, before.scene, before.last_motion)
        except UnknownObjectError as error:
            found = FailureCause("not_seen", subject, str(error))
        except RewardSpecError as error:
            found = FailureCause("reasoner_error", subject, str(error))
        if isinstance(found, Rehearsal):
            self._log("checked", action=sentence(action), possible=True)
            return _Sequence((*before.actions, action), (*before.rehearsals, found), facts, found.scene)
        learned = self._learn(before, action, found)
        self._log("checked", action=sentence(action), possible=False, cause=found, learned=sorted(learned))
        self._say(f"not possible: {found.message}")
        self.causes.append(found)
        return None

    def _learn(self, before: _Sequence, action: Action, cause: FailureCause) -> State:
        """What an action needs besides, from what was in its way: that these things are moved away."""
        bodies = cause.bodies if cause.kind == "blocked_by" else ()
        new = (
            frozenset(("is-away", body, self._place(body, action, before)) for body in bodies if self._can_move(body))
            - before.facts
        )
        if new:
            self._needs[_key(action)] = self._needs.get(_key(action), frozenset()) | new
            self._apply_learned()
        return new

    def _can_move(self, body: str) -> bool:
        return body in self._problem.objects and self._problem.is_a(body, LOOSE)

    def _place(self, body: str, action: Action, before: _Sequence) -> str:
        """What a body must go away from: what it rests on, else the nearest of what the action is about."""
        about = [self._owners.get(n, n) for n in action.skill[1:] if self._owners.get(n, n) in before.scene.names]
        carried_by = [n for n in about if ("rests-on", body, n) in before.facts]
        at = before.scene.get(body)

        def gap(name: str) -> float:
            other = before.scene.get(name)
            return np.inf if at is None or other is None else float(np.linalg.norm(at.position - other.position))

        return (carried_by or sorted((n for n in about if n != body), key=gap))[0]

    def _apply_learned(self) -> None:
        """Actions with all that they are known to need; distances to the goal are counted anew."""
        known = [replace(a, needs=a.needs | self._needs.get(_key(a), frozenset())) for a in self._problem.actions()]
        self._actions = useful(known, self._problem.goal)
        self._to_go: dict[State, int | None] = {}


def _key(action: Action) -> _Key:
    return action.name, action.arguments
