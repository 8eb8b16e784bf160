"""`replan doctor --robot ADDRESS`: every way in which a Panda's control box may not answer is told in one line."""

import json
import random
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager

import pytest

from benchmarks.robot_side.libfranka_motions import robot_at
from hw_interface.fci_simulator.layout import GRIPPER_PORT, PORT
from hw_interface.fci_simulator.process import ControlBoxProcess, free_address
from replan.doctor.control_box import Examined, examine_control_box
from tests.support.robot_side.control_boxes import control_box

WAIT = 0.5  # [s] at each step; the box is on this machine


@pytest.fixture(scope="module")
def box() -> Iterator[ControlBoxProcess]:
    with control_box() as process:
        yield process


@contextmanager
def fault(box: ControlBoxProcess, on: str, off: str) -> Iterator[None]:
    box.faults.send(on)
    try:
        yield
    finally:
        box.faults.send(off)


def robot_line(address: str, **options: int) -> Examined:
    robot = examine_control_box(address, WAIT, **options)[0]
    assert robot.name == f"control box {address}"
    assert "\n" not in robot.detail
    return robot


def gripper_line(address: str) -> Examined:
    _, gripper = examine_control_box(address, WAIT)
    assert gripper.name == f"gripper {address}"
    return gripper


def test_a_robot_that_can_be_driven_is_ready(box: ControlBoxProcess):
    robot, gripper = examine_control_box(box.address, 2.0)
    assert robot.ok and robot.detail.startswith("research interface 5, ")
    assert robot.detail.endswith(" states/s, idle: ready to move")
    assert gripper == Examined(f"gripper {box.address}", True, "Franka Hand, interface 3")
    assert box.faults.send("state")["mode"] == "idle", "nothing was moved"
    assert not box.faults.send("state")["connected"], "the connection is free for the driver"


def test_a_name_without_a_machine(box: ControlBoxProcess):
    (robot,) = examine_control_box("no-such-robot.invalid", WAIT)
    assert not robot.ok
    assert robot.detail.startswith("no machine is called 'no-such-robot.invalid' (")
    assert robot.detail.endswith("give the address that Desk is opened with")


def test_a_network_that_does_not_answer():
    address = free_address(random.Random(6))
    with closing(socket.create_server((address, PORT), backlog=0)), ExitStack() as waiting:
        for _ in range(3):  # a full queue of connections: further ones are not even refused
            one = waiting.enter_context(socket.socket())
            one.setblocking(False)
            one.connect_ex((address, PORT))
        (robot,) = examine_control_box(address, WAIT)
    assert not robot.ok
    assert robot.detail == (
        f"no answer from {address} (timed out): is the control box on, and this computer connected to its LAN port "
        "(not the arm's) with an address of the same network?"
    )


def test_a_machine_that_is_no_control_box():
    address = free_address(random.Random(3))
    robot = robot_line(address)
    assert robot.detail == (
        f"nothing listens at {address}:1337 and there is no Desk either: it is another machine, or the control box is "
        "still starting"
    )


def test_a_control_box_without_fci_is_told_by_its_web_pages(box: ControlBoxProcess):
    with socket.create_server((box.address, 0)) as desk, fault(box, "fci off", "fci on"):
        robot = robot_line(box.address, desk_port=desk.getsockname()[1])
    assert robot.detail.startswith(f"a control box answers at {box.address}, but FCI is not activated: open https://")
    assert "Activate FCI" in robot.detail


@pytest.mark.parametrize(("on", "off"), [("fci silent", "fci on"), ("freeze on", "freeze off")])
def test_a_box_that_takes_connections_and_never_answers_does_not_hold_the_doctor_up(
    box: ControlBoxProcess, on: str, off: str
):
    with fault(box, on, off):
        robot = robot_line(box.address)
    assert robot.detail.startswith(f"{box.address}:1337 takes connections and does not answer within 0.5 s")
    assert "(a libfranka program would wait for ever)" in robot.detail


@pytest.mark.parametrize(
    ("version", "said"),
    [
        (
            10,
            "it speaks research interface 10 (10 is a Franka Research 3's), panda-python 1.1.1 (libfranka 0.9.2)",
        ),
        (
            4,
            "it speaks research interface 4, panda-python 1.1.1 (libfranka 0.9.2) speaks 5: update",
        ),
    ],
)
def test_another_protocol_version_says_which_one_fits(box: ControlBoxProcess, version: int, said: str):
    with fault(box, f"version {version}", "version 5"):
        robot = robot_line(box.address)
    assert robot.detail.startswith(said)
    assert "system 4.2.1 or later" in robot.detail or "system to 4.2.1 or later" in robot.detail


@pytest.mark.parametrize(
    ("on", "off", "said"),
    [
        ("user_stop on", "user_stop off", "but the user stop is pressed: release the external activation device"),
        ("brakes on", "brakes off", "but in mode 'other', which mostly means locked brakes: open the brakes in Desk"),
        ("guiding on", "guiding off", "but somebody is guiding the arm by hand: let go of the guiding button"),
    ],
)
def test_a_mode_in_which_nothing_moves(box: ControlBoxProcess, on: str, off: str, said: str):
    with fault(box, on, off):
        robot = robot_line(box.address)
    assert not robot.ok and robot.detail.endswith(said)


def test_a_reflex_is_told_with_its_errors(box: ControlBoxProcess):
    box.faults.send("reflex tau_J_range_violation")
    robot = robot_line(box.address)
    assert "but in reflex (tau_J_range_violation): look at the cell, then recover" in robot.detail
    robot_at(box.address)  # recovers


def test_a_robot_that_somebody_else_drives(box: ControlBoxProcess):
    client = robot_at(box.address)
    robot = robot_line(box.address)
    assert "closed the connection at once: another program is connected to the robot" in robot.detail
    assert client.read_once() is not None


def test_states_that_do_not_arrive_are_a_firewall():
    """A service that greets like a control box and then sends nothing."""
    address = free_address(random.Random(4))
    with closing(socket.create_server((address, PORT))) as server:

        def greet() -> None:
            connection, _ = server.accept()
            with connection:
                connection.recv(16)
                connection.sendall(bytes([0] * 8 + [15, 0, 0, 0, 0, 5, 0]))
                connection.recv(16)

        thread = threading.Thread(target=greet, daemon=True)
        thread.start()
        robot = robot_line(address)
        thread.join(5.0)
    assert "no state arrives by UDP within 0.5 s: a firewall on this computer" in robot.detail


def test_another_service_on_the_port_is_no_control_box():
    address = free_address(random.Random(5))
    with closing(socket.create_server((address, PORT))) as server:

        def greet() -> None:
            connection, _ = server.accept()
            with connection:
                connection.sendall(b"SSH-2.0-OpenSSH_9.2p1\r\n")
                connection.recv(16)

        thread = threading.Thread(target=greet, daemon=True)
        thread.start()
        robot = robot_line(address)
        thread.join(5.0)
    assert robot.detail.startswith(f"what answers at {address}:1337 is no research interface (5353482d")


def test_a_gripper_that_is_absent_or_silent(box: ControlBoxProcess):
    with fault(box, "gripper off", "gripper on"):
        absent = gripper_line(box.address)
    assert absent.detail.startswith(f"no Franka Hand at {box.address}:{GRIPPER_PORT}: none is mounted or chosen")
    with fault(box, "gripper_silent on", "gripper_silent off"):
        silent = gripper_line(box.address)
    assert silent.detail.startswith("the Franka Hand's service does not answer: choose Re-initialize hand in Desk")
    assert not absent.ok and not silent.ok
    assert gripper_line(box.address).ok


def test_the_command_shows_both_lines_and_keeps_its_exit_code(box: ControlBoxProcess):
    command = [sys.executable, "-m", "replan.main", "doctor", "--robot", box.address, "--json"]
    done = subprocess.run(command, capture_output=True, text=True)
    found = [f for f in json.loads(done.stdout)["findings"] if f["topic"] == "robot"]
    assert [f["name"] for f in found] == [f"control box {box.address}", f"gripper {box.address}"]
    assert all(f["ok"] for f in found)
    assert done.returncode == 0
