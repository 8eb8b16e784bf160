"""Processes that stand still for a while: a simulated cell waits, a real robot rests on its path, no link is torn."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
import pytest

from benchmarks.robot_side.perfect_robot import swing
from hw_interface.cell.client import CellClient
from tests.support.load.freezing import freeze, wake
from tests.support.robot_side.hw_support import idle_client, robot_process
from tests.support.waiting import until

STALL, BETWEEN = 1.2, 0.3  # [s]; longer than FROZEN_AFTER, than an operator may be silent, and than links once lived


@contextmanager
def operator(endpoint: str, seconds: float, looks: int) -> Iterator["subprocess.Popen[str]"]:
    """An operator's program, ended afterwards."""
    command = [sys.executable, "-m", "tests.support.robot_side.hw_operator_process"]
    command += [endpoint, str(seconds), str(looks)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()
            wake(process.pid)


def stall(pids: Sequence[int], seconds: float) -> None:
    """Stop processes at the same time for a while."""
    for pid in pids:
        freeze(pid)
    time.sleep(seconds)
    for pid in pids:
        wake(pid)


@pytest.mark.parametrize("who", ["client", "cell", "both"])
def test_a_simulated_cell_reaches_the_end_of_a_motion_through_stalls(who: str):
    with robot_process("simulated", speed=1.0) as cell, operator(cell.endpoint, 2.0, looks=3) as client:
        pids = {"client": [client.pid], "cell": [cell.pid], "both": [client.pid, cell.pid]}[who]
        assert client.stdout is not None
        # Before anything moves, for the time in which a client connects and looks ...
        for _ in range(2):
            time.sleep(BETWEEN)
            stall(pids, STALL)
        assert client.stdout.readline() == "moving\n"
        # ... and while something does.
        for _ in range(2):
            stall(pids, STALL)
            time.sleep(BETWEEN)
        told = json.loads(client.stdout.readline())
        assert told == {"reason": "completed", "played": 2001, "pictures": 6}


@pytest.mark.parametrize(("number", "most"), [(signal.SIGSTOP, 1800), (signal.SIGKILL, 500)])
def test_a_real_robot_whose_operator_freezes_or_is_killed_rests_soon_on_its_path(number: int, most: int):
    with robot_process("perfect", speed=1.0) as robot, CellClient.connect(robot.endpoint) as witness:
        begin = np.array(witness.state().q_d)
        with operator(robot.endpoint, 5.0, looks=0) as client:
            assert client.stdout is not None and client.stdout.readline() == "moving\n"
            if number == signal.SIGSTOP:
                freeze(client.pid)
            else:
                os.kill(client.pid, number)
            struck = witness.state().progress
            assert until(lambda: witness.state().mode == "reflex", 10.0)
            # In samples, which are milliseconds of the robot's own time: a second without a beat, or a closed
            # socket; then the way to rest; the rest is room for a busy machine.
            assert witness.state().progress - struck < most
            error = witness.state().last_error
            assert error is not None and error.code == "operator_gone"
            assert ("was not heard for" if number == signal.SIGSTOP else "has ended") in error.reason
            rest = np.array(witness.state().q_d)
            assert np.abs(swing(5.0, 0.2, begin).q - rest).max(axis=1).min() < 1e-3


def test_an_operator_that_comes_back_after_the_robot_came_to_rest_still_has_its_link_and_hears_why():
    with robot_process("perfect", speed=1.0) as robot, operator(robot.endpoint, 5.0, looks=0) as client:
        assert client.stdout is not None and client.stdout.readline() == "moving\n"
        stall([client.pid], STALL)
        told = json.loads(client.stdout.readline())
        assert told["reason"] == "operator_gone" and told["played"] < 5001


def test_a_robot_at_rest_is_not_touched_by_stalls_of_anybody():
    with robot_process("perfect", speed=1.0) as robot, idle_client(robot.endpoint) as client:
        epoch = client.state().epoch
        stall([robot.pid], STALL)
        state = client.state()
        assert (state.mode, state.last_error, state.epoch) == ("idle", None, epoch)
        assert len(client.frames()) == 2
