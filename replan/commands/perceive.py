"""`replan perceive RECORDING`: perception alone, on recorded frames or on one look at a robot's cameras."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from replan.commands.perception_flags import PerceptionFlags

if TYPE_CHECKING:
    from replan.console import Console


@dataclass(frozen=True)
class Perceive:
    """Find objects and their poses in recorded RGB-D frames, without a robot.

    Writes an overlay picture and a coloured point cloud (PLY) per frame, and objects.json, into the output folder.
    """

    recording: tyro.conf.Positional[Path]
    """Folder of colour and depth PNG pairs with an intrinsics file, or an .npz of the project's own frames."""
    names: Annotated[tuple[str, ...], tyro.conf.arg(aliases=["-n"])]
    """Objects to look for, for instance red_cube crate "coffee can"."""
    intrinsics: Path | None = None
    """Intrinsics file (YAML or JSON: width, height, fx, fy, cx, cy, depth_scale) when the folder holds none."""
    out: Path = Path("perceived")
    """Folder for pictures and objects.json."""
    perception: tyro.conf.OmitArgPrefixes[PerceptionFlags] = field(default_factory=PerceptionFlags)
    """How things are found in pictures."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Run it; exit code 0 when every frame was read, 3 when no object was found in any."""
        console.note(f"reading {self.recording}")
        from replan.perceive import perceive_recording

        report = perceive_recording(
            self.recording,
            self.names,
            self.out,
            self.perception.detector,
            self.perception.segmenter,
            self.perception.options(),
            console.note,
            intrinsics=self.intrinsics,
        )
        console.result(report.as_json(), report.as_text())
        return report.exit_code
