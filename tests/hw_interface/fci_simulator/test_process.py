"""`replan robot research-interface` as a process: its cell, its pace, its cameras, its end."""

import datetime
import json
import os
import random
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh

from benchmarks.robot_side.libfranka_motions import along, desired, play, robot_at, swing
from benchmarks.robot_side.perfect_robot import blank_frame
from control.errors import ConfigError, RobotGoneError
from control.robot.limits import REST_Q
from hw_interface.fci_simulator.cameras import LateCameras
from hw_interface.fci_simulator.layout import GRIPPER_PORT, PORT
from hw_interface.fci_simulator.process import ControlBoxProcess, free_address, start_control_box
from hw_interface.link.keys import make_keys
from hw_interface.link.requests import ask
from hw_interface.link.transport import ALIVE_KEY, FRAME_KEY, TRUTH_KEY, open_robot_session
from hw_interface.messages.frames import FrameMessage
from hw_interface.messages.robot import FrameRequest
from hw_interface.messages.truth import TruthMessage, TruthRequest
from tests.support.robot_side.link_certificates import link
from tests.support.waiting import until

libfranka = pytest.importorskip("panda_py", reason="drives the box with libfranka").libfranka
# A client that waits for ever inside libfranka can be ended by nothing but the end of its process.
pytestmark = pytest.mark.timeout(method="thread")

COMMAND = [sys.executable, "-m", "replan.main", "robot", "research-interface"]


@pytest.fixture(scope="module")
def listener() -> Iterator[tuple[zenoh.Session, str]]:
    """Where a robot process would listen; it is there before and after the box, and says so late."""
    session, endpoint = open_robot_session("tcp/127.0.0.1:0")
    yield session, endpoint
    session.close()


@pytest.fixture(scope="module")
def box(listener: tuple[zenoh.Session, str]) -> Iterator[ControlBoxProcess]:
    command = [*COMMAND, "--address", free_address(random.Random()), "--pace", "lockstep"]
    with start_control_box([*command, "--endpoint", listener[1], "--score"]) as process:
        yield process


def picture(session: zenoh.Session, camera: str) -> FrameMessage:
    """A picture, once the cameras are there."""
    taken: list[FrameMessage] = []

    def take() -> bool:
        with suppress(RobotGoneError):
            taken.append(ask(session, f"{FRAME_KEY}/{camera}", FrameRequest(), FrameMessage, 10.0))
        return bool(taken)

    assert until(take)
    return taken[0]


def test_cameras_show_the_arm_that_the_client_has_moved(box: ControlBoxProcess, listener: tuple[zenoh.Session, str]):
    session, _ = listener
    alive = session.liveliness().declare_token(ALIVE_KEY)
    robot = robot_at(box.address)
    before = picture(session, "static").frame()
    assert before.colour.std() > 10.0 and np.isfinite(before.depth).mean() > 0.5
    again = picture(session, "static").frame()
    play(robot, swing(desired(robot), along(1, 0.8), 1.5))
    after = picture(session, "static").frame()

    def changed(a: Any, b: Any) -> float:
        return float((np.abs(a.colour.astype(int) - b.colour.astype(int)).max(axis=-1) > 40).mean())

    assert changed(before, again) < 0.002
    assert changed(before, after) > 0.01
    assert robot.read_once().robot_mode == libfranka.RobotMode.kIdle, "the box has gone on meanwhile"
    truth = ask(session, TRUTH_KEY, TruthRequest(), TruthMessage, 10.0).truth()
    assert {"red_cube", "crate"} <= truth.things.keys()
    alive.undeclare()


def test_cameras_reach_a_robot_on_another_machine_with_certificates_only(tmp_path: Path):
    make_keys(tmp_path / "keys", ("127.0.0.1",), 90, datetime.datetime.now(datetime.UTC))
    security, ended = link(tmp_path / "keys", "camera"), threading.Event()
    session, endpoint = open_robot_session("tls/127.0.0.1:0", link(tmp_path / "keys", "robot"))
    with pytest.raises(ConfigError, match=r"needs certificates: give a link file \(--link FILE"):
        LateCameras(endpoint, ("static",), blank_frame, print)
    cameras = LateCameras(endpoint, ("static",), blank_frame, print, security=security)

    def serve() -> None:
        while not ended.wait(0.01):
            cameras.serve()

    loop = threading.Thread(target=serve)
    loop.start()
    try:
        assert picture(session, "static").frame().camera == "static"
    finally:
        ended.set()
        loop.join()
        cameras.close()
        session.close()


def test_it_keeps_to_real_time_until_ctrl_c_which_frees_its_ports():
    address = free_address(random.Random())
    process = subprocess.Popen(
        [*COMMAND, "--address", address],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        assert process.stdout is not None
        ready = json.loads(process.stdout.readline())
        assert ready["endpoint"] == address and ready["control_port"] is None and ready["pace"] == "real-time"
        robot = robot_at(address)
        np.testing.assert_allclose(robot.read_once().q, REST_Q, atol=2e-4)
        begun, first = time.monotonic(), robot.read_once().time.to_msec()
        seen = {first}
        while len(seen) < 100:  # at 1 kHz a tenth of a second, if the machine is not busy
            seen.add(robot.read_once().time.to_msec())
        passed = max(seen) - first
        assert passed <= 1000 * (time.monotonic() - begun) + 10, "robot time never runs ahead of the clock"
        os.kill(process.pid, signal.SIGINT)
        _, errors = process.communicate()
    finally:
        process.kill()
    assert process.returncode == 0
    assert "Traceback" not in errors
    for port in (PORT, GRIPPER_PORT):
        socket.create_server((address, port)).close()


def test_an_unknown_cell_is_named_in_one_line():
    done = subprocess.run([*COMMAND, "--cell", "nowhere"], capture_output=True, text=True)
    assert done.returncode == 2 and "nowhere" in done.stderr and "Traceback" not in done.stderr
