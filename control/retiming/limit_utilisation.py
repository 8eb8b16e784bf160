"""Utilisation of each limit by the samples of a segment, by finite differences every millisecond.

Retiming checks its own result with this; the checker of `control.safety.trajectory_checks` shares no code with it.
"""

import numpy as np

from control.retiming.bounds import MotionBounds
from control.robot.dynamics import RobotModel
from control.trajectory.samples import SAMPLE_TIME

PADDING = 3  # samples of rest on either side: a third difference reaches that far
# How a quantity falls when time is stretched by k: with 1 / k^order, gravity aside.
ORDER = {
    "joint_velocity": 1,
    "hand_speed": 1,
    "hand_angular_speed": 1,
    "joint_acceleration": 2,
    "torque": 2,
    "hand_acceleration": 2,
    "hand_angular_acceleration": 2,
    "joint_jerk": 3,
    "torque_rate": 3,
    "hand_jerk": 3,
    "hand_angular_jerk": 3,
}


def limit_utilisation(
    q: np.ndarray, robot: RobotModel, bounds: MotionBounds, look: tuple[np.ndarray, np.ndarray] | None = None
) -> dict[str, np.ndarray]:
    """Utilisation of the limits by name.

    Args:
        q: Samples every millisecond in [rad], shape (n, 7), at rest before the first and after the last one.
        robot: Rigid-body model.
        bounds: What the samples are held to.
        look: Rows of the result in which torques, and in which the hand, are checked: masks of shape
            (n + 2 PADDING,). The rigid-body model is evaluated for no more than these take; None for all rows.

    Returns:
        By the names of `ORDER`, arrays of shape (n + 2 PADDING, 7) for joints and (n + 2 PADDING, 1) for the hand: row
        k is of the difference that ends at sample k - PADDING. 1 is the limit. Rows that are not checked hold 0
        or a value from neighbouring rows.
    """
    rest = np.concatenate([np.repeat(q[:1], PADDING, 0), q, np.repeat(q[-1:], PADDING, 0)])
    qd, qdd, qddd = _differences(rest)
    for_torque, for_hand = (slice(None), slice(None)) if look is None else (_reached(mask) for mask in look)
    tau = np.full_like(rest, np.nan)
    tau[for_torque] = robot.torque(rest[for_torque], qd[for_torque], qdd[for_torque])
    before = np.concatenate([rest[:1], rest[:-1]])
    speed = np.minimum(bounds.joint_speed(rest, qd), bounds.joint_speed(before, qd))
    utilisation = {
        "joint_velocity": np.abs(qd) / np.maximum(speed, 1e-9),
        "joint_acceleration": np.abs(qdd) / bounds.qdd,
        "joint_jerk": np.abs(qddd) / bounds.qddd,
        "torque": np.abs(tau) / bounds.tau,
        "torque_rate": np.abs(_differences(tau)[0]) / bounds.taud,
    }
    poses = np.full((len(rest), 4, 4), np.nan)
    poses[for_hand] = robot.tcp_poses(rest[for_hand])
    velocity, acceleration, jerk = _differences(poses[:, :3, 3])
    turn = _turning(poses[:, :3, :3]) / SAMPLE_TIME
    turns = (turn, *_differences(turn)[:2])
    for name, values, limit in zip(
        ("speed", "acceleration", "jerk"), (velocity, acceleration, jerk), bounds.hand, strict=True
    ):
        utilisation[f"hand_{name}"] = np.linalg.norm(values, axis=1, keepdims=True) / limit
    for name, values, limit in zip(("speed", "acceleration", "jerk"), turns, bounds.turn, strict=True):
        utilisation[f"hand_angular_{name}"] = np.linalg.norm(values, axis=1, keepdims=True) / limit
    return (
        utilisation if look is None else {name: np.nan_to_num(used, copy=False) for name, used in utilisation.items()}
    )


def _reached(rows: np.ndarray) -> np.ndarray:
    """Mask of the samples that backward differences up to the third reach from the rows of a mask."""
    out = rows.copy()
    for back in range(1, PADDING + 1):
        out[:-back] |= rows[back:]
    return out


def _differences(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First three backward differences per time, of the same shape, zero where they reach before the first row."""
    first = np.diff(values, axis=0, prepend=values[:1]) / SAMPLE_TIME
    second = np.diff(first, axis=0, prepend=first[:1]) / SAMPLE_TIME
    return first, second, np.diff(second, axis=0, prepend=second[:1]) / SAMPLE_TIME


def _turning(rotations: np.ndarray) -> np.ndarray:
    """Rotation vectors in [rad] from each rotation to the next, shape (n, 3), the first one zero.

    The skew part of R1 R0^T is sin(angle) times the axis; angle = x + x^3 / 6 + ... of x = sin(angle), where a
    millisecond's angle is a few mrad.
    """
    step = rotations[1:] @ rotations[:-1].transpose(0, 2, 1)
    skew = np.stack([step[:, 2, 1] - step[:, 1, 2], step[:, 0, 2] - step[:, 2, 0], step[:, 1, 0] - step[:, 0, 1]], 1)
    sine = skew / 2.0
    square = np.sum(sine**2, axis=1, keepdims=True)
    return np.concatenate([np.zeros((1, 3)), sine * (1.0 + square / 6.0 + 3.0 / 40.0 * square**2)])
