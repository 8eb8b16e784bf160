"""What the tests of hw_interface share: short motions, certificates, and robots in processes of their own."""

import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from benchmarks.robot_side.perfect_robot import blank_frame, perfect_driver
from control.trajectory.samples import GripperCommand, GripperEvent, Trajectory, TrajectorySegment
from hw_interface.cell.client import CellClient
from hw_interface.cell.node import RobotNode
from hw_interface.cell.pacing import Leash, run_loop
from hw_interface.cell.process import SimProcess, start_sim_process
from hw_interface.link.security import LinkSecurity
from tests.support.waiting import until


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
