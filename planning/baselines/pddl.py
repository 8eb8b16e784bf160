"""A classical planner: the perceived scene as PDDL, one plan, each action a reward spec, no replanning.

It knows what perception and the cell file know (what stands where, which doors are closed) and nothing that is hidden:
a bolt, or what a bar behind handles does, is in the domain only when it was told.
"""

import tempfile
from collections.abc import Callable
from pathlib import Path

from control.errors import GoalError
from control.tasks.failure import FailureCause
from perception.estimates import SceneEstimate
from planning.baselines.common import Trial
from planning.baselines.domain import distances, sentence, spec_of, symbolic_problem
from planning.baselines.pddl_text import write_pddl
from planning.baselines.solver import PLANNER, NoPlanError, solve_files
from planning.baselines.strips import Action, SymbolicProblem
from planning.baselines.symbolic_goals import SymbolicGoals, UnplannableError, read_symbolic_goals
from planning.baselines.told import read_told
from planning.language.answers import Plan
from planning.loop.context import RunContext
from planning.loop.results import GoalResult
from planning.reasoners.reasoner import Log

SOLVER_SECONDS = 60.0  # [s]


def run_pddl(context: RunContext, solver_seconds: float = SOLVER_SECONDS) -> GoalResult:
    """Reach a goal by one symbolic plan, or say why not.

    The goal is in the small language of goals (`planning.language.goal_language`). No language model is asked.

    Args:
        context: What the run is given; the problem is kept as domain.pddl and problem.pddl.
        solver_seconds: Wall time in [s] for the planner.

    Raises:
        ConfigError: A told fact cannot be read.
        MachineError: The planner is not installed.
        PerceptionError: Nothing can be seen.
        RobotGoneError, StoppedError, KeyboardInterrupt: Passed on untouched.
    """
    goal, furniture = context.goal, context.furniture
    trial = Trial(context)
    facts = read_told(context.told, furniture, trial.targets.names)
    first = trial.targets.look()
    try:
        goals = read_symbolic_goals(goal, first, furniture, facts)
        symbols = symbolic_problem(first, furniture, goals.told, goals.facts)
        actions = _plan(symbols, context.log, context.keep, solver_seconds) if symbols.goal else ()
    except (GoalError, UnplannableError, NoPlanError) as error:
        return trial.result(False, str(error), first)
    trial.planned(Plan("a shortest sequence, by what is seen and told", tuple(sentence(a) for a in actions)))
    scene, away = first, distances(first, furniture)
    for action in actions:
        spec = spec_of(action.skill, away)
        if spec is None:
            scene = trial.targets.look()
            trial.done(sentence(action), None, kind="eyes")
            continue
        context.say(f"step: {sentence(action)}")
        cause, scene, text = trial.motion(sentence(action), spec, scene)
        if cause is not None:
            return trial.result(False, f"'{sentence(action)}' failed: {text}", scene)
    return judged_goal(trial, goals, scene, first)


def judged_goal(trial: Trial, goals: SymbolicGoals, scene: SceneEstimate, first: SceneEstimate) -> GoalResult:
    """The end of a symbolic plan that was carried out: what of the goal is seen to hold.

    Args:
        trial: The run.
        goals: Symbolic goals of the run's goal.
        scene: What is seen now.
        first: What was seen at first.
    """
    seen: list[str] = []
    failed: list[tuple[FailureCause, str]] = []
    for term in (t for g in goals.lasting for t in g.terms):
        cause, text = trial.judged(term, scene, first)
        seen.append(text)
        if cause is not None:
            failed.append((cause, text))
    if failed:
        return trial.result(False, "; ".join(text for _, text in failed), scene, [cause for cause, _ in failed])
    return trial.result(True, "; ".join(seen or [g.text for g in goals.all]), scene)


def _plan(symbols: SymbolicProblem, log: Log, keep: Callable[[str, str], None], seconds: float) -> tuple[Action, ...]:
    """Write the problem down, solve it, and read the plan.

    Raises:
        NoPlanError: There is none, or the time was up.
    """
    text = write_pddl(symbols, "scene")
    log("pddl", domain=text.domain, problem=text.problem)
    keep("domain.pddl", text.domain)
    keep("problem.pddl", text.problem)
    with tempfile.TemporaryDirectory() as folder:
        domain, problem = Path(folder) / "domain.pddl", Path(folder) / "problem.pddl"
        domain.write_text(text.domain)
        problem.write_text(text.problem)
        steps = solve_files(domain, problem, seconds)
    log("solved", planner=PLANNER, plan=steps)
    return tuple(
        symbols.action(text.originals.get(name, name), [text.originals.get(a, a) for a in arguments])
        for name, arguments in steps
    )
