"""`replan ros2`: a running cell as ROS 2 sees it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from replan.options import DEFAULT_ENDPOINT

if TYPE_CHECKING:
    from replan.console import Console


@dataclass(frozen=True)
class Ros2:
    """Show a running cell to ROS 2, without ROS on this computer: joints, transforms, mode, pictures, motions.

    Messages go to the robot's endpoint on the keys of zenoh-bridge-ros2dds, or with --rmw-zenoh on those of ROS 2
    nodes that speak zenoh themselves. See docs/ros2.md. Nothing is listened to: ROS 2 cannot move the robot through
    this. Runs until Ctrl-C.
    """

    robot: str = DEFAULT_ENDPOINT
    """Endpoint of the robot process or router, or tls/HOST:PORT with --link."""
    link: Path | None = None
    """Link file with this machine's certificates, of role ros2, for tls/ endpoints (docs/security.md)."""
    listen: str | None = None
    """Endpoint to offer the topics at, for instance tcp/127.0.0.1:7450, which keeps ROS 2's side away from the robot's
    own messages. Default: the robot's endpoint."""
    cell: str | None = None
    """Cell file (YAML) that says where base and cameras stand. Default: the built-in cell that is served."""
    namespace: str = ""
    """In front of every topic, for instance panda1."""
    rmw_zenoh: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """For ROS 2 nodes with RMW_IMPLEMENTATION=rmw_zenoh_cpp (Jazzy and later), without a bridge."""
    domain: int = 0
    """ROS_DOMAIN_ID, for --rmw-zenoh."""
    camera_rate: float = 1.0
    """Frames a second of each camera; 0 for none. A simulated cell stands still while it draws one."""
    mcap: Path | None = None
    """Also record everything into this MCAP file."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Publish until Ctrl-C."""
        from replan.robot.ros2_view import Ros2Options, show_ros2

        done = show_ros2(
            Ros2Options(
                robot=self.robot,
                link=self.link,
                listen=self.listen,
                cell=self.cell,
                namespace=self.namespace,
                rmw_zenoh=self.rmw_zenoh,
                domain=self.domain,
                camera_rate=self.camera_rate,
                mcap=self.mcap,
            ),
            console.note,
        )
        dropped = f"; {done['dropped']} states were dropped" if done["dropped"] else ""
        console.result(done, (f"recorded {self.mcap}" if self.mcap else "ended") + dropped)
        return 0
