"""The real libfranka against the simulated control box: starting one, and motions to play through it."""

import random
import shutil
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from benchmarks.robot_side.libfranka_motions import desired, play, swing
from control.robot.limits import REST_Q
from hw_interface.fci_simulator.process import ControlBoxProcess, free_address, start_control_box


def control_box(world: str = "cube", pace: str = "lockstep") -> ControlBoxProcess:
    """A box in front of a small world, at an address of its own; no test where its library cannot be made."""
    if world != "no-library" and shutil.which("cc") is None:
        pytest.skip(
            "the box of this test has a model library, which is made with a C compiler: apt install gcc libc6-dev"
        )
    address = free_address(random.Random())
    return start_control_box(
        [sys.executable, "-m", "tests.support.robot_side.control_box_process", world, address, pace]
    )


def go_home_if_far(robot: Any) -> None:
    """Back to REST_Q, if any joint is more than half a radian away from it."""
    way = np.array(REST_Q) - desired(robot)
    if np.abs(way).max() > 0.5:
        play(robot, swing(desired(robot), way, 0.6 + float(np.abs(way).max())))


def abort_of(robot: Any, samples: np.ndarray, at: Callable[[int], object] = lambda _k: None) -> str:
    """Play samples that must not reach their end; returns what the client says."""
    try:
        play(robot, samples, at)
    except RuntimeError as error:
        return str(error)
    raise AssertionError("the motion reached its end")


def later(robot: Any, seconds: float) -> Any:
    """The robot's state when some more robot time has passed."""
    state = robot.read_once()
    due = state.time.to_msec() + round(1000 * seconds)
    while state.time.to_msec() < due:
        state = robot.read_once()
    return state
