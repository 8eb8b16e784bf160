"""The process of a simulated control box: a cell's world behind the protocol of the Panda."""

import time
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from perception.frames import RgbdFrame
    from replan.robot.options import ResearchInterfaceOptions
    from sim_check.world.world import World


def serve_research_interface(options: "ResearchInterfaceOptions", say: Callable[[str], None]) -> int:
    """Build the world of a cell and serve its robot until told to stop; returns the exit code.

    Raises:
        ConfigError: Unknown cell, address or port in use, or a robot that has another control box.
    """
    from replan.rendering import require_mujoco

    require_mujoco()
    from control.errors import ConfigError, MachineError
    from control.robot.gripper import PANDA_HAND
    from hw_interface.cell.pacing import Leash
    from hw_interface.fci_simulator.cameras import LateCameras
    from hw_interface.fci_simulator.model_library import build_library
    from hw_interface.fci_simulator.server import ResearchInterface
    from hw_interface.link.security import link_or_none
    from sim_check.world.world import build_world

    cell = options.load()
    limits, gripper = cell.robot.limits(), cell.robot.gripper_model
    if not limits.profile.startswith("panda/5"):
        raise ConfigError(
            f"cell '{cell.name}' has a robot of profile {limits.profile}; the simulated control box speaks for panda/5"
        )
    world = build_world(cell, options.seed, meshes=options.endpoint is not None)
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
    if options.endpoint is None:
        server.serve()
        return 0
    truth = world.truth if options.score else None
    names, security = tuple(c.name for c in world.cameras), link_or_none(options.link)
    cameras = LateCameras(options.endpoint, names, partial(_picture, world), say, truth, security)
    server.between = cameras.serve
    try:
        server.serve()
    finally:
        cameras.close()
        world.close()
    return 0


def _picture(world: "World", camera: str) -> "RgbdFrame":
    from perception.frames import RgbdFrame

    colour, depth, world_T_camera, intrinsics = world.render(camera)
    return RgbdFrame(colour, depth, intrinsics, world_T_camera, time.time(), camera)
