"""What goes wrong around a control box: blows, the user stop, clients that vanish or talk nonsense, silence."""

import json
import os
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from benchmarks.robot_side.libfranka_motions import along, desired, play, robot_at, swing
from control.errors import ConfigError
from hw_interface.fci_simulator.layout import (
    COMMAND,
    GRIPPER_PORT,
    HEADER,
    PORT,
    STATE,
    Command,
    Mode,
    MoveStatus,
)
from hw_interface.fci_simulator.process import ControlBoxProcess
from tests.support.robot_side.control_boxes import abort_of, control_box, go_home_if_far, later
from tests.support.waiting import GENEROUS, until

libfranka = pytest.importorskip("panda_py", reason="drives the box with libfranka").libfranka
# A client that waits for ever inside libfranka can be ended by nothing but the end of its process.
pytestmark = pytest.mark.timeout(method="thread")


@pytest.fixture(scope="module")
def box() -> Iterator[ControlBoxProcess]:
    with control_box() as process:
        yield process


@pytest.fixture
def robot(box: ControlBoxProcess) -> Any:
    client = robot_at(box.address)
    go_home_if_far(client)
    return client


def wait_for(box: ControlBoxProcess, **wanted: Any) -> dict[str, Any]:
    """The box's answer as soon as it is like that."""
    state: dict[str, Any] = {}

    def is_so() -> bool:
        state.update(box.faults.send("state"))
        return all(state[name] == value for name, value in wanted.items())

    assert until(is_so), f"never {wanted}, but {state}"
    return state


def test_a_blow_against_a_joint_is_a_joint_reflex_under_the_thresholds_that_were_set(
    box: ControlBoxProcess, robot: Any
):
    robot.set_collision_behavior([40.0] * 7, [40.0] * 7, [500.0] * 6, [500.0] * 6)
    samples = swing(desired(robot), along(1, 0.2), 0.6)
    play(robot, samples, lambda k: box.faults.send("push 4 20 0.1") if k == 300 else None)
    assert not robot.read_once().current_errors
    here = desired(robot)
    back = swing(here, along(1, -0.2), 0.6)
    said = abort_of(robot, back, lambda k: box.faults.send("push 4 -60 0.1") if k == 300 else None)
    assert "joint_reflex" in said
    state = robot.read_once()
    assert state.joint_collision == [0, 0, 0, 1, 0, 0, 0], "latched until the recovery"
    robot.automatic_error_recovery()
    assert not any(robot.read_once().joint_collision)


def test_a_pushed_joint_shows_the_torque_with_which_the_robot_holds_against_it(box: ControlBoxProcess, robot: Any):
    box.faults.send("push 4 15 60")
    state = later(robot, 0.5)
    box.faults.send("push 4 0 0.001")
    assert state.tau_ext_hat_filtered[3] == pytest.approx(-15.0, abs=0.2)
    assert state.robot_mode == libfranka.RobotMode.kIdle
    model = robot.load_model()
    jacobian = np.array(model.zero_jacobian(libfranka.Frame.kStiffness, state)).reshape(7, 6).T
    fitted, *_ = np.linalg.lstsq(jacobian.T, np.array(state.tau_ext_hat_filtered), rcond=None)
    np.testing.assert_allclose(state.O_F_ext_hat_K, fitted, atol=0.05)


def test_a_low_force_threshold_alone_is_a_cartesian_reflex(box: ControlBoxProcess, robot: Any):
    robot.set_collision_behavior([90.0] * 7, [90.0] * 7, [10.0] * 6, [10.0] * 6)
    samples = swing(desired(robot), along(1, 0.2), 0.6)
    said = abort_of(robot, samples, lambda k: box.faults.send("push 4 30 0.2") if k == 300 else None)
    assert "cartesian_reflex" in said
    robot.automatic_error_recovery()


def test_the_user_stop_aborts_brakes_and_cannot_be_recovered_while_pressed(box: ControlBoxProcess, robot: Any):
    samples = swing(desired(robot), along(1, 0.4), 0.8)
    said = abort_of(robot, samples, lambda k: box.faults.send("user_stop on") if k == 400 else None)
    assert "User Stop pressed" in said
    assert robot.read_once().robot_mode == libfranka.RobotMode.kUserStopped
    for refused in (robot.automatic_error_recovery, lambda: play(robot, samples)):
        with pytest.raises(RuntimeError, match=r"User Stop pressed|not possible in the current mode .*User stopped"):
            refused()
    state = later(robot, 0.4)
    np.testing.assert_allclose(state.dq, 0.0, atol=1e-3)
    box.faults.send("user_stop off")
    assert robot.read_once().robot_mode == libfranka.RobotMode.kIdle
    play(robot, swing(desired(robot), along(1, 0.01), 0.3))


@pytest.mark.parametrize(("fault", "mode"), [("brakes", "Other"), ("guiding", "Guiding")])
def test_no_motion_starts_in_another_mode(box: ControlBoxProcess, robot: Any, fault: str, mode: str):
    box.faults.send(f"{fault} on")
    try:
        with pytest.raises(RuntimeError, match=rf"not possible in the current mode .*{mode}"):
            play(robot, swing(desired(robot), along(1, 0.01), 0.3))
    finally:
        box.faults.send(f"{fault} off")


CLIENT = """
import sys
from benchmarks.robot_side.libfranka_motions import along, desired, play, robot_at, swing
robot = robot_at(sys.argv[1])
samples = swing(desired(robot), along(1, 0.6), 3.0)
def at(k):
    if k == 500:
        print("moving", flush=True)
        sys.stdin.readline()
play(robot, samples, at)
"""


def client_in_a_motion(box: ControlBoxProcess) -> "subprocess.Popen[str]":
    """Another process that has begun a motion and then sends nothing until it is given a line."""
    pipe = subprocess.PIPE
    command = [sys.executable, "-c", CLIENT, box.address]
    process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True)
    assert process.stdout is not None and process.stdout.readline() == "moving\n"
    return process


def test_a_client_that_is_killed_in_a_motion_leaves_a_braked_arm_and_room_for_the_next(box: ControlBoxProcess):
    process = client_in_a_motion(box)
    try:
        assert box.faults.send("state")["mode"] == "move"
        os.kill(process.pid, signal.SIGKILL)
        state = wait_for(box, mode="reflex", connected=False)
        assert state["errors"] == ["communication_constraints_violation"]
    finally:
        process.kill()
        process.communicate()
    robot = robot_at(box.address)  # recovers
    state = robot.read_once()
    assert state.robot_mode == libfranka.RobotMode.kIdle
    np.testing.assert_allclose(state.dq, 0.0, atol=1e-3)
    play(robot, swing(desired(robot), along(1, 0.01), 0.3))


def test_a_client_that_is_frozen_in_a_motion_is_noticed_even_in_lockstep(box: ControlBoxProcess):
    process = client_in_a_motion(box)
    state = wait_for(box, mode="reflex")
    assert state["errors"] == ["communication_constraints_violation"]
    _, errors = process.communicate("go on\n")
    assert "communication_constraints_violation" in errors


def raw(box: ControlBoxProcess, port: int = PORT) -> socket.socket:
    connection = socket.create_connection((box.address, port), GENEROUS)
    return connection


def connect_request(version: int, udp_port: int) -> bytes:
    return HEADER.pack(Command.CONNECT, 0, HEADER.size + 4) + struct.pack("<HH", version, udp_port)


@pytest.mark.parametrize(
    ("sent", "why"),
    [
        (HEADER.pack(99, 0, HEADER.size), "unknown command 99"),
        (HEADER.pack(Command.MOVE, 1, 12), "command 1 announces 12 bytes, it has 68"),
        (HEADER.pack(Command.MOVE, 1, 0xFFFFFFFF), "command 1 announces 4294967295 bytes, it has 68"),
        (b"GET / HTTP/1.1\r\n\r\n", "unknown command 542393671"),
        (HEADER.pack(Command.STOP_MOVE, 1, 12), "command 2 before a connect"),
    ],
)
def test_nonsense_closes_its_connection_and_nothing_else(box: ControlBoxProcess, sent: bytes, why: str):
    with raw(box) as connection:
        connection.sendall(sent)
        assert connection.recv(100) == b"", "closed"
    wait_for(box, connected=False)
    assert robot_at(box.address).read_once().robot_mode == libfranka.RobotMode.kIdle
    assert f"robot: connection closed: {why}" in box.process.errors()


def test_nonsense_to_the_gripper_leaves_the_robot_alone(box: ControlBoxProcess, robot: Any):
    with raw(box, GRIPPER_PORT) as connection:
        connection.sendall(b"\xff" * 64)
        assert connection.recv(100) == b""
    assert robot.read_once().robot_mode == libfranka.RobotMode.kIdle


def test_half_a_request_waits_for_its_other_half(box: ControlBoxProcess):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as states, raw(box) as connection:
        states.bind(("127.0.0.1", 0))
        states.settimeout(GENEROUS)
        request = connect_request(5, states.getsockname()[1])
        connection.sendall(request[:7])
        time.sleep(0.05)
        connection.sendall(request[7:])
        assert struct.unpack("<IIIBH", connection.recv(100)) == (0, 0, 15, 0, 5)
        assert len(states.recv(8192)) == STATE.itemsize


def test_in_lockstep_old_commands_are_not_taken_and_a_lost_state_comes_again(box: ControlBoxProcess):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as states, raw(box) as connection:
        states.bind(("127.0.0.1", 0))
        states.settimeout(GENEROUS)
        connection.sendall(connect_request(5, states.getsockname()[1]))
        assert connection.recv(100)[12] == 0
        connection.sendall(HEADER.pack(Command.MOVE, 1, 68) + bytes(56))
        assert connection.recv(100)[12] == MoveStatus.STARTED
        data, source = states.recvfrom(8192)
        while np.frombuffer(data, STATE)[0]["robot_mode"] != Mode.MOVE:
            data = states.recv(8192)
        command = np.zeros(1, COMMAND)
        command["q_c"] = np.frombuffer(data, STATE)["q_d"]
        command["message_id"], command["finished"] = 1, 1  # answers a state from long before this motion
        states.sendto(command.tobytes(), source)
        time.sleep(0.1)
        assert box.faults.send("state")["mode"] == "move"
        command["finished"] = 0
        ids: list[int] = []
        while len(ids) < 2 or ids[-1] != ids[-2]:  # answer what comes until it comes a second time
            ids.append(int(np.frombuffer(states.recv(8192), STATE)[0]["message_id"]))
            if len(ids) < 10:
                command["message_id"] = ids[-1]
                states.sendto(command.tobytes(), source)
        assert ids[:-1] == list(range(ids[0], ids[0] + len(ids) - 1))
        connection.sendall(HEADER.pack(Command.STOP_MOVE, 2, 12))
        assert connection.recv(100)[12] == MoveStatus.PREEMPTED


def test_another_version_of_the_library_is_told_which_one_this_is(box: ControlBoxProcess):
    with raw(box) as connection:
        connection.sendall(connect_request(10, 4000))
        assert struct.unpack("<IIIBH", connection.recv(100)) == (0, 0, 15, 1, 5)


def test_the_real_client_says_that_versions_differ(box: ControlBoxProcess):
    box.faults.send("version 10")
    try:
        with pytest.raises(Exception, match=r"speaks protocol version 10, but this panda-py was built .* version 5"):
            libfranka.Robot(box.address, libfranka.RealtimeConfig.kIgnore)
    finally:
        box.faults.send("version 5")


def test_there_is_one_client_at_a_time(box: ControlBoxProcess, robot: Any):
    with pytest.raises(Exception, match="libfranka"):
        libfranka.Robot(box.address, libfranka.RealtimeConfig.kIgnore)
    assert robot.read_once().robot_mode == libfranka.RobotMode.kIdle
    assert "robot: refused 127.0.0.1: one client at a time" in box.process.errors()


def test_without_the_research_interface_the_port_is_closed(box: ControlBoxProcess):
    box.faults.send("fci off")
    with pytest.raises(Exception, match="Please install FCI feature or enable FCI mode"):
        libfranka.Robot(box.address, libfranka.RealtimeConfig.kIgnore)
    box.faults.send("fci on")
    assert robot_at(box.address).server_version() == 5


@pytest.mark.parametrize("fault", ["freeze", "fci"])
def test_a_silent_box_takes_connections_and_answers_nothing(box: ControlBoxProcess, fault: str):
    box.faults.send(f"{fault} {'on' if fault == 'freeze' else 'silent'}")
    before = box.faults.send("state")
    with raw(box) as connection:
        connection.sendall(connect_request(5, 4000))
        connection.settimeout(0.5)
        with pytest.raises(TimeoutError):
            connection.recv(100)
    frozen = box.faults.send("state")["milliseconds"] == before["milliseconds"]
    assert frozen == (fault == "freeze")
    box.faults.send(f"{fault} {'off' if fault == 'freeze' else 'on'}")
    assert robot_at(box.address).server_version() == 5


def test_a_frozen_box_lets_the_client_wait_and_then_goes_on(box: ControlBoxProcess, robot: Any):
    box.faults.send("freeze on")
    with pytest.raises(Exception, match=r"Timeout|timeout"):
        for _ in range(10):
            robot.read_once()
    box.faults.send("freeze off")
    assert robot.read_once().robot_mode == libfranka.RobotMode.kIdle


def test_faults_are_answered_in_json_and_wrong_ones_explained(box: ControlBoxProcess):
    with pytest.raises(ConfigError, match=r"'push 9 1 1' is not valid; valid are: state, user_stop\|brakes"):
        box.faults.send("push 9 1 1")
    with socket.create_connection(("127.0.0.1", int(str(box.process.ready["control_port"]))), 5.0) as channel:
        channel.sendall(b"state\nreflex joint_reflex\n")
        with channel.makefile() as lines:
            assert json.loads(lines.readline())["ok"] is True
            assert json.loads(lines.readline())["mode"] == "reflex"


def test_an_address_that_is_taken_is_said_in_one_line(box: ControlBoxProcess):
    command = [sys.executable, "-m", "replan.main", "robot", "research-interface", "--address", box.address]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 1
    assert f"cannot listen at {box.address}:1337: Address already in use; another simulated control box" in done.stderr
    assert "or choose another address (--address 127.0.0.2)" in done.stderr
    assert "Traceback" not in done.stderr
