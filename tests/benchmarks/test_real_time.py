"""Counting lost commands in what a simulated control box remembers, and certified samples with derivatives."""

import numpy as np

from benchmarks.robot_side.libfranka_motions import along, swing
from benchmarks.robot_side.panda_side import History, gate
from benchmarks.robot_side.real_time import as_trajectory, lost_commands
from control.robot.limits import REST_Q

IDLE, MOVE = 1, 2


def history(mode: list[int], told: list[bool]) -> History:
    nothing = np.zeros((len(mode), 7))
    return History(np.arange(100, 100 + len(mode)), np.array(mode), nothing, nothing, np.array(told))


def test_commands_are_lost_between_the_first_and_the_last_that_came():
    told = [False, False, True, True, False, True, False, False, True, False]
    assert lost_commands(history([MOVE] * 10, told), 100) == (7, 3, 2)


def test_rest_and_what_was_before_do_not_count():
    told = [True, False, True, True, True, False, False]
    assert lost_commands(history([MOVE] * 5 + [IDLE] * 2, told), 102) == (3, 0, 0)


def test_a_motion_that_no_command_came_for_counts_nothing():
    assert lost_commands(history([MOVE] * 3, [False] * 3), 100) == (0, 0, 0)


def test_the_gate_takes_samples_with_their_derivatives_by_differences():
    gate().check_limits(as_trajectory(swing(np.array(REST_Q), along(1, 0.3), 2.0)))
