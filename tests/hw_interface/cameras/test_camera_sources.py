"""Sources of pictures: what devices give as frames, what they fail with, and recordings in their place."""

import sys
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from control.errors import ConfigError, MachineError
from hw_interface.cameras.realsense import RealSenseSource, straightening_of
from hw_interface.cameras.recorded import RecordedSource
from hw_interface.cameras.source import CameraFailedError, SourceEndedError
from hw_interface.cameras.uvc import UvcSource
from hw_interface.cameras.zed import ZedSource
from perception.frames import CameraIntrinsics
from perception.recordings.opening import open_recording, save_npz
from tests.support.robot_side.camera_doubles import Domain, ErrorCode, RealSenseDouble, Stream, ZedDouble, picture

BENT = (0.5, -0.3, 0.01, -0.02, 0.1)  # k1, k2, p1, p2, k3, as of a wide lens


def colours(height: int = 6, width: int = 8) -> np.ndarray:
    """A picture of which every pixel is another."""
    return np.arange(height * width * 3, dtype=np.uint8).reshape(height, width, 3)


def realsense(**changes) -> RealSenseDouble:
    depth = np.full((6, 8), 1500, np.uint16)
    depth[1, 2] = 0
    return RealSenseDouble(colours(), depth, **changes)


def test_a_realsense_gives_depth_in_metres_at_the_stamp_of_its_exposure():
    double = realsense(scale=0.00025)
    source = RealSenseSource("123", 8, 6, 15, double.rs)
    shot = source.read()
    frame = shot.frame
    np.testing.assert_array_equal(frame.colour, double.colour)
    assert np.isnan(frame.depth[1, 2]), "no depth is 0 in its pictures"
    np.testing.assert_allclose(np.delete(frame.depth.ravel(), 10), 0.375, rtol=1e-6)
    assert frame.intrinsics == CameraIntrinsics(8, 6, 20.0, 21.0, 3.0, 2.0)
    assert frame.stamp == 1_700_000_000.25 and shot.number == 7
    assert ("enable_device", "123") in double.calls
    assert ("enable_stream", Stream.depth, 8, 6, "z16", 15) in double.calls
    assert ("enable_stream", Stream.color, 8, 6, "rgb8", 15) in double.calls
    assert ("set_option", "global_time_enabled", 1.0) in double.calls
    assert source.description == "Intel RealSense D435 123, 8x6 at 15 a second"
    source.close()
    assert double.calls[-1] == ("stop",)


def test_a_picture_of_a_realsense_is_its_own_and_not_the_librarys_buffer():
    double = realsense()
    frame = RealSenseSource(rs=double.rs).read().frame
    before = frame.colour.copy()
    double.colour[:] = 0
    np.testing.assert_array_equal(frame.colour, before)


def test_a_realsense_that_is_not_there_says_what_to_look_at():
    with pytest.raises(MachineError, match=r"cannot start RealSense camera 123 .*: Couldn't resolve.*rs-enum"):
        RealSenseSource("123", rs=realsense(start_error="Couldn't resolve requests").rs)
    with pytest.raises(MachineError, match="no RealSense camera 99 is connected, there are 123; see what"):
        RealSenseSource("99", rs=realsense().rs)


def test_the_real_library_without_a_device_says_so():
    pytest.importorskip("pyrealsense2")
    with pytest.raises(MachineError, match="no RealSense camera is connected, there is none; see what `rs-enum"):
        RealSenseSource()


def test_a_realsense_that_is_unplugged_fails():
    double = realsense()
    source = RealSenseSource(rs=double.rs)
    double.wait_error = "Frame didn't arrive within 2000"
    with pytest.raises(CameraFailedError, match="gave no picture for 2000 ms"):
        source.read()


def test_stamps_on_a_clock_of_the_camera_itself_are_refused():
    source = RealSenseSource(rs=realsense(domain=Domain.hardware_clock).rs)
    with pytest.raises(CameraFailedError, match="on a clock of its own"):
        source.read()


def test_a_package_that_is_missing_is_named_with_how_to_get_it(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "pyrealsense2", None)
    with pytest.raises(MachineError, match="pyrealsense2 is not installed here; run: make setup"):
        RealSenseSource()
    monkeypatch.setitem(sys.modules, "pyzed", None)
    with pytest.raises(MachineError, match=r"ZED SDK's Python API \(pyzed\) is not installed here: install the SDK"):
        ZedSource()


def lens_of(rs, model: str, coeffs: tuple[float, ...], k: CameraIntrinsics):
    """Intrinsics as the real library has them."""
    lens = rs.intrinsics()
    lens.width, lens.height, lens.fx, lens.fy, lens.ppx, lens.ppy = k.width, k.height, k.fx, k.fy, k.cx, k.cy
    lens.model, lens.coeffs = getattr(rs.distortion, model), list(coeffs)
    return lens


@pytest.mark.parametrize("model", ["brown_conrady", "inverse_brown_conrady"])
def test_pictures_of_a_lens_that_bends_are_straightened_as_opencv_would(model: str):
    rs = pytest.importorskip("pyrealsense2")
    k = CameraIntrinsics(64, 48, 60.0, 61.0, 31.0, 24.5)
    found = straightening_of(rs, lens_of(rs, model, BENT, k), k)
    assert found is not None
    y, x = np.mgrid[0:48, 0:64]
    bent = np.stack([4 * x, 5 * y, np.full_like(x, 90)], -1).astype(np.uint8)
    expected = cv2.undistort(bent, k.matrix, np.array(BENT))
    inside = (slice(6, -6), slice(6, -6))
    assert np.abs(found.colour(bent)[inside].astype(int) - expected[inside]).max() <= 2
    assert np.abs(bent[inside].astype(int) - expected[inside]).max() > 6, "the lens does bend"


def test_depth_from_outside_of_the_picture_is_unknown():
    rs = pytest.importorskip("pyrealsense2")
    k = CameraIntrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)
    found = straightening_of(rs, lens_of(rs, "brown_conrady", (0.2, 0.0, 0.0, 0.0, 0.0), k), k)
    assert found is not None
    depth = found.depth(np.ones((48, 64), np.float32))
    assert np.isnan(depth[0, 0]) and depth[24, 32] == 1.0


def test_a_lens_is_straight_without_coefficients_and_refused_where_the_library_cannot_undo_it():
    rs = pytest.importorskip("pyrealsense2")
    k = CameraIntrinsics(64, 48, 60.0, 61.0, 31.0, 24.5)
    assert straightening_of(rs, lens_of(rs, "inverse_brown_conrady", (0.0,) * 5, k), k) is None
    assert straightening_of(rs, lens_of(rs, "none", BENT, k), k) is None
    with pytest.raises(ConfigError, match="modified_brown_conrady', which this version of pyrealsense2 cannot undo"):
        straightening_of(rs, lens_of(rs, "modified_brown_conrady", BENT, k), k)


def zed(**changes) -> ZedDouble:
    image = np.zeros((6, 8, 4), np.uint8)
    image[:] = [10, 20, 30, 255]
    depth = np.full((6, 8), 0.75, np.float32)
    depth[0, :3] = [np.nan, np.inf, -np.inf]
    return ZedDouble(image, depth, **changes)


def test_a_zed_gives_red_green_blue_and_depth_in_metres():
    double = zed(dropped=3)
    source = ZedSource(4711, "HD720", 15, double.sl)
    shot = source.read()
    np.testing.assert_array_equal(shot.frame.colour[2, 2], [30, 20, 10])
    assert np.isnan(shot.frame.depth[0, :3]).all() and (shot.frame.depth[1:] == 0.75).all()
    assert shot.frame.intrinsics == CameraIntrinsics(8, 6, 20.0, 21.0, 3.0, 2.0)
    assert abs(shot.frame.stamp - 1_700_000_000.25) < 1e-6
    double.dropped = 5
    assert (shot.number, source.read().number) == (4, 7), "two were dropped between the two"
    s = double.settings
    assert (s.serial, s.camera_resolution, s.camera_fps, s.coordinate_units) == (4711, "HD720", 15, "metre")
    source.close()
    assert double.closed


def test_a_zed_that_does_not_open_or_stops_says_what_the_sdk_says():
    with pytest.raises(MachineError, match=r"cannot open a ZED camera with HD720 .*CAMERA_NOT_DETECTED; see what"):
        ZedSource(sl=zed(opened=ErrorCode.CAMERA_NOT_DETECTED).sl)
    double = zed()
    source = ZedSource(sl=double.sl)
    double.grabbed = ErrorCode.CAMERA_REBOOTING
    with pytest.raises(CameraFailedError, match=r"gave no picture: .*CAMERA_REBOOTING"):
        source.read()


@pytest.fixture
def video(tmp_path: Path) -> str:
    """Three pictures of 32x24 in a file that OpenCV reads like a camera."""
    path = tmp_path / "video.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (32, 24))
    for _ in range(3):
        writer.write(np.full((24, 32, 3), (200, 50, 20), np.uint8))
    writer.release()
    return str(path)


def test_any_other_camera_gives_colour_and_no_depth(video: str):
    lens = CameraIntrinsics(32, 24, 30.0, 30.0, 15.5, 11.5)
    source = UvcSource(video, lens, latency=0.1)
    before = time.time()
    frame = source.read().frame
    assert np.abs(frame.colour.astype(int) - [20, 50, 200]).max() < 12, "red first"
    assert not frame.valid_depth.any() and frame.intrinsics == lens
    assert before - 0.1 <= frame.stamp <= time.time() - 0.1
    for _ in range(2):
        source.read()
    with pytest.raises(CameraFailedError, match="gave no picture; it was unplugged"):
        source.read()
    source.close()


def test_a_camera_that_does_not_open_or_has_another_size_is_refused(video: str, capfd: pytest.CaptureFixture[str]):
    with pytest.raises(MachineError, match=r"camera 99 does not open; see what `v4l2-ctl"):
        UvcSource(99, CameraIntrinsics(32, 24, 30.0, 30.0, 15.5, 11.5))
    assert "WARN" not in capfd.readouterr().err, "one line says it"
    with pytest.raises(ConfigError, match="gives pictures of 32x24, but its lens is described for 64x48"):
        UvcSource(video, CameraIntrinsics(64, 48, 30.0, 30.0, 31.5, 23.5))


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Two cameras, three pictures each, 0.2 s apart."""
    pose = np.eye(4)
    pose[2, 3] = 0.5
    frames = [
        replace(picture(100.0 + 0.2 * k, shade=10 * k), camera=camera, world_T_camera=pose)
        for k in range(3)
        for camera in ("left", "right")
    ]
    save_npz(tmp_path / "look.npz", frames)
    return tmp_path / "look.npz"


class Clock:
    """Time that passes only where somebody sleeps, in [s]."""

    def __init__(self) -> None:
        self.now = 1000.0

    def time(self) -> float:
        return self.now

    monotonic = time

    def sleep(self, seconds: float) -> None:
        self.now += seconds


def test_a_recording_is_played_at_its_own_pace_as_if_it_were_taken_now(recording: Path, monkeypatch):
    monkeypatch.setattr("hw_interface.cameras.recorded.time", Clock())
    source = RecordedSource(open_recording(recording), "right")
    shots = [source.read() for _ in range(3)]
    assert [int(s.frame.colour[0, 0, 0]) for s in shots] == [0, 10, 20]
    assert {s.frame.camera for s in shots} == {"right"}
    np.testing.assert_allclose([s.frame.stamp for s in shots], [1000.0, 1000.2, 1000.4])
    assert shots[0].frame.world_T_camera[2, 3] == 0.5
    with pytest.raises(SourceEndedError, match=r"the recording 'look\.npz' has ended"):
        source.read()


def test_a_recording_begins_again_when_it_is_told_to(recording: Path):
    source = RecordedSource(open_recording(recording), paced=False, loop=True)
    assert source.camera == "left"
    assert [int(source.read().frame.colour[0, 0, 0]) for _ in range(5)] == [0, 10, 20, 0, 10]


def test_a_camera_that_a_recording_does_not_have_is_named(recording: Path):
    with pytest.raises(ConfigError, match=r"recording 'look\.npz' has no camera 'top'; it has left, right"):
        RecordedSource(open_recording(recording), "top")
