"""Intel RealSense depth cameras (D400 and later) through librealsense's Python package, pyrealsense2.

Depth is laid over the colour picture by the library's own alignment; both are straightened with the colour lens where
it bends. Stamps are the library's global time: the exposure on this computer's clock.
"""

import contextlib
from typing import Any

import numpy as np

from control.errors import ConfigError, MachineError
from hw_interface.cameras.source import NO_POSE, CameraFailedError, Shot
from hw_interface.cameras.straightening import Straightening
from perception.frames import CameraIntrinsics, RgbdFrame
from replan_base.parts import install_part

TIMEOUT_MS = 2000  # [ms] for one picture
LARGEST_ERROR = 0.5  # [px] of a straightened picture
INSTALL = f"the package pyrealsense2 is not installed here; run: {install_part('cameras')}"


class RealSenseSource:
    """One camera.

    Args:
        serial: Serial number; None takes the only one.
        width, height: Picture size in [px].
        fps: Pictures a second.
        rs: The module pyrealsense2, or one like it.

    Raises:
        MachineError: The package is missing, no such camera is there, or it does not offer these pictures.
        ConfigError: Its colour lens bends in a way that is not known.
    """

    placed = False

    def __init__(
        self, serial: str | None = None, width: int = 640, height: int = 480, fps: int = 30, rs: Any = None
    ) -> None:
        self._rs = rs = rs or _package()
        _require_device(rs, serial)
        config = rs.config()
        if serial is not None:
            config.enable_device(serial)
        config.enable_stream(rs.stream.depth, width, height, rs.format.z16, fps)
        config.enable_stream(rs.stream.color, width, height, rs.format.rgb8, fps)
        self._pipeline = rs.pipeline()
        which = "a RealSense camera" if serial is None else f"RealSense camera {serial}"
        try:
            profile = self._pipeline.start(config)
        except RuntimeError as error:
            raise MachineError(
                f"cannot start {which} with {width}x{height} at {fps} pictures a second: {error}; see what "
                "`rs-enumerate-devices` lists, and whether it hangs on USB 3"
            ) from error
        try:
            device = profile.get_device()
            self._scale = float(device.first_depth_sensor().get_depth_scale())
            for sensor in device.query_sensors():
                if sensor.supports(rs.option.global_time_enabled):
                    sensor.set_option(rs.option.global_time_enabled, 1.0)
            name, number = (device.get_info(getattr(rs.camera_info, key)) for key in ("name", "serial_number"))
            self.description = f"{name} {number}, {width}x{height} at {fps} a second"
            lens = profile.get_stream(rs.stream.color).as_video_stream_profile().get_intrinsics()
            self._intrinsics = CameraIntrinsics(lens.width, lens.height, lens.fx, lens.fy, lens.ppx, lens.ppy)
            self._straightening = straightening_of(rs, lens, self._intrinsics)
            self._align = rs.align(rs.stream.color)
        except BaseException:
            self._pipeline.stop()
            raise

    def read(self) -> Shot:
        """As in `CameraSource`."""
        rs = self._rs
        try:
            frames = self._align.process(self._pipeline.wait_for_frames(TIMEOUT_MS))
        except RuntimeError as error:  # unplugged, or it hangs
            raise CameraFailedError(f"the RealSense camera gave no picture for {TIMEOUT_MS} ms ({error})") from error
        colour, depth = frames.get_color_frame(), frames.get_depth_frame()
        if not colour or not depth:
            raise CameraFailedError("the RealSense camera gave a set of pictures without colour or depth")
        if colour.get_frame_timestamp_domain() == rs.timestamp_domain.hardware_clock:
            raise CameraFailedError(
                "the RealSense camera stamps pictures on a clock of its own, which cannot be held against the arm's; "
                "update its firmware so that it offers global time"
            )
        raw = np.asanyarray(depth.get_data())
        metres = np.where(raw > 0, raw * np.float32(self._scale), np.float32(np.nan)).astype(np.float32)
        pixels = np.array(colour.get_data(), np.uint8)  # a copy: the library uses its buffer again
        if self._straightening is not None:
            pixels, metres = self._straightening.colour(pixels), self._straightening.depth(metres)
        frame = RgbdFrame(pixels, metres, self._intrinsics, NO_POSE, colour.get_timestamp() / 1000.0)
        return Shot(frame, int(colour.get_frame_number()))

    def close(self) -> None:
        """As in `CameraSource`."""
        with contextlib.suppress(RuntimeError):  # it has stopped, or is gone
            self._pipeline.stop()


def straightening_of(rs: Any, lens: Any, intrinsics: CameraIntrinsics) -> Straightening | None:
    """What straightens a lens's pictures; None where they are straight.

    The library itself says where a ray meets the bent picture. What its names of models mean has changed between its
    versions, so its two directions are held against each other: a model that it knows in one direction only is refused.

    Args:
        rs: The module pyrealsense2.
        lens: Its intrinsics with model and coeffs.
        intrinsics: The same without distortion.

    Raises:
        ConfigError: A model that the library cannot undo.
    """
    if lens.model == rs.distortion.none or not np.any(lens.coeffs):
        return None
    k = intrinsics
    y, x = np.mgrid[0 : k.height, 0 : k.width].astype(float)
    rays = np.stack([(x - k.cx) / k.fx, (y - k.cy) / k.fy], axis=-1).reshape(-1, 2)
    bent = np.array([rs.rs2_project_point_to_pixel(lens, [u, v, 1.0]) for u, v in rays.tolist()])
    some = slice(None, None, max(1, len(rays) // 500))
    back = np.array([rs.rs2_deproject_pixel_to_point(lens, pixel, 1.0)[:2] for pixel in bent[some].tolist()])
    if np.abs(back - rays[some]).max() * k.fx > LARGEST_ERROR:
        raise ConfigError(
            f"the colour lens bends by the model '{lens.model}', which this version of pyrealsense2 cannot undo; "
            "update it, or have the camera deliver rectified pictures"
        )
    return Straightening(bent.reshape(k.height, k.width, 2))


def _require_device(rs: Any, serial: str | None) -> None:
    """Refuse a camera that is not there at once; the library itself would wait 15 s for it.

    Raises:
        MachineError: It is not there; names those that are.
    """
    there = [device.get_info(rs.camera_info.serial_number) for device in rs.context().query_devices()]
    if not there or (serial is not None and serial not in there):
        which = "no RealSense camera" if serial is None else f"no RealSense camera {serial}"
        others = f"there are {', '.join(there)}" if there else "there is none"
        raise MachineError(f"{which} is connected, {others}; see what `rs-enumerate-devices` lists")


def _package() -> Any:
    try:
        import pyrealsense2
    except ImportError as error:
        raise MachineError(INSTALL) from error
    return pyrealsense2
