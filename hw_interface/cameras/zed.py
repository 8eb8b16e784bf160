"""Stereolabs ZED cameras through the Python API of the ZED SDK, pyzed.

The left picture and the depth that belongs to it, both rectified by the SDK: straight and registered. Stamps are the
moment that the picture was taken on this computer's clock.
"""

from typing import Any

import numpy as np

from control.errors import MachineError
from hw_interface.cameras.source import NO_POSE, CameraFailedError, Shot
from perception.frames import CameraIntrinsics, RgbdFrame

INSTALL = (
    "the ZED SDK's Python API (pyzed) is not installed here: install the SDK from stereolabs.com/developers/release "
    "(it needs an NVIDIA GPU), then run its get_python_api.py with this Python"
)
RESOLUTIONS = ("VGA", "HD720", "HD1080", "HD1200", "HD2K")


class ZedSource:
    """One camera.

    Args:
        serial: Serial number; None takes the first.
        resolution: One of `RESOLUTIONS`; which of them there are depends on the model.
        fps: Pictures a second.
        sl: The module pyzed.sl, or one like it.

    Raises:
        MachineError: The SDK is missing, or no camera opens.
    """

    placed = False

    def __init__(self, serial: int | None = None, resolution: str = "HD720", fps: int = 30, sl: Any = None) -> None:
        self._sl = sl = sl or _package()
        settings = sl.InitParameters()
        settings.camera_resolution = getattr(sl.RESOLUTION, resolution)
        settings.camera_fps = fps
        settings.coordinate_units = sl.UNIT.METER
        if serial is not None:
            settings.set_from_serial_number(serial)
        self._camera = sl.Camera()
        status = self._camera.open(settings)
        if status != sl.ERROR_CODE.SUCCESS:
            which = "a ZED camera" if serial is None else f"ZED camera {serial}"
            raise MachineError(
                f"cannot open {which} with {resolution} at {fps} pictures a second: {status}; see what ZED_Explorer "
                "shows, and whether it hangs on USB 3"
            )
        found = self._camera.get_camera_information()
        lens = found.camera_configuration.calibration_parameters.left_cam
        size = found.camera_configuration.resolution
        self._intrinsics = CameraIntrinsics(size.width, size.height, lens.fx, lens.fy, lens.cx, lens.cy)
        self.description = f"ZED {found.serial_number}, {size.width}x{size.height} at {fps} a second"
        self._runtime, self._image, self._depth = sl.RuntimeParameters(), sl.Mat(), sl.Mat()
        self._grabbed = 0

    def read(self) -> Shot:
        """As in `CameraSource`; pictures that the SDK says it dropped count in the number."""
        sl, camera = self._sl, self._camera
        status = camera.grab(self._runtime)
        if status != sl.ERROR_CODE.SUCCESS:
            raise CameraFailedError(f"the ZED camera gave no picture: {status}")
        self._grabbed += 1
        camera.retrieve_image(self._image, sl.VIEW.LEFT)
        camera.retrieve_measure(self._depth, sl.MEASURE.DEPTH)
        # Blue, green, red and alpha; depth is NaN or infinite where it is not known, too near or too far.
        colour = np.array(self._image.get_data()[:, :, 2::-1], np.uint8)
        depth = np.array(self._depth.get_data(), np.float32)
        depth[~np.isfinite(depth)] = np.nan
        stamp = camera.get_timestamp(sl.TIME_REFERENCE.IMAGE).get_nanoseconds() / 1e9
        frame = RgbdFrame(colour, depth, self._intrinsics, NO_POSE, stamp)
        return Shot(frame, self._grabbed + int(camera.get_frame_dropped_count()))

    def close(self) -> None:
        """As in `CameraSource`."""
        self._camera.close()


def _package() -> Any:
    try:
        import pyzed.sl as sl  # pyright: ignore[reportMissingImports] -- comes with the SDK and from no index
    except ImportError as error:
        raise MachineError(INSTALL) from error
    return sl
