"""The process of a simulated cell: it alone knows the truth, and speaks only messages."""

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from replan.robot.options import SimCellOptions


def serve_simulated_cell(options: "SimCellOptions", say: Callable[[str], None]) -> int:
    """Build the world of a cell and serve it until told to stop; returns the exit code.

    Raises:
        ConfigError: Unknown cell, port in use, no rendering, a link file or endpoint that is not valid.
        RobotGoneError: There is no router to join.
    """
    from replan.rendering import require_mujoco

    require_mujoco()
    from hw_interface.link.security import link_or_none
    from hw_interface.simulated.cell import run_sim_cell
    from replan.robot.gate import cell_gate
    from sim_check.world.world import build_world

    security = link_or_none(options.link)
    gate, cell = cell_gate(options.cell, options.cell_options)
    world = build_world(cell, options.seed)
    say(f"world ready: {', '.join(world.object_names)}; Ctrl-C ends it")
    run_sim_cell(
        world,
        cell_name=cell.name,
        gate=gate,
        endpoint=options.connect or options.endpoint,
        security=security,
        connect=options.connect is not None,
        state_rate=options.state_rate,
        speed=options.speed,
        score=options.score,
        parent_pid=options.parent_pid,
    )
    return 0
