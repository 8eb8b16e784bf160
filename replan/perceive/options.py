"""Which frames of a recording are read, what is looked for in them, and what is written."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from control.errors import ConfigError
from perception.options import PerceptionModels, PerceptionOptions
from perception.recordings.mcap_choice import McapChoice


@dataclass(frozen=True, kw_only=True)
class ReadingOptions:
    """Which frames of a recording are read, and how.

    Raises:
        ConfigError: On construction, for a number below 1.
    """

    every: int = 1
    """Look at every so many frames of each camera only."""
    frames: int | None = None
    """Look at so many frames at most."""
    camera: str | None = None
    """Look through this camera only; default: all that were recorded."""
    intrinsics: Path | None = None
    """Intrinsics file (YAML or JSON: width, height, fx, fy, cx, cy, depth_scale), where the recording carries none."""
    depth_scale: float | None = None
    """Metres per unit of whole-numbered depth, whatever the recording says, for instance 0.001."""
    mcap: McapChoice = field(default_factory=McapChoice)
    """What to read out of an MCAP file."""
    models: Path | None = None
    """BOP: models_info.json of the data set, where it is not beside its scenes."""
    object_names: Path | None = None
    """BOP: YAML or JSON file with a name for each object id."""

    def __post_init__(self) -> None:
        for name, value in (("every", self.every), ("frames", self.frames)):
            if value is not None and value < 1:
                raise ConfigError(f"--{name} {value} is not valid; it must be at least 1")


@dataclass(frozen=True, kw_only=True)
class PerceiveOptions(PerceptionModels):
    """What is looked for, how, and what is written.

    Raises:
        ConfigError: On construction, for options that exclude each other.
    """

    names: tuple[str, ...] = ()
    """Objects to look for, for instance red_cube crate "coffee can"; default: all that --boxes or --masks name."""
    out: Path = Path("perceived")
    """Folder for everything that is written."""
    instances: int = 1
    """How many things one name may be; further ones are called red_cube_2, red_cube_3, ..."""
    cell: str | None = None
    """Built-in cell or a cell file whose furniture is looked for by its known shape, doors and all."""
    unnamed: bool = False
    """Add what nobody named: depth in the cell's workspace that neither the support nor named things explain. A
    recording does not say where a robot is, so its arm is among these things."""
    boxes: Path | None = None
    """Boxes drawn by hand instead of a detector: YAML or JSON, {boxes: {red_cube: [x0, y0, x1, y1]}} in pixels for
    every frame, {frames: {"000002": {red_cube: [...]}}} for one."""
    masks: Path | None = None
    """Masks drawn by hand instead of detector and segmenter: a folder with <name>.png for every frame or
    <frame>_<name>.png for one."""
    clouds: bool | None = None
    """Write a coloured point cloud a frame; default: for recordings of up to 20 frames."""
    page: bool = True
    """Write the page report.html."""
    perception: PerceptionOptions = field(default_factory=PerceptionOptions)
    """How things are found in pictures."""

    def __post_init__(self) -> None:
        if self.boxes is not None and self.masks is not None:
            raise ConfigError("--boxes and --masks exclude each other: masks say where things are already")
        if self.instances < 1:
            raise ConfigError(f"--instances {self.instances} is not valid; it must be at least 1")
        if not self.names and self.boxes is None and self.masks is None:
            raise ConfigError("no name given to look for; say --names red_cube crate")
