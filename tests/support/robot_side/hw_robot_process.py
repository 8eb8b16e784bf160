"""A robot process for tests: `python -m ...hw_robot_process KIND ENDPOINT SPEED --parent-pid PID`; see `runs`."""

import sys
from functools import partial

import numpy as np

from hw_interface.cell.driver import Driver
from hw_interface.cell.pacing import Leash, serve_robot
from hw_interface.simulated.fake_backend import PerfectRobot
from perception.ground_truth import CellTruth, StandingThing
from tests.support.robot_side.hw_support import blank_frame, gate


class ForgetfulRobot(PerfectRobot):
    """One that may run for long: it keeps no commands."""

    def command(self, q_d: np.ndarray, qd_d: np.ndarray) -> None:
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


def run_simulated(endpoint: str, speed: float, parent: int, score: bool = True) -> None:
    """A Panda over a table with one cube below its hand, as physics has it."""
    from hw_interface.simulated.cell import run_sim_cell
    from tests.support.robot_side.hw_sim_world import CubeWorld

    run_sim_cell(
        CubeWorld(),
        cell_name="test",
        gate=gate(),
        endpoint=endpoint,
        speed=speed,
        score=score,
        parent_pid=parent,
    )


if __name__ == "__main__":
    kind, endpoint, speed, _, parent = sys.argv[1:]
    runs = {
        "perfect": run_perfect,
        "cautious": run_cautious,
        "simulated": run_simulated,
        "unscored": partial(run_simulated, score=False),
    }
    runs[kind](endpoint, float(speed), int(parent))
