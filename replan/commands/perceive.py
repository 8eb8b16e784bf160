"""`replan perceive RECORDING`: perception alone, on recorded frames or on one look at a robot's cameras."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from perception.options import PerceptionOptions
from replan.commands.flags import SetOnly, options_in
from replan.commands.recording_flags import ReadingFlags
from replan.perceive.options import PerceiveOptions

if TYPE_CHECKING:
    from replan.console import Console


@dataclass(frozen=True, kw_only=True)
class Perceive(PerceiveOptions):
    """Find objects and their poses in recorded RGB-D frames, without a robot.

    Reads folders of PNG pairs, BOP scenes, MCAP recordings of ROS 2 and this program's own look_*.npz, of any length.
    Writes into the output folder: objects.json (after every frame, so that stopping loses nothing), an overlay picture
    a frame, point clouds (PLY), and report.html, one page to look at; docs/perceive.md describes them. Frames that
    cannot be used are skipped and named. Where the recording says what truly was there, errors are measured.
    Exit code 0 when something was found, 3 when nothing was, 1 when no frame could be used.
    """

    recording: tyro.conf.Positional[Path]
    """Folder of colour and depth PNG pairs with an intrinsics file, BOP scene folder, .mcap, or .npz."""
    names: Annotated[tuple[str, ...], tyro.conf.arg(aliases=["-n"])] = PerceiveOptions.names
    page: Annotated[bool, tyro.conf.arg(name="report")] = PerceiveOptions.page
    reading: tyro.conf.OmitArgPrefixes[ReadingFlags] = field(default_factory=ReadingFlags)
    """Which frames are read."""
    perception: tyro.conf.OmitArgPrefixes[PerceptionOptions] = field(default_factory=PerceptionOptions)
    json: SetOnly = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Run it; returns the exit code."""
        console.note(f"reading {self.recording}")
        from replan.perceive.recording import perceive_recording
        from replan.perceive.report import as_json, as_text

        options = options_in(self, PerceiveOptions)
        report = perceive_recording(self.recording, options, self.reading.options(), console.note)
        console.result(as_json(report), as_text(report))
        return report.exit_code
