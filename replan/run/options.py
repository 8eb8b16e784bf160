"""What a run is asked for, by the part of it that each option concerns."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from perception.options import PerceptionModels, PerceptionOptions
from planning.reasoners.options import ReasonerOptions
from replan.options import CellOptions, ConnectionOptions


@dataclass(frozen=True, kw_only=True)
class PlayingOptions:
    """How motions are played."""

    speed: float = 1.0
    """Pace of the simulated cell that is started, in times real time; 0 is as fast as it goes."""
    motion_speed: float | None = None
    """Share of the certified speed to play motions at, above 0 and at most 1: the arm moves slower on exactly the same
    path. Stays set on the robot; `replan robot speed` changes it while it moves. Default: as the robot is set."""
    acknowledge: bool = False
    """Say that you looked at the cell after a stop or reflex, and that it may move again."""
    go_on_after_stall: bool = False
    """In a simulated cell: when a process that stood still has ended a motion at rest on its path, acknowledge, look
    again and go on. Refused in front of a real robot, where a person has to look."""


@dataclass(frozen=True, kw_only=True)
class MethodOptions:
    """How a goal becomes motions; the names stand in `planning.baselines.METHODS` and `planning.loop.results.Part`."""

    method: str = "replan"
    """How the goal becomes motions: `replan`, or one of the baselines that it is compared with (docs/baselines.md)."""
    told: tuple[str, ...] = ()
    """What no camera sees, for `pddl` and `task-and-motion`: "JOINT is locked until JOINT is open" or "JOINT is blocked
    by OBJECT"; may be repeated."""
    without: tuple[str, ...] = ()
    """Part of the method to leave out, to see what it is worth; may be repeated."""


@dataclass(frozen=True, kw_only=True)
class RecordingOptions:
    """What a run leaves behind."""

    runs_dir: Path = Path("runs")
    """Where run folders are made."""
    video: bool = True
    """Film the run from the twin's side (a second or two at the end)."""
    mcap: bool = False
    """Also record the run into run.mcap for Foxglove, Rerun and ROS 2's tools (docs/ros2.md)."""
    strip: bool = True
    """Write what was seen as one picture, strip.png."""


@dataclass(frozen=True, kw_only=True)
class ScoringOptions:
    """For benchmarks only."""

    score: bool = False
    """Let a simulated cell that is started also answer scorers with the truth."""
    poses: Literal["seen", "true"] = "seen"
    """Where poses come from: perception, or from a cell that is scored the truth of what is in view."""


@dataclass(frozen=True)
class RunOptions(
    ScoringOptions, RecordingOptions, MethodOptions, PerceptionModels, PlayingOptions, ConnectionOptions, CellOptions
):
    """Everything that a run is asked for."""

    goal: str
    """What to reach, for instance "place the red cube on the crate"."""
    seed: int = field(default=0, kw_only=True)
    """Seed of planning, and of the simulated cell's placement when one is started."""
    perception: PerceptionOptions = field(default_factory=PerceptionOptions, kw_only=True)
    """How things are found in pictures."""
    reasoner: ReasonerOptions = field(default_factory=ReasonerOptions, kw_only=True)
    """Who answers the questions of planning."""
