"""`replan ros2`: a running cell as ROS 2 sees it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from replan.commands.flags import SetOnly, options_in
from replan.robot.options import Ros2Options

if TYPE_CHECKING:
    from replan.console import Console


@dataclass(frozen=True, kw_only=True)
class Ros2(Ros2Options):
    """Show a running cell to ROS 2, without ROS on this computer: joints, transforms, mode, pictures, motions.

    Messages go to the robot's endpoint on the keys of zenoh-bridge-ros2dds, or with --rmw-zenoh on those of ROS 2
    nodes that speak zenoh themselves. See docs/ros2.md. Nothing is listened to: ROS 2 cannot move the robot through
    this. Runs until Ctrl-C.
    """

    link: Path | None = Ros2Options.link
    """Link file with this machine's certificates, of role ros2, for tls/ endpoints (docs/security.md)."""
    rmw_zenoh: SetOnly = Ros2Options.rmw_zenoh
    json: SetOnly = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Publish until Ctrl-C."""
        from replan.robot.ros2_view import show_ros2

        done = show_ros2(options_in(self, Ros2Options), console.note)
        dropped = f"; {done['dropped']} states were dropped" if done["dropped"] else ""
        console.result(done, (f"recorded {self.mcap}" if self.mcap else "ended") + dropped)
        return 0
