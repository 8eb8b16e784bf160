"""A cell shown to ROS 2 until Ctrl-C: its endpoint, its cell file, and where the messages go."""

import threading
from collections.abc import Callable
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

from control.errors import ConfigError
from perception.ros2.messages import message_types
from replan.robot.options import Ros2Options

if TYPE_CHECKING:
    from hw_interface.ros2.view import Ros2View
    from sim_check.cells.loading import CellConfig


def make_view(cell: "CellConfig") -> "Ros2View":
    """The view of a cell: its robot's base, its gripper and its cameras as its file places them."""
    from hw_interface.ros2.view import WORLD, MountedCamera, Ros2View

    cameras = tuple(
        MountedCamera(c.name, WORLD if c.mounting == "static" else "panda_hand", c.mount_T_camera) for c in cell.cameras
    )
    return Ros2View(cell.robot.gripper_model, cell.robot.world_T_base, cameras)


def show_ros2(options: Ros2Options, say: Callable[[str], None]) -> dict[str, Any]:
    """Publish, and record if asked, until SIGINT, SIGTERM or SIGHUP.

    Args:
        options: What to show, where.
        say: Progress for people, one line a call.

    Returns:
        What was done, for JSON.

    Raises:
        ConfigError: An option, the link file or the cell file is not valid, or the file cannot be written.
        MissingPackageError: The library that encodes, or the one that records, is not installed.
        MachineError: The port to listen at is in use.
        RobotGoneError: Nobody answers at the endpoint.
    """
    _check(options)
    message_types()  # what it needs is asked for before anybody is connected to
    from hw_interface.cell.client import CellClient
    from hw_interface.cell.pacing import Leash
    from hw_interface.link.security import link_or_none
    from hw_interface.link.transport import open_client_session, open_listening_session
    from hw_interface.ros2.encoding import JOINT_STATE
    from hw_interface.ros2.keys import BridgeNaming, RmwNaming
    from hw_interface.ros2.publishing import Ros2Publisher
    from hw_interface.ros2.relay import Relay, Sink, watch_cameras

    security = link_or_none(options.link)
    with ExitStack() as stack:
        client = stack.enter_context(CellClient.connect(options.robot, security=security))
        view = make_view(_cell(options.cell, client.info.cell))
        session = outward = open_client_session(options.robot, security=security)
        stack.callback(session.close)
        endpoint = options.robot
        if options.listen is not None:
            outward, endpoint = open_listening_session(options.listen)
            stack.callback(outward.close)
        space = options.namespace.strip("/")
        naming = RmwNaming(options.domain, space) if options.rmw_zenoh else BridgeNaming(space)
        publisher = Ros2Publisher(outward, naming)
        stack.callback(publisher.close)
        sinks: list[Sink] = [publisher]
        if options.mcap is not None:
            from hw_interface.ros2.mcap_sink import McapSink  # needs packages that a robot's computer may not have

            recording = McapSink(options.mcap)
            stack.callback(recording.close)
            sinks.append(recording)
        leash = Leash()
        stack.enter_context(leash.signals())
        relay = Relay(session, view, sinks)
        stack.callback(relay.close)
        if options.camera_rate > 0.0:
            ended = threading.Event()
            watching = threading.Thread(
                target=watch_cameras, args=(client, relay, options.camera_rate, ended, say), daemon=True
            )
            watching.start()
            stack.callback(watching.join, 5.0)
            stack.callback(ended.set)
        kind = "rmw_zenoh" if options.rmw_zenoh else "zenoh-bridge-ros2dds"
        say(f"cell {client.info.cell} at {endpoint} for {kind}: {naming.key('joint_states', JOINT_STATE)}, ...")
        if options.mcap is not None:
            say(f"recording into {options.mcap}")
        say("Ctrl-C ends it")
        relay.run(leash.ended)
    return {"mcap": str(options.mcap) if options.mcap else None, "dropped": relay.dropped}


def _check(options: Ros2Options) -> None:
    if not options.camera_rate >= 0.0:
        raise ConfigError(
            f"--camera-rate {options.camera_rate:g} is not valid; it is frames a second, 0 for no pictures"
        )
    if not 0 <= options.domain <= 232:
        raise ConfigError(f"--domain {options.domain} is not valid; ROS_DOMAIN_ID is 0 to 232")
    space = options.namespace.strip("/")
    if not all(part.isidentifier() and part.isascii() for part in space.split("/")) and space:
        raise ConfigError(
            f"--namespace '{options.namespace}' is not valid; it is names of letters, digits and underscores with "
            "slashes between them, for instance lab/panda1"
        )


def _cell(named: str | None, served: str) -> "CellConfig":
    """The cell whose file says where base and cameras are.

    Raises:
        ConfigError: The served one is not built in and no file was named, or it is another one.
    """
    from sim_check.cells.loading import builtin_cells, load_cell

    if named is None and served not in builtin_cells():
        raise ConfigError(f"the robot's process serves cell '{served}', which is not built in; say --cell FILE")
    cell = load_cell(named or served)
    if cell.name != served:
        raise ConfigError(f"the robot's process serves cell '{served}', not '{cell.name}'; say --cell {served}")
    return cell
