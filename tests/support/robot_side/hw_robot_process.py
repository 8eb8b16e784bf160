"""A robot process for tests: `python -m ...hw_robot_process KIND ENDPOINT SPEED --parent-pid PID`; see `runs`."""

import sys
from functools import partial

from benchmarks.robot_side.perfect_process import KINDS
from benchmarks.robot_side.perfect_robot import gate


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
    runs = {**KINDS, "simulated": run_simulated, "unscored": partial(run_simulated, score=False)}
    runs[kind](endpoint, float(speed), int(parent))
