"""`replan record OUT.mcap`: a cell's cameras into a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

if TYPE_CHECKING:
    from replan.console import Console


@dataclass(frozen=True)
class Record:
    """Record a cell's cameras into an MCAP file that ROS 2's tools and `replan perceive` read.

    Without --robot it starts a simulated cell of its own and says so. Nothing moves. Without --seconds and --frames it
    records until Ctrl-C, which always leaves a complete file.
    """

    out: tyro.conf.Positional[Path]
    """File to write, ending in .mcap."""
    robot: str | None = None
    """Endpoint of a running robot process or router, for instance tcp/127.0.0.1:7447, or tls/HOST:PORT with --link.
    Default: start a simulated cell."""
    link: Path | None = None
    """Link file with this machine's certificates, for tls/ endpoints (docs/security.md)."""
    cell: str = "cubes"
    """Built-in cell or a cell file (YAML); with --robot it says which cameras stand still."""
    option: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """Switch of the cell to turn on; may be repeated."""
    seed: int = 0
    """Seed of the simulated cell that is started."""
    camera: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """Camera to record; may be repeated. Default: all."""
    seconds: float | None = None
    """How long to record."""
    frames: int | None = None
    """How many frames of each camera to record."""
    rate: float = 5.0
    """Frames a second of each camera; a slower cell is recorded as fast as it goes."""
    depth: Literal["16UC1", "32FC1"] = "16UC1"
    """Depth in whole millimetres, or in floating point metres exactly as the camera gives it."""
    compress: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Pictures as PNG: smaller, nothing is lost, for 16UC1 only."""
    truth: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Also record what truly is in each picture, for scorers; only simulated cells started with --score say it."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Record; exit code 0 also when Ctrl-C, SIGTERM or SIGHUP ended it."""
        console.note(f"recording cell {self.cell}" if self.robot is None else f"recording the robot at {self.robot}")
        from replan.robot.record import RecordOptions, record

        report = record(
            RecordOptions(
                out=self.out,
                robot=self.robot,
                link=self.link,
                cell=self.cell,
                cell_options=tuple(self.option),
                seed=self.seed,
                cameras=tuple(self.camera),
                seconds=self.seconds,
                frames=self.frames,
                rate=self.rate,
                depth=self.depth,
                compress=self.compress,
                truth=self.truth,
            ),
            console.note,
        )
        console.result(report.as_json(), report.as_text())
        return report.exit_code
