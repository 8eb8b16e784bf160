"""The gate of a cell's robot, built from the cell file alone: the same on every side that checks."""

from typing import TYPE_CHECKING

from hw_interface.cell.gate import Gate

if TYPE_CHECKING:
    from sim_check.cells.loading import CellConfig


def cell_gate(cell_name: str, options: tuple[str, ...] = ()) -> "tuple[Gate, CellConfig]":
    """Gate and cell of a built-in cell or a cell file.

    Args:
        cell_name: As for --cell.
        options: Switches of the cell that are on.

    Raises:
        ConfigError: There is no such cell, or it is not valid.
    """
    from control.robot.dynamics import RobotModel
    from control.safety.certification import limits_hash
    from sim_check.cells.loading import load_cell

    cell = load_cell(cell_name, dict.fromkeys(options, True))
    gripper, safety = cell.robot.gripper_model, cell.safety_limits()
    limits, robot = cell.robot.limits(), RobotModel.panda(gripper=gripper)
    gate = Gate(
        limits.profile,
        limits_hash(limits, safety, gripper),
        limits,
        safety,
        torque=robot.torques,
        tcp=robot.tcp_poses,
        gripper=gripper,
    )
    return gate, cell
