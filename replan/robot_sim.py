"""The process of a simulated cell: it alone knows the truth, and speaks only messages."""

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from replan.commands.robot import RobotSim


def serve_simulated_cell(options: "RobotSim", say: Callable[[str], None]) -> int:
    """Build the world of a cell and serve it until told to stop; returns the exit code.

    Raises:
        ConfigError: Unknown cell, port in use, no rendering, a link file or endpoint that is not valid.
        RobotGoneError: There is no router to join.
    """
    from replan.rendering import require_mujoco

    require_mujoco()
    from control.certify import limits_hash
    from control.robot import RobotModel
    from hw_interface.link_security import link_or_none
    from hw_interface.sim_cell import run_sim_cell
    from sim_check.cells import load_cell
    from sim_check.world import build_world

    security = link_or_none(options.link)
    cell = load_cell(options.cell, dict.fromkeys(options.option, True))
    world = build_world(cell, options.seed)
    gripper, safety = cell.robot.gripper_model, cell.safety_limits()
    limits, robot = cell.robot.limits(), RobotModel.panda(gripper=gripper)
    say(f"world ready: {', '.join(world.object_names)}; Ctrl-C ends it")
    run_sim_cell(
        world,
        cell_name=cell.name,
        profile=limits.profile,
        limits_hash=limits_hash(limits, safety, gripper),
        robot_limits=limits,
        safety=safety,
        endpoint=options.connect or options.endpoint,
        security=security,
        connect=options.connect is not None,
        speed=options.speed,
        torque=robot.torque,
        tcp=robot.tcp_poses,
        score=options.score,
        parent_pid=options.parent_pid,
        gripper=gripper,
    )
    return 0
