"""A Robotiq 2F-85 over Modbus, simulated by a server that speaks its registers."""

import pytest

from control.errors import ConfigError, MachineError
from control.trajectory.samples import GripperCommand
from hw_interface.robotiq.gripper import connect_robotiq
from hw_interface.robotiq.registers import Calibration, Status, force_byte, request, speed_byte
from tests.support.robot_side.robotiq_double import RobotiqDouble, on_serial_line, on_tcp
from tests.support.waiting import until

OPEN, CLOSE = GripperCommand("move", 0.085), GripperCommand("move", 0.0)


def test_bytes_mean_widths_speeds_and_forces_as_the_manual_says():
    c = Calibration()
    assert (c.position(0.085), c.position(0.0)) == (3, 230)
    assert (c.width(3), c.width(230), c.width(0), c.width(255)) == (0.085, 0.0, 0.085, 0.0)
    for width in (0.01, 0.04, 0.08):
        assert abs(c.width(c.position(width)) - width) < 0.0002
    assert (force_byte(20.0), force_byte(235.0), force_byte(500.0), force_byte(40.0)) == (0, 255, 255, 24)
    assert (speed_byte(0.02), speed_byte(0.15), speed_byte(0.085)) == (0, 255, 128)
    assert request(0x7B, 0x22, 0xFF) == [0x0900, 0x007B, 0x22FF]
    # The manual's example of an answer: activated, going, closed on an object.
    assert Status.of([0xB900, 0x00FF, 0xBD00]) == Status(3, True, 2, 0, 0xFF, 0xBD)


@pytest.mark.parametrize("line", [on_tcp, on_serial_line])
def test_a_gripper_is_activated_and_goes_where_it_is_told(line):
    double = RobotiqDouble()
    with line(double) as address:
        hand = connect_robotiq(address, activate=True)
        try:
            assert double.activations == 1 and not hand.read().grasped and hand.read().fault is None
            hand.begin(GripperCommand("move", 0.040))
            assert hand.read().busy, "at once, whatever the line takes"
            assert until(lambda: not hand.read().busy)
            assert abs(hand.read().width - 0.040) < 0.0003 and not hand.read().grasped
            assert double.requests[-1] == (123, 255, 0)
        finally:
            hand.close()


def test_a_gripper_that_is_activated_already_keeps_what_it_holds():
    double = RobotiqDouble(activated=True)
    with on_tcp(double) as address:
        hand = connect_robotiq(address, activate=True)
        hand.close()
    assert double.activations == 0


def test_a_thing_between_the_fingers_is_grasped_and_its_width_measured():
    double = RobotiqDouble(activated=True, thing=123)
    with on_tcp(double) as address:
        hand = connect_robotiq(address, activate=True)
        try:
            hand.begin(GripperCommand("grasp", 0.040, 60.0))
            assert until(lambda: not hand.read().busy)
            reading = hand.read()
            assert reading.grasped and abs(reading.width - 0.040) < 0.0003
            assert double.requests[-1] == (255, 255, 47)
            hand.begin(OPEN)
            assert until(lambda: not hand.read().busy)
            assert not hand.read().grasped and hand.read().width == 0.085
            double.thing = None
            hand.begin(GripperCommand("grasp", 0.040, 60.0))
            assert until(lambda: not hand.read().busy)
            assert not hand.read().grasped and hand.read().width == 0.0, "it closed on nothing"
        finally:
            hand.close()


def test_a_gripper_that_does_not_answer_is_a_fault_and_starts_again_when_told():
    double = RobotiqDouble(activated=True)
    with on_tcp(double) as address:
        hand = connect_robotiq(address, activate=True)
        try:
            double.silent = True
            assert until(lambda: hand.read().fault is not None)
            assert "does not answer; see to its cable and its 24 V supply" in (hand.read().fault or "")
            with pytest.raises(MachineError, match="does not answer"):
                hand.begin(CLOSE)
            double.silent = False
            hand.restart()
            assert until(lambda: hand.read().fault is None and not hand.read().connecting)
            hand.begin(CLOSE)
            assert until(lambda: not hand.read().busy and hand.read().width == 0.0)
        finally:
            hand.close()


def test_a_fault_of_the_gripper_is_told_in_words():
    double = RobotiqDouble(activated=True)
    with on_tcp(double) as address:
        hand = connect_robotiq(address, activate=True)
        try:
            double.fault = 0x0A
            assert until(lambda: hand.read().fault is not None)
            assert "has a fault: its supply is below 21.6 V" in (hand.read().fault or "")
        finally:
            hand.close()


def test_a_gripper_that_is_not_there_and_a_wrong_address_are_named():
    with pytest.raises(MachineError, match=r"no line to the gripper at tcp:127\.0\.0\.1:1;"):
        connect_robotiq("tcp:127.0.0.1:1", activate=True)
    double = RobotiqDouble()
    double.silent = True
    with on_tcp(double) as address:
        with pytest.raises(MachineError, match=r"does not answer; see to .* on the line \(9\)"):
            connect_robotiq(address, activate=True)
        double.silent = False
    for wrong in ("usb0", "rtu:", "tcp:host:x"):
        with pytest.raises(ConfigError, match=f"gripper address '{wrong}' is not valid"):
            connect_robotiq(wrong, activate=True)
