"""A gripper in a process of its own: what it says, and what the supervisor sees when it hangs or ends."""

import os
import signal
import sys
import time

import pytest

from control.errors import MachineError
from control.trajectory.samples import GripperCommand
from hw_interface.panda.hand_process import HandProcess
from tests.support.load.freezing import freeze, wake

HAND = """
import os, sys, time
from multiprocessing.connection import Connection
from control.errors import MachineError
from hw_interface.panda.hand import HandReading
from hw_interface.panda.hand_process import KINDS, serve_hand
from hw_interface.panda.link import Link

class Slow:
    def __init__(self):
        self.width, self.until, self.fault, self.grasped = 0.08, 0.0, None, False
    def read(self):
        return HandReading(self.width, time.monotonic() < self.until, self.grasped, self.fault)
    def begin(self, command):
        self.until = time.monotonic() + 0.3
        self.width, self.grasped = command.width, command.kind == "grasp"
        if command.width == 0.013:
            self.fault = "a finger is stuck"
    def restart(self): pass
    def close(self): pass

def connect():
    if sys.argv[1] == "absent":
        raise MachineError("no gripper answers; see that it is on")
    return Slow()

link, board = int(sys.argv[3]), int(sys.argv[5])
parent = os.getppid()
sys.exit(serve_hand(connect, Link(Connection(link), KINDS), board, lambda: os.getppid() != parent))
"""


def hand(kind: str = "there") -> HandProcess:
    process = HandProcess([sys.executable, "-c", HAND, kind])
    try:
        process.await_ready()
    except MachineError:
        process.close()
        raise
    return process


def until(condition, deadline: float = 10.0) -> bool:
    end = time.monotonic() + deadline
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.01)
    return False


def test_a_command_is_busy_until_it_is_carried_out():
    process = hand()
    assert until(lambda: process.read().width == pytest.approx(0.08))
    process.begin(GripperCommand("grasp", 0.05))
    assert process.read().busy and not process.read().grasped
    assert until(lambda: not process.read().busy)
    reading = process.read()
    assert reading.grasped and reading.width == pytest.approx(0.05) and reading.fault is None
    process.close()


def test_a_gripper_that_is_not_there_is_said_at_the_start():
    with pytest.raises(MachineError, match="the gripper is not ready: no gripper answers; see that it is on"):
        hand("absent")


def test_a_fault_of_the_gripper_reaches_the_supervisor_in_words():
    process = hand()
    process.begin(GripperCommand("move", 0.013))
    assert until(lambda: process.read().fault is not None)
    assert process.read().fault == "a finger is stuck"
    process.restart()
    assert until(lambda: process.read().fault is None), "and is gone with a new process, once that has connected"
    process.close()


def test_a_process_that_ends_is_a_fault_and_one_that_freezes_is_silent():
    process = hand()
    os.kill(process.pid, signal.SIGKILL)
    assert until(lambda: process.read().fault == "the gripper's process has ended")
    process.restart()
    assert until(lambda: not process.read().connecting)
    freeze(process.pid)
    assert until(lambda: process.read().silent > 0.5) and process.read().fault is None
    wake(process.pid)
    assert until(lambda: process.read().silent < 0.1), "a stall leaves nothing behind"
    process.close()
