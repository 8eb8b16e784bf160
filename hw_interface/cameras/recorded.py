"""A recording in the place of a camera: its pictures one after the other, as if they were taken now.

Poses are those of the recording. Stamps are when a picture is handed out, so what asks for fresh pictures gets them;
what is seen is of course as old as the recording.
"""

import time
from collections.abc import Iterator
from dataclasses import replace

from control.errors import ConfigError
from hw_interface.cameras.source import Shot, SourceEndedError
from perception.frames import RgbdFrame
from perception.recordings.base import Recording

LONGEST_PAUSE = 10.0  # [s] between two pictures, whatever their stamps say


class RecordedSource:
    """One camera of a recording.

    Args:
        recording: The recording.
        camera: Which of its cameras; None takes that of the first frame.
        paced: Wait between pictures as long as there was between them; else each is there at once.
        loop: Begin again at the end.

    Attributes:
        camera: Name of the camera in the recording.

    Raises:
        ConfigError: It has no such camera.
        FrameError: It has no frame that can be used.
    """

    placed = True

    def __init__(self, recording: Recording, camera: str | None = None, paced: bool = True, loop: bool = False) -> None:
        self._recording, self._paced, self._loop = recording, paced, loop
        names = []
        for frame in recording:
            names.append(frame.camera)
            if camera is None or frame.camera == camera:
                break
        else:
            raise ConfigError(
                f"recording '{recording.name}' has no camera '{camera}'; it has {', '.join(sorted(set(names)))}"
            )
        self.camera = names[-1]
        self.description = f"camera '{self.camera}' of recording '{recording.name}'"
        self._frames = self._of_camera()
        self._number = 0
        self._due: float | None = None  # when the picture before was due, on the monotonic clock
        self._stamp = 0.0  # of the picture before, in the recording

    def read(self) -> Shot:
        """As in `CameraSource`."""
        frame = next(self._frames, None)
        if frame is None and self._loop:
            self._frames, self._due = self._of_camera(), None
            frame = next(self._frames, None)
        if frame is None:
            raise SourceEndedError(f"the recording '{self._recording.name}' has ended")
        if self._paced:
            self._wait(frame.stamp)
        self._number += 1
        return Shot(replace(frame, stamp=time.time()), self._number)

    def close(self) -> None:
        """As in `CameraSource`."""

    def _of_camera(self) -> Iterator[RgbdFrame]:
        return (frame for frame in self._recording if frame.camera == self.camera)

    def _wait(self, stamp: float) -> None:
        now = time.monotonic()
        if self._due is not None:
            # A reader that is late is not hurried afterwards.
            self._due = max(now, self._due + min(max(stamp - self._stamp, 0.0), LONGEST_PAUSE))
            time.sleep(self._due - now)
        else:
            self._due = now
        self._stamp = stamp
