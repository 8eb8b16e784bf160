"""A robot without physics in a process of its own: `-m ...perfect_process KIND ENDPOINT SPEED --parent-pid PID`."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from benchmarks.robot_side.perfect_robot import blank_frame, gate
from hw_interface.cell.driver import Driver
from hw_interface.cell.pacing import Leash, serve_robot
from hw_interface.cell.process import SimProcess, start_sim_process
from hw_interface.simulated.fake_backend import PerfectRobot
from perception.ground_truth import CellTruth, StandingThing
from replan_base.processes import python_module


class ForgetfulRobot(PerfectRobot):
    """One that may run for long: it keeps no commands."""

    def command(self, q_d: np.ndarray, qd_d: np.ndarray) -> None:
        """Follow, and forget what came before."""
        super().command(q_d, qd_d)
        self.commands.clear()


def run_perfect(endpoint: str, speed: float, parent: int, driver: Driver | None = None) -> None:
    """A robot without physics; its truth is one motionless thing."""
    driver = driver or Driver(ForgetfulRobot(), gate(), "test")
    truth = CellTruth({"red_cube": StandingThing("red_cube", np.eye(4), np.full(3, 0.04), np.zeros(6), False)}, {})
    serve_robot(
        driver,
        ("front", "side"),
        blank_frame,
        endpoint=endpoint,
        speed=speed,
        leash=Leash(parent),
        truth=lambda: truth,
    )


def run_cautious(endpoint: str, speed: float, parent: int) -> None:
    """A robot without physics that also holds torques and the hand's speeds against limits, as the cells' robots do."""
    from replan.robot.gate import cell_gate

    run_perfect(endpoint, speed, parent, Driver(ForgetfulRobot(), cell_gate("cubes")[0], "test"))


KINDS = {"perfect": run_perfect, "cautious": run_cautious}


@contextmanager
def perfect_process(kind: str, speed: float) -> Iterator[SimProcess]:
    """Such a process, ended afterwards.

    Args:
        kind: Key of `KINDS`.
        speed: Pace of its clock in times real time; 0 is as fast as it goes.
    """
    command = python_module("benchmarks.robot_side.perfect_process", kind, "tcp/127.0.0.1:0", str(speed))
    with start_sim_process(command, deadline=60.0) as process:
        yield process


if __name__ == "__main__":
    kind, endpoint, speed, _, parent = sys.argv[1:]
    KINDS[kind](endpoint, float(speed), int(parent))
