"""Cameras in processes of their own: found, asked, missed, and refused when their pictures are old."""

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from benchmarks.robot_side.perfect_robot import blank_frame
from control.errors import ConfigError, RefusedError
from hw_interface.cameras.node import CameraNode
from hw_interface.cameras.offers import offered_cameras
from hw_interface.cell.client import CellClient
from hw_interface.cell.process import SimProcess
from hw_interface.errors import CameraGoneError
from hw_interface.link.transport import open_client_session
from tests.support.load.freezing import frozen
from tests.support.robot_side.hw_support import robot_process
from tests.support.waiting import until


@pytest.fixture(scope="module")
def robot() -> Iterator[SimProcess]:
    with robot_process() as process:
        yield process


@contextmanager
def camera_process(endpoint: str, owner: str, *cameras: str) -> Iterator["subprocess.Popen[str]"]:
    """A process of `tests.support.robot_side.hw_camera_process`, ended afterwards."""
    command = [sys.executable, "-m", "tests.support.robot_side.hw_camera_process", endpoint, owner, *cameras]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert process.stdin is not None and process.stdout is not None
    try:
        assert process.stdout.readline() == "ready\n"
        with CellClient.connect(endpoint) as client:  # tokens take a moment to get around
            assert until(lambda: set(cameras) <= set(client.cameras()))
        yield process
    finally:
        if process.poll() is None:
            process.stdin.close()
            process.wait()
        process.stdout.close()


def test_pictures_of_a_camera_process_come_through_the_robot_process(robot: SimProcess):
    with CellClient.connect(robot.endpoint) as client, camera_process(robot.endpoint, "bench", "wrist", "depth"):
        assert client.cameras() == ("front", "side", "depth", "wrist")
        before = time.time()
        frames = client.frames()
        assert [f.camera for f in frames] == ["front", "side", "depth", "wrist"]
        assert all(f.stamp >= before for f in frames)
    with CellClient.connect(robot.endpoint) as client:
        assert client.cameras() == ("front", "side")


def test_a_camera_that_two_processes_offer_is_an_error_that_names_both(robot: SimProcess):
    with CellClient.connect(robot.endpoint) as client, camera_process(robot.endpoint, "bench", "wrist"):
        session = open_client_session(robot.endpoint)
        try:
            with pytest.raises(ConfigError, match="'wrist' is offered by camera process bench and by camera"):
                CameraNode(session, ("wrist",), blank_frame)
            with pytest.raises(ConfigError, match=r"'front' is offered by the robot process at .* and by camera"):
                CameraNode(session, ("front",), blank_frame, "other")
            # Both began at once, and neither saw the other.
            token = session.liveliness().declare_token("cell/camera/wrist/other")
            assert until(lambda: offered_cameras(session, 1.0) == {"wrist": ["bench", "other"]})
            with pytest.raises(ConfigError, match="camera process bench and by camera process other; end one"):
                client.frames(["wrist"])
            token.undeclare()
            assert until(lambda: offered_cameras(session, 1.0) == {"wrist": ["bench"]})
        finally:
            session.close()
        assert [f.camera for f in client.frames(["wrist"])] == ["wrist"]


def test_a_picture_that_is_too_old_is_refused_with_its_age(robot: SimProcess):
    with CellClient.connect(robot.endpoint) as client, camera_process(robot.endpoint, "bench", "old"):
        with pytest.raises(RefusedError, match=r"the picture of camera 'old' is 60\.\d\d s old; at most 2 s") as caught:
            client.frames(["old"])
        assert caught.value.code == "stale_frame"
        assert [f.camera for f in client.frames(["old"], max_age=90.0)] == ["old"]


def test_what_a_camera_process_refuses_with_reaches_the_one_who_asked(robot: SimProcess):
    with CellClient.connect(robot.endpoint) as client, camera_process(robot.endpoint, "bench", "blind"):
        with pytest.raises(RefusedError, match="it is dark") as caught:
            client.frames(["blind"])
        assert caught.value.code == "no_light"


def test_a_frozen_camera_process_is_noticed_by_whoever_asks_it_and_answers_again_when_it_goes_on(robot: SimProcess):
    with CellClient.connect(robot.endpoint) as client, camera_process(robot.endpoint, "bench", "wrist") as process:
        assert client.frames(["wrist"])
        with (
            frozen(process.pid),
            pytest.raises(CameraGoneError, match=r"'wrist' \(bench\) does not answer; it has ended or is frozen"),
        ):
            client.frames(["wrist"])
        assert client.frames(["wrist"]), "its link has lasted"


def test_a_camera_whose_process_was_killed_is_missed_by_whoever_has_seen_it(robot: SimProcess):
    with CellClient.connect(robot.endpoint) as client, camera_process(robot.endpoint, "bench", "wrist") as process:
        assert len(client.frames()) == 3
        process.kill()
        process.wait()
        assert until(lambda: client.cameras() == ("front", "side"))
        for cameras in (["wrist"], None):
            with pytest.raises(CameraGoneError, match="camera 'wrist' is gone: its process bench has ended"):
                client.frames(cameras)
    with CellClient.connect(robot.endpoint) as client:
        with pytest.raises(RefusedError, match=r"no camera 'wrist' in this cell; it has \['front', 'side'\]"):
            client.frames(["wrist"])
        assert len(client.frames()) == 2


def test_a_camera_is_named_once(robot: SimProcess):
    session = open_client_session(robot.endpoint)
    with pytest.raises(ConfigError, match="give at least one, each once"):
        CameraNode(session, ("wrist", "wrist"), blank_frame)
    session.close()
