"""The process of a simulated control box: a cell's world behind the protocol of the Panda."""

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from replan.commands.robot import RobotResearchInterface


def serve_research_interface(options: "RobotResearchInterface", say: Callable[[str], None]) -> int:
    """Build the world of a cell and serve its robot until told to stop; returns the exit code.

    Raises:
        ConfigError: Unknown cell, address or port in use, or a robot that has another control box.
    """
    from control.errors import ConfigError, MachineError
    from control.gripper import PANDA_HAND
    from hw_interface.pacing import Leash
    from hw_interface.research_interface.model_library import build_library
    from hw_interface.research_interface.server import ResearchInterface
    from sim_check.cells import load_cell
    from sim_check.world import build_world

    cell = load_cell(options.cell, dict.fromkeys(options.option, True))
    limits, gripper = cell.robot.limits(), cell.robot.gripper_model
    if not limits.profile.startswith("panda/5"):
        raise ConfigError(
            f"cell '{cell.name}' has a robot of profile {limits.profile}; the simulated control box speaks for panda/5"
        )
    world = build_world(cell, options.seed, meshes=False)
    server = ResearchInterface(
        world,
        limits,
        gripper=gripper,
        address=options.address,
        pace=options.pace,
        control_port=options.control_port,
        say=say,
        leash=Leash(options.parent_pid),
        with_hand=gripper == PANDA_HAND,
    )
    try:
        server.library = build_library(server.arm_model)
    except MachineError as error:
        say(str(error))
    say(f"control box of cell '{cell.name}' at {options.address}, pace {options.pace}; Ctrl-C ends it")
    server.announce()
    server.serve()
    return 0
