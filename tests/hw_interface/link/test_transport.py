"""Robot processes over the wire: playing, stopping, dying, freezing, and garbage on every key."""

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from benchmarks.robot_side.perfect_robot import FIRMWARE, certificate, from_here
from control.errors import ConfigError, RefusedError, RobotGoneError, StoppedError
from hw_interface.cell.client import SILENCE, CellClient, MotionProgress
from hw_interface.cell.process import SimProcess, start_sim_process
from hw_interface.link import requests, transport
from hw_interface.messages.motions import TrajectoryRequest
from hw_interface.messages.robot import Accepted, Refusal, RobotState, StateRequest
from hw_interface.messages.wire import decode, encode
from tests.support.load.freezing import freeze, wake
from tests.support.robot_side.hw_support import idle_client, robot_process
from tests.support.waiting import until

HEAVY = ("mujoco", "torch", "open3d", "transformers", "scipy", "cv2")


@pytest.fixture(scope="module")
def robot() -> Iterator[SimProcess]:
    """One robot process without physics for all tests that leave it alive and idle."""
    with robot_process("perfect", speed=1.0) as process:
        yield process


@pytest.fixture
def client(robot: SimProcess) -> Iterator[CellClient]:
    with idle_client(robot.endpoint) as client:
        yield client


@pytest.mark.real_time
def test_a_motion_is_played_to_its_end_with_progress(client: CellClient):
    motion = from_here(client, 0.6, 0.05)
    seen = []
    report = client.execute(motion, certificate(motion), seen.append)
    assert report.completed and report.reason == "completed" and report.detail == ""
    assert report.played == report.samples == len(motion.q)
    assert report.final_state.mode == "idle"
    np.testing.assert_allclose(report.final_state.q_d, motion.q[-1], atol=1e-12)
    np.testing.assert_allclose(report.q[-1], motion.q[-1], atol=1e-12)
    played = [p.played for p in seen]
    assert len(played) > 10 and played == sorted(played) and played[-1] == len(motion.q)


@pytest.mark.real_time
def test_a_motion_at_pace_one_takes_its_own_time(client: CellClient):
    motion = from_here(client, 1.0, -0.05)
    begun = time.monotonic()
    client.execute(motion, certificate(motion))
    # Never faster; how much slower depends on the machine.
    assert time.monotonic() - begun >= 0.97


@pytest.mark.real_time
def test_a_motion_is_played_at_the_speed_that_is_asked_for(client: CellClient):
    motion = from_here(client, 0.5, 0.05)
    seen: list[MotionProgress] = []
    begun = time.monotonic()
    report = client.execute(motion, certificate(motion), seen.append, speed=0.5)
    assert 0.97 <= time.monotonic() - begun < 4.0
    assert report.completed and report.played == report.samples == len(motion.q)
    np.testing.assert_array_equal(report.speed[1:-1], 0.5)
    assert {p.state.speed for p in seen if 1 < p.played < p.samples} == {0.5}
    assert report.final_state.speed == 0.0 and report.final_state.speed_wanted == 0.5


@pytest.mark.real_time
def test_the_speed_of_a_motion_changes_while_it_is_played(client: CellClient):
    motion = from_here(client, 1.5, 0.1)
    threading.Timer(0.5, lambda: client.set_speed(0.4)).start()
    report = client.execute(motion, certificate(motion))
    assert report.completed
    assert report.speed[1] == 1.0 and report.speed[-2] == 0.4
    assert client.state().speed_wanted == 0.4


@pytest.mark.parametrize("speed", [0.0, -1.0, 1.5])
def test_a_speed_that_was_not_judged_is_refused_over_the_wire(client: CellClient, speed: float):
    with pytest.raises(RefusedError, match="must be above 0 and at most 1") as caught:
        client.set_speed(speed)
    assert caught.value.code == "bad_speed"
    motion = from_here(client, 0.5, 0.05)
    with pytest.raises(RefusedError, match="must be above 0 and at most 1"):
        client.execute(motion, certificate(motion), speed=speed)
    assert client.state().mode == "idle" and client.state().speed_wanted == 1.0


def test_the_firmware_of_the_robot_is_told_and_a_certificate_for_another_is_refused(client: CellClient):
    assert client.info.firmware == client.state().firmware == FIRMWARE
    motion = from_here(client, 0.5, 0.05)
    with pytest.raises(RefusedError, match=r"for firmware 'panda system 3\.x'") as caught:
        client.execute(motion, certificate(motion, firmware="panda system 3.x"))
    assert caught.value.code == "wrong_firmware"


def test_a_refusal_reaches_the_client_with_its_code(client: CellClient):
    motion = from_here(client, 0.6, 0.05)
    with pytest.raises(RefusedError, match="without a certificate") as caught:
        client.execute(motion, None)
    assert caught.value.code == "no_certificate"
    assert client.state().mode == "idle"


def test_states_arrive_at_fifty_a_second_or_more(client: CellClient):
    stamps: list[float] = []
    session = transport.open_client_session(client.endpoint)
    try:
        session.declare_subscriber(
            transport.STATE_KEY, lambda s: stamps.append(decode(s.payload.to_bytes(), RobotState).stamp)
        )
        assert until(lambda: len(stamps) > 60)
    finally:
        session.close()
    assert np.median(np.diff(stamps)) <= 0.02


def test_all_cameras_or_the_named_ones_are_shown(client: CellClient):
    before = time.time()
    assert [f.camera for f in client.frames()] == list(client.cameras()) == ["front", "side"]
    (frame,) = client.frames(["side"])
    assert frame.camera == "side" and frame.stamp >= before
    assert frame.colour.shape == (24, 32, 3)


def test_an_unknown_camera_is_named_with_those_that_exist(client: CellClient):
    with pytest.raises(RefusedError, match=r"no camera 'top' in this cell; it has .*front.*side"):
        client.frames(["top"])


@pytest.mark.real_time
def test_a_stop_in_a_motion_ends_execute_and_needs_an_acknowledgement(client: CellClient):
    motion = from_here(client, 3.0, 0.3)
    threading.Timer(0.8, client.stop).start()
    begun = time.monotonic()
    with pytest.raises(StoppedError, match="the arm rests on its path"):
        client.execute(motion, certificate(motion))
    assert time.monotonic() - begun < 2.5, "it must not play to the end"
    rest = np.array(client.state().q_d)
    assert client.state().mode == "stopped"
    assert np.abs(motion.q - rest).max(axis=1).min() < 1e-3, "it rests on its path"
    again = from_here(client, 0.6, 0.02)
    with pytest.raises(RefusedError, match="acknowledge"):
        client.execute(again, certificate(again))
    assert client.acknowledge().mode == "idle"
    assert client.execute(again, certificate(again)).completed


@pytest.mark.real_time
def test_ctrl_c_brings_the_arm_to_rest_before_it_is_raised(client: CellClient):
    motion = from_here(client, 3.0, 0.3)
    threading.Timer(0.8, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        client.execute(motion, certificate(motion))
    state = client.state()
    assert state.mode == "stopped" and not any(state.qd)


@pytest.mark.real_time
def test_a_fault_of_the_watching_program_brings_the_arm_to_rest(client: CellClient):
    motion = from_here(client, 3.0, 0.3)

    def faulty(progress: MotionProgress) -> None:
        if progress.played > 500:
            raise ZeroDivisionError("in the callback")

    with pytest.raises(ZeroDivisionError):
        client.execute(motion, certificate(motion), faulty)
    state = client.state()
    assert state.mode == "stopped" and state.progress < len(motion.q)


@pytest.mark.parametrize(
    ("number", "name", "why"),
    [
        (signal.SIGKILL, "killed", "has ended, or the link to it was lost"),
        (signal.SIGSTOP, "frozen", "has not reported for 3"),
    ],
)
def test_a_robot_process_that_is_killed_is_noticed_at_once_and_a_frozen_one_by_its_silence(
    number: int, name: str, why: str
):
    with robot_process("perfect") as process, CellClient.connect(process.endpoint) as client:
        motion = from_here(client, 5.0, 0.3)
        when: list[float] = []

        def strike() -> None:
            when.append(time.monotonic())
            if name == "frozen":
                freeze(process.pid)
            else:
                os.kill(process.pid, number)

        threading.Timer(0.7, strike).start()
        with pytest.raises(RobotGoneError, match=why):
            client.execute(motion, certificate(motion))
        if name == "killed":
            assert time.monotonic() - when[0] < SILENCE, "by its closed socket"
            with pytest.raises(RobotGoneError):
                client.execute(motion, certificate(motion))
        else:
            wake(process.pid)
            with CellClient.connect(process.endpoint) as later:
                assert until(lambda: later.state().mode == "reflex"), "a revived robot must not go on"
                error = later.state().last_error
                assert error is not None and error.code == "frozen"
                rest = later.state().q_d
                assert np.abs(np.array(rest) - motion.q[-1]).max() > 0.01


def test_a_restarted_robot_is_not_taken_for_the_old_one():
    with robot_process("perfect") as first:
        client = CellClient.connect(first.endpoint)
    with robot_process("perfect", endpoint=first.endpoint) as second:
        assert second.epoch != first.epoch
        try:
            with pytest.raises(RobotGoneError, match=r"restarted|did not answer"):
                until(lambda: client.state() is None, 10.0)
        finally:
            client.close()


def test_a_motion_meant_for_an_earlier_run_of_the_robot_is_refused(robot: SimProcess, client: CellClient):
    motion = from_here(client, 0.6, 0.05)
    late = TrajectoryRequest.of(motion, certificate(motion), epoch="of yesterday", operator="somebody")
    session = transport.open_client_session(robot.endpoint)
    try:
        with pytest.raises(RefusedError, match=r"meant for run 'of yesterday' .*this is run .*connect again") as caught:
            requests.ask(session, transport.TRAJECTORY_KEY, late, Accepted, 5.0)
    finally:
        session.close()
    assert caught.value.code == "wrong_epoch" and client.state().mode == "idle"


def test_a_port_in_use_is_named_with_what_to_do(robot: SimProcess):
    port = robot.endpoint.rpartition(":")[2]
    with (
        pytest.raises(ConfigError, match=rf"port {port} is in use; .*choose another port"),
        robot_process("perfect", endpoint=robot.endpoint),
    ):
        pass


@pytest.mark.parametrize(
    ("endpoint", "text"),
    [("tcp/192.0.2.1:7447", "not on this machine"), ("7447", "is not valid"), ("tcp/127.0.0.1:99999", "is not valid")],
)
def test_only_endpoints_on_this_machine_are_taken(endpoint: str, text: str):
    with pytest.raises(ConfigError, match=text):
        transport.open_robot_session(endpoint)
    with pytest.raises(ConfigError, match=text):
        CellClient.connect(endpoint)


def test_nobody_there_is_said_within_the_time_given():
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    begun = time.monotonic()
    with pytest.raises(RobotGoneError, match=f"no robot process answers at tcp/127.0.0.1:{port} within 0.5 s"):
        CellClient.connect(f"tcp/127.0.0.1:{port}", timeout=0.5)
    assert time.monotonic() - begun < 2.0


def test_garbage_on_every_key_is_refused_and_does_nothing(robot: SimProcess, client: CellClient):
    before = client.state()
    rng = np.random.default_rng(0)
    garbage = [b"", b"\xc1\x00", encode(StateRequest())[:-3], rng.bytes(2000), encode(Refusal(code="x", reason="y"))]
    keys = [
        transport.INFO_KEY,
        transport.STATE_KEY,
        f"{transport.FRAME_KEY}/front",
        transport.TRAJECTORY_KEY,
        transport.STOP_KEY,
        transport.SPEED_KEY,
        transport.ACKNOWLEDGE_KEY,
        transport.RESULT_KEY,
        transport.TRUTH_KEY,
    ]
    session = transport.open_client_session(robot.endpoint)
    try:
        for key in keys:
            for data in [None, *garbage]:
                session.put(key, data or b"")
                (reply,) = list(session.get(key, payload=data, timeout=5.0))
                assert reply.ok is None and reply.err is not None, key
                assert decode(reply.err.payload.to_bytes(), Refusal).code == "bad_message", key
    finally:
        session.close()
    # Bytes that are not even the transport's.
    with socket.create_connection(("127.0.0.1", int(robot.endpoint.rpartition(":")[2]))) as raw:
        raw.sendall(rng.bytes(5000))
    after = client.state()
    assert (after.mode, after.q_d, after.motion_serial) == (before.mode, before.q_d, before.motion_serial)
    motion = from_here(client, 0.6, 0.01)
    assert client.execute(motion, certificate(motion)).completed, "and it still works"


@pytest.mark.real_time
def test_a_robot_that_is_told_to_end_in_a_motion_rests_first():
    with robot_process("perfect") as process, CellClient.connect(process.endpoint) as client:
        motion = from_here(client, 3.0, 0.3)
        threading.Timer(0.8, lambda: os.kill(process.pid, signal.SIGTERM)).start()
        modes: list[str] = []
        with pytest.raises((StoppedError, RobotGoneError)):
            client.execute(motion, certificate(motion), lambda p: modes.append(p.state.mode))
        assert modes[-1] == "stopped"
        assert until(lambda: not process.running)


@pytest.mark.real_time
def test_a_client_that_was_busy_when_the_robot_ended_still_hears_how_the_motion_went():
    with robot_process("perfect") as process, CellClient.connect(process.endpoint) as client:
        motion = from_here(client, 3.0, 0.3)
        modes: list[str] = []

        def busy_until_it_is_gone(progress):
            modes.append(progress.state.mode)
            if len(modes) == 1:
                os.kill(process.pid, signal.SIGTERM)
                assert until(lambda: not process.running)
                assert until(lambda: not client._alive)

        with pytest.raises(RobotGoneError):
            client.execute(motion, certificate(motion), busy_until_it_is_gone)
        assert modes == ["moving", "stopped"]


def test_a_robot_process_ends_with_its_parent():
    script = (
        "import os, sys; from hw_interface.cell.process import start_sim_process; "
        "p = start_sim_process([sys.executable, '-m', 'tests.support.robot_side.hw_robot_process', "
        "'perfect', 'tcp/127.0.0.1:0', '1.0']); "
        "print(p.pid, flush=True); os._exit(1)"
    )
    done = subprocess.run([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True, timeout=60, check=False)
    pid = int(done.stdout)

    def ended() -> bool:
        try:
            with open(f"/proc/{pid}/stat") as stat:
                return stat.read().rpartition(")")[2].split()[0] == "Z"  # only its new parent has not noticed yet
        except FileNotFoundError:
            return True

    assert until(ended)


def test_a_program_that_never_gets_ready_is_ended_and_its_words_are_shown():
    with pytest.raises(ConfigError, match=r"exit code 3\): no crate in the cellar"):
        start_sim_process(
            [sys.executable, "-c", "import sys; print('no crate in the cellar', file=sys.stderr); sys.exit(3)"]
        )
    begun = time.monotonic()
    with pytest.raises(RobotGoneError, match=r"not ready within 0.3 s"):
        start_sim_process([sys.executable, "-c", "import time; print('ready?'); time.sleep(60)"], deadline=0.3)
    assert time.monotonic() - begun < 5.0


def test_the_robot_side_imports_nothing_heavy():
    modules = [
        *(f"hw_interface.cell.{name}" for name in ("driver", "node", "client", "pacing", "process", "gate")),
        "hw_interface.link.transport",
        "hw_interface.simulated.fake_backend",
        "hw_interface.messages.frames",
        "hw_interface.messages.motions",
    ]
    script = f"import sys, {', '.join(modules)}; print([m for m in {HEAVY!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True, check=True)
    assert done.stdout.strip() == "[]"
