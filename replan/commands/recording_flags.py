"""Options that say how a recording is read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from replan.perceive.options import RecordingChoice


@dataclass(frozen=True)
class RecordingFlags:
    """Which frames of a recording are read, and how."""

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
    colour_topic: str | None = None
    """MCAP: topic of colour pictures, where several could be meant."""
    depth_topic: str | None = None
    """MCAP: topic of depth pictures registered to them."""
    info_topic: str | None = None
    """MCAP: topic of their CameraInfo."""
    world: str | None = None
    """MCAP: frame of the transforms that poses are given in; default: world, map or the robot's base."""
    stamp_tolerance: float = 0.02
    """MCAP: by how much the stamps of colour and depth of one frame may differ, in [s]."""
    models: Path | None = None
    """BOP: models_info.json of the data set, where it is not beside its scenes."""
    object_names: Path | None = None
    """BOP: YAML or JSON file with a name for each object id."""

    def choice(self, recording: Path) -> RecordingChoice:
        """The recording and these options, checked.

        Raises:
            ConfigError: A number below 1.
        """
        from perception.recordings.opening import McapChoice
        from replan.perceive.options import RecordingChoice

        is_mcap = recording.suffix.lower() == ".mcap"
        return RecordingChoice(
            path=recording,
            intrinsics=self.intrinsics,
            depth_scale=self.depth_scale,
            models=self.models,
            object_names=self.object_names,
            mcap=McapChoice(
                colour=self.colour_topic,
                depth=self.depth_topic,
                info=self.info_topic,
                # An MCAP file knows its cameras before it is read: only those asked for are decoded.
                cameras=(self.camera,) if self.camera is not None and is_mcap else (),
                world=self.world,
                tolerance=self.stamp_tolerance,
            ),
            camera=self.camera,
            every=self.every,
            frames=self.frames,
        )
