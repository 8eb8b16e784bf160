"""`replan run GOAL`: the main job."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from perception.options import PerceptionOptions
from replan.commands.flags import Repeated, SetOnly, Switches, options_in
from replan.commands.reasoner_flags import ReasonerFlags
from replan.options import CellOptions
from replan.run.options import MethodOptions, RecordingOptions, RunOptions, ScoringOptions

if TYPE_CHECKING:
    from replan.console import Console

Method = Literal["replan", "language-to-rewards", "one-shot-plan", "pddl", "task-and-motion"]
LeftOut = Annotated[tuple[Literal["verifier", "perceiver", "replan"], ...], tyro.conf.UseAppendAction]


@dataclass(frozen=True, kw_only=True)
class Run(RunOptions):
    """Reach a goal with a robot: look, plan, find a motion, judge it in the twin, play it, look again.

    Without --robot it starts a simulated cell of its own and says so. Every run leaves a folder with its event
    log, pictures and a video. Ctrl-C brings the arm to rest along its path.
    """

    goal: tyro.conf.Positional[str]
    cell: str = CellOptions.cell
    """Built-in cell (cubes, cubes-blocked, fruit-bowl, or one of docs/scenes.md) or a cell file (YAML)."""
    cell_options: Switches = CellOptions.cell_options
    """Switch of the cell to turn on, for instance lemon_in_bowl; may be repeated."""
    perception: tyro.conf.OmitArgPrefixes[PerceptionOptions] = field(default_factory=PerceptionOptions)
    reasoner: tyro.conf.OmitArgPrefixes[ReasonerFlags] = field(default_factory=ReasonerFlags)
    method: Method = MethodOptions.method  # pyright: ignore[reportAssignmentType]
    told: Repeated = MethodOptions.told
    without: LeftOut = MethodOptions.without  # pyright: ignore[reportAssignmentType]
    mcap: SetOnly = RecordingOptions.mcap
    strip: tyro.conf.Suppress[bool] = RecordingOptions.strip
    score: tyro.conf.Suppress[bool] = ScoringOptions.score
    poses: tyro.conf.Suppress[Literal["seen", "true"]] = ScoringOptions.poses
    json: SetOnly = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Run it; returns the exit code."""
        # Said before the heavy imports, so that a person sees at once what happens.
        console.note(f'goal: "{self.goal}" in cell {self.cell}')
        from replan.run.goal import run_goal

        reasoner = self.reasoner.options(self.perception.offline)
        report = run_goal(options_in(self, RunOptions, reasoner=reasoner), console.note)
        console.result(report.as_json(), report.as_text())
        return report.exit_code
