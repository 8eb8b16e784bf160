"""A simulated cell as a process: world, driver and node in one loop. It alone knows the truth of its world."""

import time
from typing import Any, Protocol

import numpy as np

from hw_interface.cell.driver import Driver
from hw_interface.cell.gate import Gate
from hw_interface.cell.motion_monitor import MonitorLimits
from hw_interface.cell.node import STATE_RATE
from hw_interface.cell.pacing import Leash, serve_robot
from hw_interface.link.security import LinkSecurity
from hw_interface.link.transport import DEFAULT_ENDPOINT
from hw_interface.simulated.sim_backend import SimBackend
from perception.frames import CameraIntrinsics, RgbdFrame
from perception.ground_truth import CellTruth, FrameTruth


class CellWorld(Protocol):
    """What truly stands in a simulated cell.

    Attributes:
        model, data: MuJoCo model and state; the robot carries the names of `control.twin_model`.
        cameras: Cameras to render; each has a `name`.
    """

    model: Any
    data: Any
    cameras: Any

    def render(self, camera_name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, CameraIntrinsics]:
        """Colour (h, w, 3) uint8, depth (h, w) in [m] with NaN, world_T_camera (4, 4) optical, intrinsics."""
        ...

    def truth(self) -> CellTruth:
        """What truly stands there now."""
        ...

    def frame_truth(self, camera_name: str) -> FrameTruth:
        """What truly is in a camera's picture now."""
        ...


def run_sim_cell(
    world: CellWorld,
    *,
    cell_name: str,
    gate: Gate,
    endpoint: str = DEFAULT_ENDPOINT,
    security: LinkSecurity | None = None,
    connect: bool = False,
    state_rate: float = STATE_RATE,
    speed: float = 1.0,
    monitor_limits: MonitorLimits | None = None,
    score: bool = False,
    parent_pid: int | None = None,
    leash: Leash | None = None,
) -> None:
    """Serve a simulated cell until SIGTERM, SIGINT, SIGHUP or the parent's death. Prints one ready line on stdout.

    Args:
        world: The world; this function steps it, nobody else may.
        cell_name: As in `RobotState`.
        gate: What the driver checks every trajectory against; its gripper is what the robot in the world carries.
        endpoint: Where to listen; port 0 picks a free one (see the ready line). With `connect`, of the router to join.
        security, connect: As in `hw_interface.link.transport.open_robot_session`.
        state_rate: States a second to publish, 1 to 1000.
        speed: Robot time per wall time while moving, 0 = as fast as possible.
        monitor_limits: Where the driver stops by itself.
        score: Offer to a scorer what truly stands there and is seen.
        parent_pid: End when this process has ended.
        leash: To end the loop from elsewhere; None makes one.

    Raises:
        ConfigError: Endpoint, port, speed or world are not valid.
    """
    backend = SimBackend(world.model, world.data, gate.gripper)
    driver = Driver(backend, gate, cell_name, monitor_limits)

    def take_frame(camera: str) -> RgbdFrame:
        colour, depth, world_T_camera, intrinsics = world.render(camera)
        return RgbdFrame(colour, depth, intrinsics, world_T_camera, time.time(), camera)

    cameras = tuple(camera.name for camera in world.cameras)
    serve_robot(
        driver,
        cameras,
        take_frame,
        endpoint=endpoint,
        security=security,
        connect=connect,
        state_rate=state_rate,
        speed=speed,
        truth=world.truth if score else None,
        frame_truth=world.frame_truth if score else None,
        leash=leash or Leash(parent_pid),
        simulated=True,
    )
