"""What to perceive in which frames of a recording, and what to write of it."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from control.errors import ConfigError
from perception.options import PerceptionOptions
from perception.recordings.opening import McapChoice


@dataclass(frozen=True)
class RecordingChoice:
    """A recording and which of its frames to read.

    Attributes:
        path: Folder of PNG pairs, BOP scene, MCAP or .npz file, see `perception.recordings.opening`.
        intrinsics, depth_scale, models, object_names: As in `perception.recordings.opening.open_recording`.
        mcap: What to read out of an MCAP file.
        camera: Name of the only camera to look through; None for all.
        every: Look at every so many frames only.
        frames: Look at so many at most; None for all.

    Raises:
        ConfigError: On construction, for a number below 1.
    """

    path: Path
    intrinsics: Path | None = None
    depth_scale: float | None = None
    models: Path | None = None
    object_names: Path | None = None
    mcap: McapChoice = field(default_factory=McapChoice)
    camera: str | None = None
    every: int = 1
    frames: int | None = None

    def __post_init__(self) -> None:
        for name, value in (("every", self.every), ("frames", self.frames)):
            if value is not None and value < 1:
                raise ConfigError(f"--{name} {value} is not valid; it must be at least 1")


@dataclass(frozen=True)
class Perceiving:
    """What is looked for, how, and what is written.

    Attributes:
        names: What to look for; empty for all names that boxes or masks are given for.
        out: Folder for what is written.
        detector, segmenter, options: As in `perception.pipeline.perception_from_options`.
        instances: How many things one name may be.
        cell: Built-in cell or cell file whose furniture may be looked for by its known shape; None for none.
        boxes: File of boxes in the place of a detector, see `perception.detection.given`.
        masks: Folder of masks in the place of a detector and a segmenter.
        clouds: Whether to write a point cloud of each frame; None for recordings of few frames only.
        page: Whether to write report.html.
        say: Progress.
        quiet: Whether to draw no bar on a terminal; `say` gets lines then.

    Raises:
        ConfigError: On construction, for options that exclude each other.
    """

    names: tuple[str, ...]
    out: Path
    detector: str = "default"
    segmenter: str = "default"
    options: PerceptionOptions = field(default_factory=PerceptionOptions)
    instances: int = 1
    cell: str | None = None
    boxes: Path | None = None
    masks: Path | None = None
    clouds: bool | None = None
    page: bool = True
    say: Callable[[str], None] = print
    quiet: bool = False

    def __post_init__(self) -> None:
        if self.boxes is not None and self.masks is not None:
            raise ConfigError("--boxes and --masks exclude each other: masks say where things are already")
        if self.instances < 1:
            raise ConfigError(f"--instances {self.instances} is not valid; it must be at least 1")
        if not self.names and self.boxes is None and self.masks is None:
            raise ConfigError("no name given to look for; say --names red_cube crate")
