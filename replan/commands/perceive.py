"""`replan perceive RECORDING`: perception alone, on recorded frames or on one look at a robot's cameras."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from replan.commands.perception_flags import PerceptionFlags
from replan.commands.recording_flags import RecordingFlags

if TYPE_CHECKING:
    from replan.console import Console


@dataclass(frozen=True)
class Perceive:
    """Find objects and their poses in recorded RGB-D frames, without a robot.

    Reads folders of PNG pairs, BOP scenes, MCAP recordings of ROS 2 and this program's own look_*.npz, of any length.
    Writes into the output folder: objects.json (after every frame, so that stopping loses nothing), an overlay picture
    a frame, point clouds (PLY), and report.html, one page to look at; docs/perceive.md describes them. Frames that
    cannot be used are skipped and named. Where the recording says what truly was there, errors are measured.
    Exit code 0 when something was found, 3 when nothing was, 1 when no frame could be used.
    """

    recording: tyro.conf.Positional[Path]
    """Folder of colour and depth PNG pairs with an intrinsics file, BOP scene folder, .mcap, or .npz."""
    names: Annotated[tuple[str, ...], tyro.conf.arg(aliases=["-n"])] = ()
    """Objects to look for, for instance red_cube crate "coffee can"; default: all that --boxes or --masks name."""
    out: Path = Path("perceived")
    """Folder for everything that is written."""
    instances: int = 1
    """How many things one name may be; further ones are called red_cube_2, red_cube_3, ..."""
    cell: str | None = None
    """Built-in cell or a cell file whose furniture is looked for by its known shape, doors and all."""
    boxes: Path | None = None
    """Boxes drawn by hand instead of a detector: YAML or JSON, {boxes: {red_cube: [x0, y0, x1, y1]}} in pixels for
    every frame, {frames: {"000002": {red_cube: [...]}}} for one."""
    masks: Path | None = None
    """Masks drawn by hand instead of detector and segmenter: a folder with <name>.png for every frame or
    <frame>_<name>.png for one."""
    clouds: bool | None = None
    """Write a coloured point cloud a frame; default: for recordings of up to 20 frames."""
    report: bool = True
    """Write the page report.html."""
    reading: tyro.conf.OmitArgPrefixes[RecordingFlags] = field(default_factory=RecordingFlags)
    """Which frames are read."""
    perception: tyro.conf.OmitArgPrefixes[PerceptionFlags] = field(default_factory=PerceptionFlags)
    """How things are found in pictures."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Run it; returns the exit code."""
        console.note(f"reading {self.recording}")
        from replan.perceive.options import Perceiving
        from replan.perceive.recording import as_json, as_text, perceive_recording

        how = Perceiving(
            names=self.names,
            out=self.out,
            detector=self.perception.detector,
            segmenter=self.perception.segmenter,
            options=self.perception.options(),
            instances=self.instances,
            cell=self.cell,
            boxes=self.boxes,
            masks=self.masks,
            clouds=self.clouds,
            page=self.report,
            say=console.note,
        )
        report = perceive_recording(self.reading.choice(self.recording), how)
        console.result(as_json(report), as_text(report))
        return report.exit_code
