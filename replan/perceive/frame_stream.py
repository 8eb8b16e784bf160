"""The frames of a recording that are looked at, one at a time, and their keys."""

from collections.abc import Iterator
from dataclasses import dataclass

from perception.errors import FrameError
from perception.frames import RgbdFrame
from perception.ground_truth import FrameTruth
from perception.recordings.frame_keys import frame_keys
from perception.recordings.opening import McapChoice, Recording, Skipped, open_recording
from replan.perceive.options import RecordingChoice


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

    def __init__(self, choice: RecordingChoice) -> None:
        """Open it.

        Raises:
            FrameError: The recording cannot be used.
        """
        self._choice = choice
        mcap = choice.mcap if choice.mcap != McapChoice() else None
        self.recording: Recording = open_recording(
            choice.path,
            choice.intrinsics,
            choice.depth_scale,
            mcap=mcap,
            models=choice.models,
            object_names=choice.object_names,
        )
        self.keys = frame_keys(choice.path, self.recording)
        count = self.recording.count
        every = None if count is None else -(-count // choice.every)
        known = [n for n in (every, choice.frames) if n is not None]
        self.total = min(known) if known else None
        self._named = 0

    def __iter__(self) -> Iterator[KeyedFrame]:
        """The frames.

        Raises:
            FrameError: No frame can be read, or none is of the camera that was asked for.
        """
        choice, read, given = self._choice, 0, 0
        cameras: dict[str, int] = {}  # frames of each so far: cameras may take turns
        self._named = 0
        for pair in self.recording.with_truth():
            position = read + len(self.recording.skipped) if self.keys else read
            read += 1
            camera = pair.frame.camera
            before = cameras.get(camera, 0)
            cameras[camera] = before + 1
            if camera != (choice.camera or camera) or before % choice.every:
                continue
            given += 1
            yield KeyedFrame(self.keys[position] if self.keys else str(position), pair.frame, pair.truth)
            if given == choice.frames:
                return
        if not given:
            raise FrameError(
                f"'{self.recording.name}' has no frame of camera '{choice.camera}'; "
                f"its cameras are {', '.join(cameras)}"
            )

    def newly_skipped(self) -> list[Skipped]:
        """What could not be read since this was asked last."""
        new = self.recording.skipped[self._named :]
        self._named += len(new)
        return new
