"""What the tests of hw_interface share: short motions, certificates, and robots in processes of their own."""

import sys
import threading
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from control.robot.limits import REST_Q, panda_limits
from control.safety.certificate import Certificate
from control.safety.limits import SafetyLimits
from control.trajectory.samples import GripperCommand, GripperEvent, Trajectory, TrajectorySegment
from hw_interface.cell.client import CellClient
from hw_interface.cell.driver import Driver
from hw_interface.cell.gate import Gate
from hw_interface.cell.node import RobotNode
from hw_interface.cell.pacing import Leash, run_loop
from hw_interface.cell.process import SimProcess, start_sim_process
from hw_interface.link.security import LinkSecurity
from hw_interface.simulated.fake_backend import PerfectRobot
from perception.frames import CameraIntrinsics, RgbdFrame
from tests.support.waiting import until

PROFILE = "panda/5"
FIRMWARE = panda_limits().firmware
LIMITS_HASH = "limits-of-the-test"


def gate() -> Gate:
    """The gate of every robot in these tests."""
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


def joined(
    q: np.ndarray, commands: list[GripperCommand | None], dwell: float = 0.6, seconds: float = 1.0, held: tuple = ()
) -> Trajectory:
    """Rest-to-rest quintic moves through the rows of q, shape (k + 1, 7), a gripper command after each move.

    Args:
        held: Name of what is in the hand during each move, or None.
    """
    rows: list[np.ndarray] = []
    derivatives: list[np.ndarray] = []
    seconds_derivatives: list[np.ndarray] = []
    events, segments, begin = [], [], 0
    t = np.linspace(0.0, 1.0, round(seconds * 1000) + 1)[1:, None]
    for i, command in enumerate(commands):
        way = q[i + 1] - q[i]
        pause = round(dwell * 1000) if command else 0
        still = np.zeros((pause, 7))
        rows += [q[i] + (10 * t**3 - 15 * t**4 + 6 * t**5) * way, np.tile(q[i + 1], (pause, 1))]
        derivatives += [(30 * t**2 - 60 * t**3 + 30 * t**4) * way / seconds, still]
        seconds_derivatives += [(60 * t - 180 * t**2 + 120 * t**3) * way / seconds**2, still]
        stop = begin + len(t) + pause
        if command:
            events.append(GripperEvent((stop - pause) / 1000, dwell, command))
        segments.append(TrajectorySegment(f"part{i}", begin, stop, held[i] if held else None))
        begin = stop
    zero = np.zeros((1, 7))
    segments[-1] = replace(segments[-1], stop=begin + 1)
    return Trajectory(
        np.concatenate([q[:1], *rows]),
        np.concatenate([zero, *derivatives]),
        np.concatenate([zero, *seconds_derivatives]),
        tuple(events),
        tuple(segments),
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


@contextmanager
def robot_process(kind: str = "perfect", speed: float = 1.0, endpoint: str = "tcp/127.0.0.1:0") -> Iterator[SimProcess]:
    """A robot process of `tests.support.robot_side.hw_robot_process`, ended afterwards."""
    command = [sys.executable, "-m", "tests.support.robot_side.hw_robot_process", kind, endpoint, str(speed)]
    with start_sim_process(command, deadline=60.0) as process:
        yield process


@contextmanager
def robot_thread(
    endpoint: str = "tcp/127.0.0.1:0", security: LinkSecurity | None = None, connect: bool = False
) -> Iterator[str]:
    """A robot without physics on a thread of this process; gives the endpoint at which clients find it."""
    driver, _ = perfect_driver()
    node = RobotNode(driver, ("front", "side"), blank_frame, endpoint, security=security, connect=connect)
    leash = Leash()
    loop = threading.Thread(target=run_loop, args=(driver, node, leash, 1.0))
    loop.start()
    try:
        yield node.endpoint
    finally:
        leash.end()
        loop.join()
        node.close()


@contextmanager
def idle_client(endpoint: str, security: LinkSecurity | None = None) -> Iterator[CellClient]:
    """A client whose robot is left at rest, acknowledged and at full speed, whatever was done with it."""
    with CellClient.connect(endpoint, security=security) as client:
        yield client
        client.stop()
        assert until(lambda: client.state().mode not in ("moving", "stopping"))
        client.acknowledge()
        client.set_speed(1.0)


def from_here(client: CellClient, seconds: float, radians: float) -> Trajectory:
    """A swing of the first joint from where the robot is."""
    return swing(seconds, radians, start=np.array(client.state().q_d))
