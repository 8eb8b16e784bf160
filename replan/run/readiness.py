"""Whether the robot and the cameras that answer are those that a run plans for, before anything is looked at."""

from typing import TYPE_CHECKING

from control.errors import ConfigError, MachineError

if TYPE_CHECKING:
    from hw_interface.cell.client import CellClient


def check_ready(client: "CellClient", cell_name: str, profile: str, firmware: str, acknowledge: bool) -> None:
    """Refuse to plan for a robot that stands elsewhere, is another one or was not released by a person.

    Args:
        client: Connection to the robot's side.
        cell_name, profile, firmware: What the run plans for.
        acknowledge: Whether a person looked at the cell and says that the robot may move again after a stop.

    Raises:
        ConfigError: It is another robot or cell, or nobody has acknowledged a stop.
    """
    state = client.state()
    if state.cell != cell_name:
        raise ConfigError(
            f"the robot's process serves cell '{state.cell}', but this run plans for '{cell_name}'; "
            f"say --cell {state.cell}"
        )
    if state.profile != profile:
        raise ConfigError(
            f"the robot's profile is '{state.profile}', but the cell file makes it '{profile}'; use the same cell file "
            "(robot and gripper) on both sides"
        )
    if state.firmware != firmware:
        raise ConfigError(
            f"the robot runs firmware '{state.firmware}', but the cell file's profile is for '{firmware}'; use the "
            "profile of this robot's firmware"
        )
    if state.mode in ("stopped", "reflex"):
        if not acknowledge:
            why = state.last_error.reason if state.last_error else "stopped on request"
            raise ConfigError(f"the robot is '{state.mode}' ({why}); look at the cell, then say --acknowledge")
        client.acknowledge()


def check_simulated(client: "CellClient") -> None:
    """Refuse to acknowledge without a person in front of a real robot.

    Raises:
        ConfigError: The cell is not simulated.
    """
    if not client.info.simulated:
        raise ConfigError(
            "--go-on-after-stall is for simulated cells; in front of this robot a person looks at the cell after a "
            "stop, then acknowledges: leave the option out"
        )


def check_cameras(client: "CellClient", wanted: list[str]) -> None:
    """Refuse to begin without a camera that the cell file has: what it would have seen might be in the way.

    Raises:
        MachineError: Nobody offers it.
    """
    there = client.cameras()
    missing = [name for name in wanted if name not in there]
    if missing:
        raise MachineError(
            f"nobody offers camera '{missing[0]}' of the cell file; there are {', '.join(there) or 'none'}: start "
            f"its process (replan camera realsense --name {missing[0]} --cell FILE, or zed), or take it out of the "
            "cell file"
        )
