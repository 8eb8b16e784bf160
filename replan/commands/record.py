"""`replan record OUT.mcap`: a cell's cameras into a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from replan.commands.flags import SetOnly, Switches, options_in
from replan.options import CellOptions
from replan.robot.options import RecordOptions

if TYPE_CHECKING:
    from replan.console import Console


@dataclass(frozen=True, kw_only=True)
class Record(RecordOptions):
    """Record a cell's cameras into an MCAP file that ROS 2's tools and `replan perceive` read.

    Without --robot it starts a simulated cell of its own and says so. Nothing moves. Without --seconds and --frames it
    records until Ctrl-C, which always leaves a complete file.
    """

    out: tyro.conf.Positional[Path]
    cell: str = CellOptions.cell
    """Built-in cell or a cell file (YAML); with --robot it says which cameras stand still."""
    cell_options: Switches = CellOptions.cell_options
    cameras: Annotated[tuple[str, ...], tyro.conf.arg(name="camera"), tyro.conf.UseAppendAction] = RecordOptions.cameras
    compress: SetOnly = RecordOptions.compress
    truth: SetOnly = RecordOptions.truth
    json: SetOnly = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Record; exit code 0 also when Ctrl-C, SIGTERM or SIGHUP ended it."""
        console.note(f"recording cell {self.cell}" if self.robot is None else f"recording the robot at {self.robot}")
        from replan.robot.record import record

        report = record(options_in(self, RecordOptions), console.note)
        console.result(report.as_json(), report.as_text())
        return report.exit_code
