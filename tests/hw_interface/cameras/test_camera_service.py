"""A camera process: fresh pictures only, on the robot's clock, from where the camera was; numbers; and how it ends."""

import datetime
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from benchmarks.robot_side.perfect_robot import certificate, from_here
from control.errors import ConfigError, MachineError, RefusedError
from control.robot.dynamics import RobotModel
from control.robot.gripper import PANDA_HAND
from hw_interface.cameras.capture import Capture
from hw_interface.cameras.mounting import ArmStates, FixedMounting, WristMounting
from hw_interface.cameras.service import CameraService
from hw_interface.cameras.source import CameraSource
from hw_interface.cell.client import CellClient, MotionProgress
from hw_interface.cell.process import SimProcess
from hw_interface.errors import CameraGoneError
from hw_interface.link.keys import make_keys
from hw_interface.link.security import LinkSecurity
from hw_interface.link.transport import STATE_KEY, open_client_session
from hw_interface.messages.robot import RobotState
from hw_interface.messages.wire import decode
from perception.frames import RgbdFrame
from perception.recordings.opening import save_npz
from replan.doctor.machine import examine
from replan.robot.camera_process import serve_device
from replan.robot.options import CameraOptions
from replan.run.readiness import check_cameras
from tests.hw_interface.test_ros2 import CELL
from tests.support.robot_side.camera_doubles import LiveSource, SteeredSource, picture
from tests.support.robot_side.hw_support import robot_process, robot_thread
from tests.support.robot_side.link_certificates import link
from tests.support.waiting import GENEROUS, until

PLACE = np.array([[1.0, 0, 0, 0.1], [0, 1.0, 0, 0.2], [0, 0, 1.0, 0.3], [0, 0, 0, 1.0]])


@pytest.fixture(scope="module")
def robot() -> Iterator[SimProcess]:
    with robot_process() as process:
        yield process


@contextmanager
def capturing(source: CameraSource, max_age: float = 0.5) -> Iterator[Capture]:
    capture = Capture(source, "wrist", max_age)
    try:
        yield capture
    finally:
        source.close()  # the double wakes up at once; a device's `read` returns within its own limit
        capture.close()


@contextmanager
def served(
    endpoint: str, source: CameraSource, mounting=None, security: LinkSecurity | None = None, **options
) -> Iterator[CameraService]:
    """A camera service on a thread of this process."""
    session = open_client_session(endpoint, security=security)
    service = CameraService(session, "wrist", source, mounting or FixedMounting(PLACE), **options)
    ended = threading.Event()
    thread = threading.Thread(target=service.run, args=(ended.is_set,))
    thread.start()
    try:
        with CellClient.connect(endpoint, security=security) as client:
            assert until(lambda: "wrist" in client.cameras())
        yield service
    finally:
        ended.set()
        thread.join()
        source.close()
        service.close()
        session.close()


def test_a_picture_that_was_taken_before_it_was_asked_for_is_not_given_out():
    source = SteeredSource()
    with capturing(source, max_age=GENEROUS) as capture:
        source.give()
        assert until(lambda: capture.frames == 1)
        threading.Timer(0.1, source.give).start()
        asked = time.time()
        assert capture.taken_now().frame.stamp >= asked
        assert capture.frames == 2


def test_a_camera_that_hangs_is_refused_with_the_age_of_its_newest_picture():
    source = SteeredSource()
    with capturing(source, max_age=0.2) as capture:
        with pytest.raises(RefusedError, match="taken after it was asked for one: none has come yet"):
            capture.taken_now()
        source.give(time.time() - 3.0)
        assert until(lambda: capture.frames == 1)
        with pytest.raises(RefusedError, match=r"'wrist' .*: the newest is \d\.\d\d s old; it has 0\.2 s") as caught:
            capture.taken_now()
        assert caught.value.code == "stale_frame"


def test_only_the_newest_picture_is_kept():
    source = SteeredSource()
    begun = time.time()
    with capturing(source) as capture:
        for k in range(50):
            source.give(begun + 1000.0 + k)  # of the future, so that each would do
        assert until(lambda: capture.frames == 50)
        assert capture.taken_now().frame.stamp == begun + 1049.0


def test_an_unplugged_camera_is_refused_with_the_reason_and_wakes_whoever_waits():
    source = SteeredSource()
    with capturing(source, max_age=1e6) as capture:
        threading.Timer(0.1, source.fail, ["the cable was pulled"]).start()
        with pytest.raises(RefusedError, match="camera 'wrist' gives no pictures: the cable was pulled") as caught:
            capture.taken_now()
        assert caught.value.code == "camera_failed"
        assert source.closed or until(lambda: source.closed)


def test_a_fault_of_a_library_is_a_failed_camera():
    class Broken(SteeredSource):
        def read(self):
            raise RuntimeError("usb stalled")

    with capturing(Broken()) as capture:
        assert until(lambda: capture.failure is not None)
        assert str(capture.failure) == "RuntimeError: usb stalled"


def test_pictures_that_the_device_numbered_and_that_did_not_come_are_counted():
    source = SteeredSource()
    with capturing(source) as capture:
        for number in (5, 6, 9, 10, 12):
            source.give(number=number)
        assert until(lambda: capture.frames == 5)
        assert capture.dropped == 3


def test_without_numbers_gaps_between_stamps_are_counted():
    source = SteeredSource()
    with capturing(source) as capture:
        stamps = [0.1 * k for k in range(8)] + [1.0, 1.1, 1.2]  # 0.8 and 0.9 are missing
        for stamp in stamps:
            source.give(1000.0 + stamp)
        assert until(lambda: capture.frames == len(stamps))
        assert capture.dropped == 2


def test_where_the_arm_was_is_on_the_line_between_two_states():
    states = ArmStates()
    states.add(10.00, (0.0,) * 7)
    states.add(10.02, (0.2,) * 7)
    np.testing.assert_allclose(states.at(10.005), 0.05)
    np.testing.assert_allclose(states.at(10.02), 0.2)
    threading.Timer(0.05, states.add, [10.04, (0.4,) * 7]).start()
    np.testing.assert_allclose(states.at(10.03, patience=GENEROUS), 0.3)


@pytest.mark.parametrize(
    ("stamp", "why"), [(9.0, "1000 ms from it"), (10.1, "the nearest state is 60 ms"), (12.0, "1800 ms from it")]
)
def test_a_picture_without_a_state_near_enough_in_time_is_refused(stamp: float, why: str):
    states = ArmStates()
    for t in (10.0, 10.02, 10.04, 10.2):
        states.add(t, (t,) * 7)
    with pytest.raises(RefusedError, match=rf"is not known: .*{why}.* within 50 ms before and after") as caught:
        states.at(stamp, patience=0.01)
    assert caught.value.code == "no_arm_pose"


def test_states_from_before_a_clock_was_set_back_are_forgotten():
    states = ArmStates()
    states.add(100.0, (1.0,) * 7)
    states.add(10.0, (0.0,) * 7)
    with pytest.raises(RefusedError, match="the nearest state is 90000 ms from it"):
        states.at(100.0, patience=0.01)


def test_a_camera_in_the_world_gives_fresh_pictures_from_where_it_stands(robot: SimProcess):
    with served(robot.endpoint, LiveSource()) as service, CellClient.connect(robot.endpoint) as client:
        before = client.state().stamp
        (frame,) = client.frames(["wrist"])
        assert frame.camera == "wrist" and frame.stamp >= before
        np.testing.assert_array_equal(frame.world_T_camera, PLACE)
        assert service.clock.uncertainty is not None and service.clock.uncertainty < 0.02
        assert abs(service.clock.offset or 1.0) < 0.02, "both are on this computer"


def test_a_camera_on_the_hand_is_where_the_hand_was_when_it_was_exposed(robot: SimProcess):
    base = np.eye(4)
    base[:3, 3] = [0.5, 0.0, 0.0]
    session = open_client_session(robot.endpoint)
    states: list[RobotState] = []
    session.declare_subscriber(STATE_KEY, lambda s: states.append(decode(s.payload.to_bytes(), RobotState)))
    mounting = WristMounting(session, PANDA_HAND, base, PLACE)
    seen: list[RgbdFrame] = []
    with (
        served(robot.endpoint, LiveSource(), mounting),
        CellClient.connect(robot.endpoint) as client,
        CellClient.connect(robot.endpoint) as eye,
    ):
        motion = from_here(client, 1.0, 0.4)

        def look(progress: MotionProgress) -> None:
            if len(seen) < 1 + progress.played // 150:
                seen.append(eye.frames(["wrist"])[0])

        assert client.execute(motion, certificate(motion), look).completed
    session.close()
    assert len(seen) >= 3
    model = RobotModel.panda()
    hand_T_tcp = np.eye(4)
    hand_T_tcp[2, 3] = 0.1034  # of the Panda's hand, by its description
    stamps, q = np.array([s.stamp for s in states]), np.array([s.q for s in states])
    for frame in seen:
        at = np.array([np.interp(frame.stamp, stamps, column) for column in q.T])
        expected = base @ model.tcp_pose(at) @ np.linalg.inv(hand_T_tcp) @ PLACE
        assert np.abs(frame.world_T_camera - expected).max() < 1e-6
    moved = [f.world_T_camera[:3, 3] for f in seen]
    assert np.linalg.norm(moved[-1] - moved[0]) > 0.01, "it moved with the hand"


class StalledMounting(FixedMounting):
    """A mounting that does not know where the arm was at the first moments that it is asked about."""

    def __init__(self, unknown: int) -> None:
        super().__init__(PLACE)
        self.unknown = unknown
        self.asked: list[float] = []

    def pose(self, stamp: float) -> np.ndarray:
        self.asked.append(stamp)
        if len(self.asked) <= self.unknown:
            return ArmStates().at(stamp, patience=0.0)
        return super().pose(stamp)


def test_a_picture_taken_while_the_robots_process_stood_still_is_followed_by_one_whose_pose_is_known(robot: SimProcess):
    mounting = StalledMounting(2)
    with served(robot.endpoint, LiveSource(), mounting), CellClient.connect(robot.endpoint) as client:
        (frame,) = client.frames(["wrist"])
    assert len(mounting.asked) == 3 and mounting.asked[0] < mounting.asked[1] < frame.stamp
    np.testing.assert_array_equal(frame.world_T_camera, PLACE)


def test_a_camera_whose_arm_pose_is_never_known_says_so_after_a_while(robot: SimProcess, monkeypatch):
    monkeypatch.setattr("hw_interface.cameras.service.POSE_PATIENCE", 0.2)
    with (
        served(robot.endpoint, LiveSource(), StalledMounting(10**6)),
        CellClient.connect(robot.endpoint) as client,
        pytest.raises(RefusedError, match="where the arm was when the picture was taken is not known"),
    ):
        client.frames(["wrist"])


def test_a_camera_of_another_computer_has_the_rights_that_it_needs(tmp_path: Path):
    make_keys(tmp_path, ("127.0.0.1",), 90, datetime.datetime.now(datetime.UTC))
    with (
        robot_thread("tls/127.0.0.1:0", link(tmp_path, "robot")) as endpoint,
        served(endpoint, LiveSource(), security=link(tmp_path, "camera")) as service,
        CellClient.connect(endpoint, security=link(tmp_path, "viewer")) as client,
    ):
        assert client.frames(["wrist"])[0].camera == "wrist"
        (health,) = client.camera_health()
        assert health.camera == "wrist" and health.clock_uncertainty is not None
        assert service.clock.jumps == 0


def test_what_a_camera_says_of_itself_is_published_and_in_the_report_on_this_machine(robot: SimProcess):
    heard: list = []
    session = open_client_session(robot.endpoint)
    session.declare_subscriber("cell/camera_health/wrist", heard.append)
    source = LiveSource()
    with served(robot.endpoint, source), CellClient.connect(robot.endpoint) as client:
        client.frames(["wrist"])
        (health,) = client.camera_health()
        assert health.camera == "wrist" and health.source == "a source of the test" and health.trouble is None
        assert health.frames > 0 and health.dropped == 0 and health.rate <= 60.0
        assert health.age is not None and health.age < 0.5
        assert until(lambda: len(heard) >= 2)
        # A process that stands still for too long is not asked twice by one examination.
        found = []
        assert until(lambda: found.extend(f for f in examine(robot.endpoint).items if f.topic == "camera") or found)
        assert len(found) == 1 and found[0].ok and found[0].name == "wrist"
        assert "pictures a second, 0 of" in found[0].detail and "clock " in found[0].detail
    session.close()


def test_a_camera_that_fails_tells_why_to_those_who_ask_for_a_while(robot: SimProcess):
    source = SteeredSource()
    session = open_client_session(robot.endpoint)
    service = CameraService(session, "wrist", source, FixedMounting(PLACE))
    thread = threading.Thread(target=service.run, args=(lambda: False, 1.0))
    thread.start()
    with CellClient.connect(robot.endpoint) as client:
        assert until(lambda: "wrist" in client.cameras())
        source.fail("the cable was pulled")
        with pytest.raises(RefusedError, match="camera 'wrist' gives no pictures: the cable was pulled"):
            client.frames()
        (health,) = client.camera_health()
        assert health.trouble == "the cable was pulled"
        thread.join(5.0)
        assert not thread.is_alive(), "it ends by itself"
        service.close()
        assert until(lambda: "wrist" not in client.cameras())
        with pytest.raises(CameraGoneError, match="camera 'wrist' is gone"):
            client.frames()
    session.close()


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    """The cell of the test's robot process, with a camera front and a camera wrist."""
    path = tmp_path / "test.yaml"
    path.write_text(CELL)
    return path


def test_a_camera_of_another_cell_and_an_unnamed_one_are_refused(robot: SimProcess, cell: Path, tmp_path: Path):
    source = lambda _: LiveSource()  # noqa: E731
    with pytest.raises(ConfigError, match=r"serves cell 'test', but this camera's place is taken from 'cubes'"):
        serve_device(CameraOptions(robot=robot.endpoint, name="static"), source, print)
    with pytest.raises(ConfigError, match=r"cell 'test' has cameras front, wrist; say which one this is with --name"):
        serve_device(CameraOptions(robot=robot.endpoint, cell=str(cell)), source, print)
    with pytest.raises(ConfigError, match=r"no camera 'top'; it has \['front', 'wrist'\]"):
        serve_device(CameraOptions(robot=robot.endpoint, cell=str(cell), name="top"), source, print)
    with pytest.raises(ConfigError, match=r"'front' is offered by the robot process at .* and by camera process"):
        serve_device(CameraOptions(robot=robot.endpoint, cell=str(cell), name="front"), source, print)
    with pytest.raises(ConfigError, match=r"--max-age 0 is not valid"):
        serve_device(CameraOptions(robot=robot.endpoint, name="static", max_age=0.0), source, print)
    other = tmp_path / "other.yaml"
    other.write_text(yaml.safe_dump({**yaml.safe_load(CELL), "name": "other"}))
    with pytest.raises(ConfigError, match=r"serves cell 'test', but this camera's place is taken from 'other'"):
        serve_device(CameraOptions(robot=robot.endpoint, cell=str(other), name="front"), source, print)


def test_a_recording_stands_in_for_a_camera_and_ends_as_it_was_told(robot: SimProcess, tmp_path: Path):
    frames = [replace(picture(100.0 + k, shade=10 * k), camera="top", world_T_camera=PLACE) for k in range(3)]
    save_npz(tmp_path / "look.npz", frames)
    command = [sys.executable, "-m", "replan.main", "camera", "recording", str(tmp_path / "look.npz"), "--every-frame"]
    command += ["--robot", robot.endpoint, "--parent-pid", str(os.getpid())]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        with CellClient.connect(robot.endpoint) as client:
            assert until(lambda: "top" in client.cameras(), 20.0)
            shades = [int(client.frames(["top"])[0].colour[0, 0, 0]) for _ in range(3)]
            assert shades == [0, 10, 20]
            np.testing.assert_array_equal(client.frames(["front"])[0].world_T_camera, np.eye(4))
            with pytest.raises(RefusedError, match=r"gives no pictures: the recording 'look\.npz' has ended"):
                client.frames(["top"])
        process.send_signal(signal.SIGINT)
        out, err = process.communicate()
    finally:
        process.kill()
    assert process.returncode == 0, err
    assert "camera 'top' ended (the recording 'look.npz' has ended): 3 pictures, 0 dropped" in out


def test_a_run_does_not_begin_without_a_camera_of_its_cell_file(robot: SimProcess):
    with served(robot.endpoint, LiveSource()), CellClient.connect(robot.endpoint) as client:
        check_cameras(client, ["front", "wrist"])
        with pytest.raises(MachineError, match=r"nobody offers camera 'top' of the cell file; there are front, side,"):
            check_cameras(client, ["front", "top"])
