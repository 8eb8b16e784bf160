"""Any other camera that the system knows (UVC), through OpenCV: colour only.

Without depth nothing can be located: such a camera is for films, recordings and pictures shown to language models. The
system says neither the lens, which therefore is told, nor when a picture was exposed, which is taken to be `latency`
before it came.
"""

import time

import cv2
import numpy as np

from control.errors import ConfigError, MachineError
from hw_interface.cameras.source import NO_POSE, CameraFailedError, Shot
from perception.frames import CameraIntrinsics, RgbdFrame


class UvcSource:
    """One camera, or a video file for trying things out.

    Args:
        device: Its number (0 is the first), or a path such as /dev/v4l/by-id/....
        intrinsics: Its lens; pictures must have this size.
        fps: Pictures a second to ask for.
        latency: From exposure to when a picture comes, in [s].

    Raises:
        MachineError: It does not open.
        ConfigError: Its pictures have another size.
    """

    placed = False

    def __init__(self, device: int | str, intrinsics: CameraIntrinsics, fps: int = 30, latency: float = 0.05) -> None:
        self._intrinsics, self._latency, self._device = intrinsics, latency, device
        log = cv2.utils.logging
        level = log.getLogLevel()
        log.setLogLevel(log.LOG_LEVEL_ERROR)  # what it would warn of is said below, in one line
        self._capture = cv2.VideoCapture(device)
        log.setLogLevel(level)
        if not self._capture.isOpened():
            raise MachineError(
                f"camera {device} does not open; see what `v4l2-ctl --list-devices` lists and whether another program "
                "has it"
            )
        self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, intrinsics.width)
        self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, intrinsics.height)
        self._capture.set(cv2.CAP_PROP_FPS, fps)
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        got = tuple(round(self._capture.get(p)) for p in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
        if got != (intrinsics.width, intrinsics.height):
            self._capture.release()
            raise ConfigError(
                f"camera {device} gives pictures of {got[0]}x{got[1]}, but its lens is described for "
                f"{intrinsics.width}x{intrinsics.height}; calibrate it at a size that it has"
            )
        self.description = f"UVC camera {device}, {got[0]}x{got[1]}, colour only"

    def read(self) -> Shot:
        """As in `CameraSource`; depth is NaN everywhere."""
        there, picture = self._capture.read()
        stamp = time.time() - self._latency
        if not there:
            raise CameraFailedError(f"camera {self._device} gave no picture; it was unplugged, or its file has ended")
        colour = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB), np.uint8)
        depth = np.full(colour.shape[:2], np.nan, np.float32)
        return Shot(RgbdFrame(colour, depth, self._intrinsics, NO_POSE, stamp))

    def close(self) -> None:
        """As in `CameraSource`."""
        self._capture.release()
