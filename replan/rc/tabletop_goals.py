"""Whole goals in seeded simulated cells, judged on the cell's truth.

The scorers here are the only code outside the simulated cell that reads true poses, through a message that a cell
sends only when it was started for scoring. Nothing of it reaches the run that is being judged.
"""

import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from control.errors import ConfigError, StackError
from perception.errors import PerceptionError
from perception.options import PerceptionModels
from replan.run.goal import run_goal
from replan.run.options import RunOptions

Poses = Mapping[str, np.ndarray]  # name -> true world_T_object, (4, 4)
UNTOUCHED = 0.02  # [m]; how far an object that the goal does not name may have moved
UPRIGHT = np.cos(np.radians(10.0))


def _rests_on(after: Poses, top: str, below: str, heights: tuple[float, float], reach: float) -> bool:
    """Whether the centre of `top` is above `below` within `reach` and exactly the two half heights apart (5 mm)."""
    offset = after[top][:3, 3] - after[below][:3, 3]
    return bool(np.hypot(*offset[:2]) <= reach and abs(offset[2] - sum(heights)) < 0.005)


def _red_on_crate(_before: Poses, after: Poses) -> bool:
    axes = np.abs(after["red_cube"][2, :3]).max()  # one face up
    return _rests_on(after, "red_cube", "crate", (0.025, 0.03), 0.055) and axes > UPRIGHT


def _yellow_away(_before: Poses, after: Poses) -> bool:
    offset = after["yellow_cube"][:3, 3] - after["crate"][:3, 3]
    return bool(np.linalg.norm(offset) > 0.15 and abs(after["yellow_cube"][2, 3] - 0.025) < 0.005)


def _apple_in_bowl(_before: Poses, after: Poses) -> bool:
    offset = after["apple"][:3, 3] - after["bowl"][:3, 3]
    return bool(np.hypot(*offset[:2]) < 0.05 and offset[2] < 0.03)


@dataclass(frozen=True)
class BenchGoal:
    """One goal of the benchmark.

    Attributes:
        goal: As a person types it.
        cell: Built-in cell.
        names: Objects that may be moved; all others must stay within `UNTOUCHED`.
        scorer: (true poses before, after) -> whether the goal was reached.
        options: Options of the cell that are on.
    """

    goal: str
    cell: str
    names: tuple[str, ...]
    scorer: Callable[[Poses, Poses], bool]
    options: tuple[str, ...] = ()


GOALS = {
    "red_on_crate": BenchGoal("place the red cube on the crate", "cubes", ("red_cube",), _red_on_crate),
    "yellow_away": BenchGoal(
        "move the yellow cube away from the crate", "cubes-blocked", ("yellow_cube",), _yellow_away
    ),
    "apple_in_bowl": BenchGoal("place the apple in the bowl", "fruit-bowl", ("apple",), _apple_in_bowl),
    "red_on_blocked_crate": BenchGoal(
        "place the red cube on the crate", "cubes-blocked", ("red_cube", "yellow_cube"), _red_on_crate
    ),
    "apple_in_bowl_with_lemon": BenchGoal(
        "place the apple in the bowl", "fruit-bowl", ("apple", "lemon"), _apple_in_bowl, ("lemon_in_bowl",)
    ),
}


@dataclass
class GoalScore:
    """What was measured for one goal; lists have one entry a run."""

    success: list[bool] = field(default_factory=list)
    claimed: list[bool] = field(default_factory=list)
    wall_s: list[float] = field(default_factory=list)
    steps: list[int] = field(default_factory=list)
    replans: list[int] = field(default_factory=list)
    reasons: list[str] = field(default_factory=list)
    violations: list[int] = field(default_factory=list)
    trajectories: int = 0

    def as_json(self) -> dict[str, Any]:
        """Counts and medians."""
        return {
            "runs": len(self.success),
            "success": sum(self.success),
            "claimed": sum(self.claimed),
            "median_wall_s": round(statistics.median(self.wall_s), 2),
            "median_steps": int(statistics.median(self.steps)),
            "median_replans": statistics.median(self.replans),
            "trajectories": self.trajectories,
            "limit_violations": sum(self.violations),
            "failures": {k: r for k, (ok, r) in enumerate(zip(self.success, self.reasons, strict=True)) if not ok},
        }


@dataclass(frozen=True)
class BenchReport:
    """All goals, and what was seen with."""

    goals: dict[str, GoalScore]
    speed: float
    models: PerceptionModels

    def as_json(self) -> dict[str, Any]:
        """As one JSON object."""
        seen_with = {"detector": self.models.detector, "segmenter": self.models.segmenter}
        return {
            "speed": self.speed,
            **seen_with,
            "goals": {name: score.as_json() for name, score in self.goals.items()},
        }

    def as_text(self) -> str:
        """As a table."""
        head = ("goal", "success", "claimed", "median s", "median steps", "replans", "violations")
        lines = ["{:26} {:>9} {:>8} {:>9} {:>13} {:>8} {:>11}".format(*head)]
        for name, score in self.goals.items():
            s = score.as_json()
            lines.append(
                f"{name:26} {s['success']:>4}/{s['runs']:<4} {s['claimed']:>8} {s['median_wall_s']:>9} "
                f"{s['median_steps']:>13} {s['median_replans']:>8} {s['limit_violations']:>4}/{s['trajectories']:<6}"
            )
            lines += [f"    seed {seed}: {reason}" for seed, reason in s["failures"].items()]
        return "\n".join(lines)


def bench_goals(
    runs: int,
    names: tuple[str, ...],
    speed: float,
    runs_dir: Path,
    say: Callable[[str], None],
    models: PerceptionModels,
) -> BenchReport:
    """Run the goals with seeds 0 .. runs - 1.

    Args:
        runs: Runs a goal.
        names: Keys of `GOALS`; empty for all.
        speed: Pace of the simulated cells in times real time; 0 as fast as they go.
        runs_dir: Where the runs' folders go.
        say: Progress.
        models: Who finds things in pictures.

    Raises:
        ConfigError: An unknown goal.
    """
    unknown = [n for n in names if n not in GOALS]
    if unknown:
        raise ConfigError(f"no benchmark goal named '{unknown[0]}'; there are {sorted(GOALS)}")
    scores = {name: GoalScore() for name in names or GOALS}
    for name, score in scores.items():
        for seed in range(runs):
            goal = GOALS[name]
            options = RunOptions(
                goal.goal, cell=goal.cell, cell_options=goal.options, seed=seed, speed=speed, runs_dir=runs_dir,
                video=False, strip=False, score=True, detector=models.detector, segmenter=models.segmenter,
            )  # fmt: skip
            _run_once(goal, options, score)
            word = "ok" if score.success[-1] else f"FAILED ({score.reasons[-1]})"
            say(f"{name} seed {seed}: {word}, {score.wall_s[-1]:.1f} s, {score.steps[-1]} steps")
    return BenchReport(scores, speed, models)


def _limit_checks(folder: Path, cell: str) -> list[int]:
    """Limits broken by each trajectory that a run sent, by the checker that shares no code with the retimer."""
    from control.motion_files.reading import read_motion
    from control.motion_files.resampling import to_trajectory
    from control.robot.dynamics import RobotModel
    from control.safety.trajectory_checks import check_trajectory
    from sim_check.cells.loading import load_cell

    planned = load_cell(cell)
    gripper, safety = planned.robot.gripper_model, planned.safety_limits()
    robot, limits = RobotModel.panda(gripper=gripper), planned.robot.limits()
    broken = []
    for file in sorted(folder.glob("trajectory_*.npz")):
        trajectory = to_trajectory(read_motion(file))
        checks = check_trajectory(trajectory, limits, safety, robot.torque, robot.tcp_poses)
        broken.append(sum(not c.ok for c in checks))
    return broken


def _run_once(goal: BenchGoal, options: RunOptions, score: GoalScore) -> None:
    truth: dict[str, Poses] = {}
    started = time.monotonic()
    try:
        report = run_goal(
            options,
            say=lambda _text: None,
            on_client=lambda when, client: truth.update({when: client.truth().poses}),
        )
    except (StackError, PerceptionError) as error:
        score.success.append(False)
        score.claimed.append(False)
        score.wall_s.append(time.monotonic() - started)
        score.steps.append(0)
        score.violations.append(0)
        score.replans.append(0)
        score.reasons.append(f"{type(error).__name__}: {error}")
        return
    before, after = truth["before"], truth["after"]
    disturbed = [
        n for n in before if n not in goal.names and np.linalg.norm(after[n][:3, 3] - before[n][:3, 3]) > UNTOUCHED
    ]
    reached = goal.scorer(before, after)
    sent = _limit_checks(report.folder, goal.cell)
    score.trajectories += len(sent)
    score.violations.append(sum(sent))
    score.success.append(reached and not disturbed)
    score.claimed.append(report.reached)
    score.wall_s.append(report.seconds)
    score.steps.append(report.steps)
    score.replans.append(report.replans)
    score.reasons.append(f"moved {', '.join(disturbed)}; {report.reason}" if disturbed else report.reason)
