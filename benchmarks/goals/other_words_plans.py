"""First plans for goals in other words: what the planner would begin with, without perception and without any motion.

The planning loop runs up to its first motion. Its observer gets the true poses of what the cameras show at the start
(the arm drawn as its collision body), so what is behind a closed door has none; its executor ends the run as soon as it
is asked for anything. This takes about a second a goal where a run takes a minute, and says less: a plan with steps may
still be a wrong one, so only refusals, and answers that need no motion, are judged. Things are found by the names that
they have in the cell alone: a word that only a detector would have understood is not in view here.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from benchmarks.goals.other_words_goals import GOALS, Ending, fulfilled
from control.errors import GoalError, StackError
from control.tasks.failure import FailureCause
from control.tasks.reward_spec import RewardSpec
from control.twin_model import TCP_SITE
from perception.errors import PerceptionError
from perception.estimates import SceneEstimate
from perception.frames import RgbdFrame
from planning.builtin.reasoner import BuiltinReasoner
from planning.language.furnishings import known_furniture
from planning.loop.context import RunContext
from planning.loop.interfaces import AttemptResult
from planning.loop.loop import run_loop
from replan.run.term_evaluator import SeenTermEvaluator
from replan.run.true_poses import TruePoses
from sim_check.cells.loading import load_cell
from sim_check.world.world import World, build_world


@dataclass(frozen=True)
class PlanRow:
    """What the planner began with.

    Attributes:
        name: Key of `GOALS`.
        parsed: Whether the goal was understood.
        steps: Of the first plan; empty if there was none, or none was needed.
        moves: Whether it came to a motion.
        ended: Where it came to none: whether that was right, as a refusal or an answer; None where it did.
        reason: What it said, or the first motion that it asked for.
    """

    name: str
    parsed: bool
    steps: tuple[str, ...]
    moves: bool
    ended: bool | None
    reason: str


class FirstMotion(Exception):
    """Ends a planning loop that asked for a motion."""


class _TrueObserver:
    """Sees what the cameras of a world that stands still truly show."""

    def __init__(self, world: World, furniture: Sequence[str]) -> None:
        self._poses = TruePoses(world, furniture)
        self._frames = [_frame(world, camera.name) for camera in world.cameras]

    def look(self, names: Sequence[str]) -> SceneEstimate:
        return self._poses.perceive(self._frames, (*names, *self._poses.known))


def _frame(world: World, camera: str) -> RgbdFrame:
    colour, depth, world_T_camera, intrinsics = world.render(camera)
    return RgbdFrame(colour, depth, intrinsics, world_T_camera, 0.0, camera)


class _NoExecutor:
    """Moves nothing."""

    def attempt(self, spec: RewardSpec, scene: SceneEstimate) -> AttemptResult:
        raise FirstMotion(f"first motion: {spec.primary}")

    def explain(self, spec: RewardSpec, scene: SceneEstimate) -> FailureCause | None:
        return None  # nothing was played that could be explained


def plan_one(name: str) -> PlanRow:
    """Plan for one goal.

    Args:
        name: Key of `GOALS`.

    Raises:
        ConfigError: There is no way to render on this machine.
    """
    goal = GOALS[name]
    cell = load_cell(goal.cell_file, dict.fromkeys(goal.options, True))
    world = build_world(cell, goal.seed, meshes=False)
    try:
        observer, truth = _TrueObserver(world, tuple(cell.furniture)), world.truth()
        palm = np.array(world.data.site(TCP_SITE).xpos)  # the arm is at rest
        plans: list[tuple[str, ...]] = []

        def log(event: str, /, **data: Any) -> None:
            if event == "plan":
                plans.append(tuple(data["steps"]))

        parsed, moves, claimed = True, False, False
        try:
            context = RunContext(
                goal=goal.goal,
                reasoner=BuiltinReasoner(),
                observer=observer,
                executor=_NoExecutor(),
                evaluator=SeenTermEvaluator(lambda: palm, palm, cell.furniture),
                known_names=cell.objects,
                log=log,
                furniture=known_furniture(cell.furniture),
            )
            result = run_loop(context)
            claimed, reason = result.reached, result.reason
        except FirstMotion as motion:
            moves, reason = True, str(motion)
        except (StackError, PerceptionError) as error:
            parsed, reason = not isinstance(error, GoalError), f"{type(error).__name__}: {error}"
    finally:
        world.close()
    ended = None
    if not moves:
        ended, wrong = fulfilled(goal, Ending(claimed, reason, truth, truth))
        reason = f"{wrong}; {reason}" if wrong else reason
    return PlanRow(name, parsed, plans[0] if plans else (), moves, ended, reason)


def plan_counts(rows: Sequence[PlanRow]) -> dict[str, int]:
    """How many goals were parsed and planned, are to be refused and were, and were answered without a motion."""
    to_refuse = [r for r in rows if GOALS[r.name].reached is None]
    return {
        "goals": len(rows),
        "parsed": sum(r.parsed for r in rows),
        "planned": sum(bool(r.steps) for r in rows),
        "to_be_refused": len(to_refuse),
        "refused_as_expected": sum(r.ended is True for r in to_refuse),
        "answered_at_once": sum(r.ended is True and bool(GOALS[r.name].answer) for r in rows),
        "ended_wrongly": sum(r.ended is False for r in rows),
    }


def plan_summary(rows: Sequence[PlanRow]) -> dict[str, object]:
    """Counts and rows, ready for JSON."""
    return {**plan_counts(rows), "rows": [asdict(r) for r in rows]}


def print_plans(rows: Sequence[PlanRow]) -> None:
    """Three lines a goal, and the counts."""
    for r in rows:
        ended = {None: "would move", True: "ended as it should", False: "ended wrongly"}[r.ended]
        print(f"{r.name}: {GOALS[r.name].goal}\n    {'; '.join(r.steps) or 'no steps'}\n    {ended}: {r.reason}")
    print("; ".join(f"{what.replace('_', ' ')}: {count}" for what, count in plan_counts(rows).items()))
