"""Cameras without devices: a source that tests steer, and stand-ins for pyrealsense2 and pyzed.sl.

The stand-ins have the classes and methods that the makers document and that the sources call, and nothing else, so that
a call that the real packages do not have fails here, too.
"""

import queue
import time
from dataclasses import dataclass, field
from enum import Enum
from types import SimpleNamespace
from typing import Any

import numpy as np

from hw_interface.cameras.source import NO_POSE, CameraFailedError, Shot
from perception.frames import CameraIntrinsics, RgbdFrame

LENS = CameraIntrinsics(8, 6, 10.0, 10.0, 3.5, 2.5)


def picture(stamp: float, shade: int = 100) -> RgbdFrame:
    """A small grey picture of a wall a metre away."""
    return RgbdFrame(np.full((6, 8, 3), shade, np.uint8), np.ones((6, 8), np.float32), LENS, NO_POSE, stamp)


class SteeredSource:
    """A source that gives what tests put into it, `delay` seconds later."""

    description = "a source of the test"
    placed = False

    def __init__(self) -> None:
        self.shots: queue.Queue[Shot | Exception] = queue.Queue()
        self.closed = False

    def give(self, stamp: float | None = None, number: int | None = None) -> None:
        """Have the next `read` answer with a picture, by default one taken now."""
        self.shots.put(Shot(picture(time.time() if stamp is None else stamp), number))

    def fail(self, reason: str) -> None:
        """Have the next `read` fail."""
        self.shots.put(CameraFailedError(reason))

    def read(self) -> Shot:
        """The next one that was put."""
        while not self.closed:
            try:
                shot = self.shots.get(timeout=0.02)
            except queue.Empty:
                continue
            if isinstance(shot, Exception):
                raise shot
            return shot
        raise CameraFailedError("closed")

    def close(self) -> None:
        """No more."""
        self.closed = True


class LiveSource(SteeredSource):
    """A source that takes a picture every 20 ms and numbers them."""

    number = 0

    def read(self) -> Shot:
        """One more."""
        time.sleep(0.02)
        self.number += 1
        return Shot(picture(time.time()), self.number)


# ---- pyrealsense2


class Stream(Enum):
    depth = 1
    color = 2


class Distortion(Enum):
    none = 0
    modified_brown_conrady = 1
    inverse_brown_conrady = 2
    ftheta = 3
    brown_conrady = 4
    kannala_brandt4 = 5


class Domain(Enum):
    hardware_clock = 0
    system_time = 1
    global_time = 2


@dataclass
class RealSenseDouble:
    """What a camera behind the stand-in of pyrealsense2 gives.

    Attributes:
        colour, depth: Its pictures; depth is 16-bit, in units of `scale` metres.
        stamp, domain, number: Of each picture: time in [ms], on which clock, which.
        model, coeffs: Of the colour lens.
        start_error, wait_error: What the library says instead.
    """

    colour: np.ndarray
    depth: np.ndarray
    scale: float = 0.001
    stamp: float = 1_700_000_000_250.0
    domain: Domain = Domain.global_time
    number: int = 7
    model: Distortion = Distortion.inverse_brown_conrady
    coeffs: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)
    start_error: str | None = None
    wait_error: str | None = None
    calls: list[tuple[Any, ...]] = field(default_factory=list)

    @property
    def rs(self) -> Any:
        """The module."""
        double = self

        class Config:
            def enable_device(self, serial: str) -> None:
                double.calls.append(("enable_device", serial))

            def enable_stream(self, stream: Stream, width: int, height: int, form: str, fps: int) -> None:
                double.calls.append(("enable_stream", stream, width, height, form, fps))

        class Sensor:
            def supports(self, option: str) -> bool:
                return option == "global_time_enabled"

            def set_option(self, option: str, value: float) -> None:
                double.calls.append(("set_option", option, value))

            def get_depth_scale(self) -> float:
                return double.scale

        class Device:
            def first_depth_sensor(self) -> Sensor:
                return Sensor()

            def query_sensors(self) -> list[Sensor]:
                return [Sensor()]

            def get_info(self, what: str) -> str:
                return {"name": "Intel RealSense D435", "serial_number": "123"}[what]

        class Context:
            def query_devices(self) -> list[Device]:
                return [Device()]

        class Profile:
            def get_device(self) -> Device:
                return Device()

            def get_stream(self, stream: Stream) -> "Profile":
                assert stream is Stream.color, "depth is aligned to colour, so colour's lens counts"
                return self

            def as_video_stream_profile(self) -> "Profile":
                return self

            def get_intrinsics(self) -> SimpleNamespace:
                height, width = double.depth.shape
                return SimpleNamespace(
                    width=width, height=height, fx=20.0, fy=21.0, ppx=3.0, ppy=2.0,
                    model=double.model, coeffs=list(double.coeffs),
                )  # fmt: skip

        class Frame:
            def __init__(self, data: np.ndarray) -> None:
                self._data = data

            def get_data(self) -> np.ndarray:
                return self._data

            def get_timestamp(self) -> float:
                return double.stamp

            def get_frame_timestamp_domain(self) -> Domain:
                return double.domain

            def get_frame_number(self) -> int:
                return double.number

        class Frames:
            def __init__(self, aligned: bool) -> None:
                self.aligned = aligned

            def get_color_frame(self) -> Frame:
                return Frame(double.colour)

            def get_depth_frame(self) -> Frame:
                assert self.aligned
                return Frame(double.depth)

        class Pipeline:
            def start(self, config: Config) -> Profile:
                if double.start_error is not None:
                    raise RuntimeError(double.start_error)
                return Profile()

            def wait_for_frames(self, timeout_ms: int) -> Frames:
                if double.wait_error is not None:
                    raise RuntimeError(double.wait_error)
                return Frames(False)

            def stop(self) -> None:
                double.calls.append(("stop",))

        class Align:
            def __init__(self, to: Stream) -> None:
                assert to is Stream.color

            def process(self, frames: Frames) -> Frames:
                return Frames(True)

        return SimpleNamespace(
            context=Context,
            config=Config,
            pipeline=Pipeline,
            align=Align,
            stream=Stream,
            distortion=Distortion,
            timestamp_domain=Domain,
            format=SimpleNamespace(z16="z16", rgb8="rgb8"),
            option=SimpleNamespace(global_time_enabled="global_time_enabled"),
            camera_info=SimpleNamespace(name="name", serial_number="serial_number"),
        )


# ---- pyzed.sl


class ErrorCode(Enum):
    SUCCESS = 0
    CAMERA_NOT_DETECTED = 1
    CAMERA_REBOOTING = 2


@dataclass
class ZedDouble:
    """What a camera behind the stand-in of pyzed.sl gives.

    Attributes:
        image: Its left picture: blue, green, red, alpha.
        depth: In [m], NaN and infinities where it is not known.
        opened, grabbed: What opening and grabbing answer.
        dropped: Pictures that were dropped so far.
    """

    image: np.ndarray
    depth: np.ndarray
    opened: ErrorCode = ErrorCode.SUCCESS
    grabbed: ErrorCode = ErrorCode.SUCCESS
    dropped: int = 0
    settings: Any = None
    closed: bool = False

    @property
    def sl(self) -> Any:
        """The module."""
        double = self

        class InitParameters:
            def __init__(self) -> None:
                self.camera_resolution = self.camera_fps = self.coordinate_units = self.serial = None

            def set_from_serial_number(self, serial: int) -> None:
                self.serial = serial

        class Mat:
            def __init__(self) -> None:
                self.data: np.ndarray | None = None

            def get_data(self) -> np.ndarray:
                assert self.data is not None
                return self.data

        class Camera:
            def open(self, settings: InitParameters) -> ErrorCode:
                double.settings = settings
                return double.opened

            def get_camera_information(self) -> SimpleNamespace:
                height, width = double.depth.shape
                left = SimpleNamespace(fx=20.0, fy=21.0, cx=3.0, cy=2.0)
                configuration = SimpleNamespace(
                    calibration_parameters=SimpleNamespace(left_cam=left),
                    resolution=SimpleNamespace(width=width, height=height),
                )
                return SimpleNamespace(serial_number=4711, camera_configuration=configuration)

            def grab(self, runtime: Any) -> ErrorCode:
                return double.grabbed

            def retrieve_image(self, into: Mat, view: str) -> None:
                assert view == "left"
                into.data = double.image

            def retrieve_measure(self, into: Mat, measure: str) -> None:
                assert measure == "depth"
                into.data = double.depth

            def get_timestamp(self, reference: str) -> SimpleNamespace:
                assert reference == "image"
                return SimpleNamespace(get_nanoseconds=lambda: 1_700_000_000_250_000_000)

            def get_frame_dropped_count(self) -> int:
                return double.dropped

            def close(self) -> None:
                double.closed = True

        return SimpleNamespace(
            InitParameters=InitParameters,
            RuntimeParameters=SimpleNamespace,
            Camera=Camera,
            Mat=Mat,
            ERROR_CODE=ErrorCode,
            RESOLUTION=SimpleNamespace(VGA="VGA", HD720="HD720"),
            UNIT=SimpleNamespace(METER="metre"),
            VIEW=SimpleNamespace(LEFT="left"),
            MEASURE=SimpleNamespace(DEPTH="depth"),
            TIME_REFERENCE=SimpleNamespace(IMAGE="image"),
        )
