"""`replan run GOAL`: the main job."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from replan.commands.perception_flags import PerceptionFlags
from replan.commands.reasoner_flags import ReasonerFlags

if TYPE_CHECKING:
    from replan.console import Console


@dataclass(frozen=True)
class Run:
    """Reach a goal with a robot: look, plan, find a motion, judge it in the twin, play it, look again.

    Without --robot it starts a simulated cell of its own and says so. Every run leaves a folder with its event
    log, pictures and a video. Ctrl-C brings the arm to rest along its path.
    """

    goal: tyro.conf.Positional[str]
    """What to reach, for instance "place the red cube on the crate"."""
    cell: str = "cubes"
    """Built-in cell (cubes, cubes-blocked, fruit-bowl, or one of docs/scenes.md) or a cell file (YAML)."""
    option: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """Switch of the cell to turn on, for instance lemon_in_bowl; may be repeated."""
    robot: str | None = None
    """Endpoint of a running robot process or router, for instance tcp/127.0.0.1:7447, or tls/HOST:PORT with --link.
    Default: start a simulated cell."""
    link: Path | None = None
    """Link file with this machine's certificates, for tls/ endpoints (docs/security.md)."""
    seed: int = 0
    """Seed of planning, and of the simulated cell's placement when one is started."""
    speed: float = 1.0
    """Pace of the simulated cell that is started, in times real time; 0 is as fast as it goes."""
    motion_speed: float | None = None
    """Share of the certified speed to play motions at, above 0 and at most 1: the arm moves slower on exactly the same
    path. Stays set on the robot; `replan robot speed` changes it while it moves. Default: as the robot is set."""
    perception: tyro.conf.OmitArgPrefixes[PerceptionFlags] = field(default_factory=PerceptionFlags)
    """How things are found in pictures."""
    language: tyro.conf.OmitArgPrefixes[ReasonerFlags] = field(default_factory=ReasonerFlags)
    """Who answers the questions of planning."""
    method: Literal["replan", "language-to-rewards", "one-shot-plan", "pddl", "task-and-motion"] = "replan"
    """How the goal becomes motions: `replan`, or one of the baselines that it is compared with (docs/baselines.md)."""
    told: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """What no camera sees, for `pddl` and `task-and-motion`: "JOINT is locked until JOINT is open" or "JOINT is blocked
    by OBJECT"; may be repeated."""
    without: tyro.conf.UseAppendAction[tuple[Literal["verifier", "perceiver", "replan"], ...]] = ()
    """Part of the method to leave out, to see what it is worth; may be repeated."""
    runs_dir: Path = Path("runs")
    """Where run folders are made."""
    video: bool = True
    """Film the run from the twin's side (a second or two at the end)."""
    mcap: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Also record the run into run.mcap for Foxglove, Rerun and ROS 2's tools (docs/ros2.md)."""
    acknowledge: bool = False
    """Say that you looked at the cell after a stop or reflex, and that it may move again."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Run it; returns the exit code."""
        # Said before the heavy imports, so that a person sees at once what happens.
        console.note(f'goal: "{self.goal}" in cell {self.cell}')
        from replan.run.goal import RunOptions, run_goal

        report = run_goal(
            RunOptions(
                goal=self.goal,
                cell=self.cell,
                cell_options=tuple(self.option),
                robot=self.robot,
                link=self.link,
                seed=self.seed,
                speed=self.speed,
                motion_speed=self.motion_speed,
                detector=self.perception.detector,
                segmenter=self.perception.segmenter,
                perception=self.perception.options(),
                reasoner=self.language.options(self.perception.offline),
                method=self.method,
                told=tuple(self.told),
                without=tuple(self.without),
                runs_dir=self.runs_dir,
                video=self.video,
                mcap=self.mcap,
                acknowledge=self.acknowledge,
            ),
            console.note,
        )
        console.result(report.as_json(), report.as_text())
        return report.exit_code
