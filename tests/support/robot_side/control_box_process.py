"""A simulated control box for tests: `python -m ...control_box_process WORLD ADDRESS PACE ... --parent-pid PID`."""

import argparse
import sys

from control.robot.limits import panda_limits
from hw_interface.cell.pacing import Leash
from hw_interface.fci_simulator.model_library import build_library
from hw_interface.fci_simulator.server import ResearchInterface
from tests.support.robot_side.hw_sim_world import CubeWorld

if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("world", choices=("cube", "wall", "no-library"))
    parser.add_argument("address")
    parser.add_argument("pace", choices=("lockstep", "real-time"))
    parser.add_argument("--control-port", type=int)
    parser.add_argument("--parent-pid", type=int)
    given = parser.parse_args()
    server = ResearchInterface(
        CubeWorld(wall=given.world == "wall"),
        panda_limits(),
        address=given.address,
        pace=given.pace,
        control_port=given.control_port,
        say=lambda line: print(line, file=sys.stderr, flush=True),
        leash=Leash(given.parent_pid),
    )
    if given.world != "no-library":
        server.library = build_library(server.arm_model)
    server.serve()
