"""The frames of a recording that are looked at, one at a time, and their keys."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from perception.errors import FrameError
from perception.frames import RgbdFrame
from perception.ground_truth import FrameTruth
from perception.recordings.frame_keys import frame_keys
from perception.recordings.mcap_choice import McapChoice
from perception.recordings.opening import Recording, Skipped, open_recording
from replan.perceive.options import ReadingOptions


@dataclass(frozen=True)
class KeyedFrame:
    """One frame, its key in the recording, and for scorers what truly was in it."""

    key: str
    frame: RgbdFrame
    truth: FrameTruth | None


class FrameStream:
    """Iterating reads one frame after the other and holds no more than that.

    Attributes:
        recording: What is read.
        keys: Keys of all its frames, or None where only reading would tell.
        total: How many frames will be looked at at most; None where only reading would tell.
    """

    def __init__(self, path: Path, options: ReadingOptions) -> None:
        """Open it.

        Args:
            path: Folder of PNG pairs, BOP scene, MCAP or .npz file, see `perception.recordings.opening`.
            options: Which of its frames, and how.

        Raises:
            FrameError: The recording cannot be used.
        """
        self._options = options
        mcap = options.mcap
        if options.camera is not None and path.suffix.lower() == ".mcap":
            # An MCAP file knows its cameras before it is read: only those asked for are decoded.
            mcap = replace(mcap, cameras=(options.camera,))
        self.recording: Recording = open_recording(
            path,
            options.intrinsics,
            options.depth_scale,
            mcap=mcap if mcap != McapChoice() else None,
            models=options.models,
            object_names=options.object_names,
        )
        self.keys = frame_keys(path, self.recording)
        count = self.recording.count
        every = None if count is None else -(-count // options.every)
        known = [n for n in (every, options.frames) if n is not None]
        self.total = min(known) if known else None
        self._named = 0

    def __iter__(self) -> Iterator[KeyedFrame]:
        """The frames.

        Raises:
            FrameError: No frame can be read, or none is of the camera that was asked for.
        """
        options, read, given = self._options, 0, 0
        cameras: dict[str, int] = {}  # frames of each so far: cameras may take turns
        self._named = 0
        for pair in self.recording.with_truth():
            position = read + len(self.recording.skipped) if self.keys else read
            read += 1
            camera = pair.frame.camera
            before = cameras.get(camera, 0)
            cameras[camera] = before + 1
            if camera != (options.camera or camera) or before % options.every:
                continue
            given += 1
            yield KeyedFrame(self.keys[position] if self.keys else str(position), pair.frame, pair.truth)
            if given == options.frames:
                return
        if not given:
            raise FrameError(
                f"'{self.recording.name}' has no frame of camera '{options.camera}'; "
                f"its cameras are {', '.join(cameras)}"
            )

    def newly_skipped(self) -> list[Skipped]:
        """What could not be read since this was asked last."""
        new = self.recording.skipped[self._named :]
        self._named += len(new)
        return new
