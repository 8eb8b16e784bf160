"""A robot without physics, motions and certificates for it: what needs a driver, but neither a twin nor a real arm."""

import time
import uuid
from dataclasses import replace

import numpy as np

from control.robot.limits import REST_Q, panda_limits
from control.safety.certificate import Certificate
from control.safety.limits import SafetyLimits
from control.trajectory.samples import Trajectory, TrajectorySegment
from hw_interface.cell.client import CellClient
from hw_interface.cell.driver import Driver
from hw_interface.cell.gate import Gate
from hw_interface.simulated.fake_backend import PerfectRobot
from perception.frames import CameraIntrinsics, RgbdFrame

PROFILE = "panda/5"
FIRMWARE = panda_limits().firmware
LIMITS_HASH = "limits-of-the-perfect-robot"


def gate() -> Gate:
    """The gate of such a robot: joints against the Panda's limits and the usual safety limits."""
    return Gate(PROFILE, LIMITS_HASH, panda_limits(), SafetyLimits())


def swing(
    seconds: float = 1.0, radians: float = 0.2, start: tuple[float, ...] | np.ndarray = REST_Q, held: str | None = None
) -> Trajectory:
    """A quintic move of the first joint, at rest at both ends."""
    n = round(seconds * 1000) + 1
    t = np.linspace(0.0, 1.0, n)[:, None]
    way = np.array([radians, 0, 0, 0, 0, 0, 0])
    return Trajectory(
        np.asarray(start) + (10 * t**3 - 15 * t**4 + 6 * t**5) * way,
        (30 * t**2 - 60 * t**3 + 30 * t**4) * way / seconds,
        (60 * t - 180 * t**2 + 120 * t**3) * way / seconds**2,
        (),
        (TrajectorySegment("reach", 0, n, held),),
    )


def certificate(trajectory: Trajectory, **changes: object) -> Certificate:
    """A certificate for this trajectory, issued now for a minute."""
    now = time.time()
    valid = Certificate(
        serial=uuid.uuid4().hex,
        trajectory_hash=trajectory.content_hash(),
        profile=PROFILE,
        firmware=FIRMWARE,
        scene_stamp=now,
        limits_hash=LIMITS_HASH,
        issued=now,
        expires=now + 60.0,
    )
    return replace(valid, **changes)  # type: ignore[arg-type]


def perfect_driver(object_width: float | None = None) -> tuple[Driver, PerfectRobot]:
    """A driver in front of a robot without physics."""
    robot = PerfectRobot(object_width=object_width)
    return Driver(robot, gate(), "test"), robot


def blank_frame(camera: str) -> RgbdFrame:
    """A picture of a grey wall a metre away."""
    return RgbdFrame(
        np.full((24, 32, 3), 128, np.uint8),
        np.ones((24, 32), np.float32),
        CameraIntrinsics(32, 24, 30.0, 30.0, 15.5, 11.5),
        np.eye(4),
        time.time(),
        camera,
    )


def from_here(client: CellClient, seconds: float, radians: float) -> Trajectory:
    """A swing of the first joint from where the robot is."""
    return swing(seconds, radians, start=np.array(client.state().q_d))
