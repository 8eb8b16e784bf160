"""Motions through the unmodified libfranka, in front of the simulated control box or a real one."""

from collections.abc import Callable
from typing import Any

import numpy as np

from control.trajectory.samples import SAMPLE_TIME
from hw_interface.panda.scheduling import in_own_scheduling

THRESHOLD = 40.0  # [Nm], [N]; no motion in free space comes near


def robot_at(address: str) -> Any:
    """The real client, connected and ready to move."""
    from panda_py import libfranka

    robot = libfranka.Robot(address, libfranka.RealtimeConfig.kIgnore)
    robot.set_collision_behavior(*[[THRESHOLD] * n for n in (7, 7, 6, 6)])
    robot.automatic_error_recovery()
    return robot


def swing(q0: np.ndarray, delta: np.ndarray, seconds: float) -> np.ndarray:
    """Samples in [rad], one a millisecond, of a smooth motion at rest at both ends, shape (n, 7).

    Its speed peaks at 2.19 delta / T, its acceleration at 7.5 delta / T^2, its jerk at 52.5 delta / T^3.
    """
    x = np.linspace(0.0, 1.0, round(seconds / SAMPLE_TIME) + 1)[:, None]
    return q0 + (35 * x**4 - 84 * x**5 + 70 * x**6 - 20 * x**7) * delta


def along(joint: int, angle: float) -> np.ndarray:
    """A change in [rad] of one joint, 1..7, shape (7,)."""
    delta = np.zeros(7)
    delta[joint - 1] = angle
    return delta


def play(robot: Any, samples: np.ndarray, at: Callable[[int], object] = lambda _k: None) -> None:
    """Play samples as a driver does: the one that belongs to the elapsed time.

    Args:
        robot: The client.
        samples: In [rad], shape (n, 7).
        at: Called with the index of every sample before it is sent.
    """
    from panda_py import libfranka

    elapsed = 0

    def sample(_state: Any, duration: Any) -> Any:
        nonlocal elapsed
        elapsed += duration.to_msec()
        k = min(elapsed, len(samples) - 1)
        at(k)
        target = libfranka.JointPositions(samples[k].tolist())
        target.motion_finished = k == len(samples) - 1
        return target

    control(robot, sample)


def control(robot: Any, callback: Callable[[Any, Any], Any]) -> None:
    """Play what a callback answers each state with; this process keeps its priority."""
    from panda_py import libfranka

    mode = libfranka.ControllerMode.kJointImpedance
    in_own_scheduling(lambda answer: robot.control_joint_position(answer, mode, False, 1000.0), callback)


def desired(robot: Any) -> np.ndarray:
    """Where the box wants the joints, which is where a motion has to start, in [rad], shape (7,)."""
    return np.array(robot.read_once().q_d)
