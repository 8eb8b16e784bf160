"""A camera process: a device or a recording under a name of the cell file, offered until Ctrl-C or until it fails."""

from collections.abc import Callable
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

from control.errors import ConfigError, MachineError, RobotGoneError
from replan.robot.options import CameraOptions

if TYPE_CHECKING:
    import zenoh

    from hw_interface.cameras.mounting import CameraMounting
    from hw_interface.cameras.source import CameraSource
    from sim_check.cells.loading import CameraConfig, CellConfig

INFO_TIMEOUT = 2.0  # [s]


def serve_device(
    options: CameraOptions, open_source: Callable[["CameraConfig"], "CameraSource"], say: Callable[[str], None]
) -> dict[str, Any]:
    """Offer a device that the cell file places.

    Args:
        options: Where, and as which camera.
        open_source: Opens the device; gets what the cell file says of the camera.
        say: Progress for people, one line a call.

    Returns:
        What was done, for JSON.

    Raises:
        ConfigError: The cell file has no such camera, or another process offers it.
        MachineError: The device does not open, or failed later.
        RobotGoneError: Nobody answers at the endpoint.
    """
    from sim_check.cells.loading import load_cell

    cell = load_cell(options.cell)
    names = [c.name for c in cell.cameras]
    if options.name is None and len(names) > 1:
        raise ConfigError(f"cell '{cell.name}' has cameras {', '.join(names)}; say which one this is with --name")
    camera = cell.camera(options.name or names[0])
    return _serve(options, camera.name, lambda: open_source(camera), cell, say, False)


def serve_recording(
    options: CameraOptions, source: "CameraSource", name: str, on_request: bool, say: Callable[[str], None]
) -> dict[str, Any]:
    """Offer a recording in the place of a camera; where it stood is in the recording.

    Args:
        options: Where.
        source: The recording's camera.
        name: Under which name.
        on_request: Whether each picture is read when it is asked for.
        say: Progress for people, one line a call.

    Raises:
        ConfigError: Another process offers this camera.
        RobotGoneError: Nobody answers at the endpoint.
    """
    return _serve(options, name, lambda: source, None, say, on_request)


def _serve(
    options: CameraOptions,
    name: str,
    open_source: Callable[[], "CameraSource"],
    cell: "CellConfig | None",
    say: Callable[[str], None],
    on_request: bool,
) -> dict[str, Any]:
    if not options.max_age > 0.0:
        raise ConfigError(f"--max-age {options.max_age:g} is not valid; it is in seconds, for instance 0.5")
    from hw_interface.cameras.service import CameraService
    from hw_interface.cameras.source import SourceEndedError
    from hw_interface.cell.pacing import Leash
    from hw_interface.link.security import link_or_none
    from hw_interface.link.transport import open_client_session

    with ExitStack() as stack:
        leash = Leash(options.parent_pid)
        stack.enter_context(leash.signals())
        session = open_client_session(options.robot, security=link_or_none(options.link))
        stack.callback(session.close)
        mounting = None
        if cell is not None:
            _check_cell(session, cell)
            mounting = _mounting(session, cell, cell.camera(name))
        source = open_source()
        service = CameraService(session, name, source, mounting, options.max_age, on_request)
        stack.callback(service.close)
        say(f"camera '{name}': {source.description}, offered at {options.robot}; Ctrl-C ends it")
        service.run(leash.ended)
        health, failure = service.health(), service.failure
    if failure is not None and not isinstance(failure, SourceEndedError):
        raise MachineError(f"camera '{name}' failed: {failure}; see to it, then start this again")
    return {"camera": name, "frames": health.frames, "dropped": health.dropped, "ended": str(failure or "")}


def _check_cell(session: "zenoh.Session", cell: "CellConfig") -> None:
    """Refuse to place a camera by the file of another cell; behind a router the robot may not be there yet.

    Raises:
        ConfigError: The robot process serves another cell.
    """
    from hw_interface.link.requests import ask
    from hw_interface.link.transport import INFO_KEY
    from hw_interface.messages.robot import CellInfo, InfoRequest

    try:
        served = ask(session, INFO_KEY, InfoRequest(), CellInfo, INFO_TIMEOUT).cell
    except RobotGoneError:
        return
    if served != cell.name:
        raise ConfigError(
            f"the robot's process serves cell '{served}', but this camera's place is taken from '{cell.name}'; say "
            f"--cell {served}"
        )


def _mounting(session: "zenoh.Session", cell: "CellConfig", camera: "CameraConfig") -> "CameraMounting":
    from hw_interface.cameras.mounting import FixedMounting, WristMounting

    if camera.mounting == "static":
        return FixedMounting(camera.mount_T_camera)
    return WristMounting(session, cell.robot.gripper_model, cell.robot.world_T_base, camera.mount_T_camera)
