"""Independent check of a 1 kHz trajectory by finite differences, as the Panda's control box makes them.

Needs numpy only; torques and the hand's pose come from callables. It shares no code with the retiming, so that a
mistake there cannot hide itself here. Velocities, accelerations and jerks are backward differences of the commanded
positions (not the trajectory's own derivatives), with the arm at rest before the first and after the last sample.
Source: Franka Control Interface documentation, "Robot and interface specifications" (limits hold for the
differences of the commands that arrive every millisecond).
"""

from collections.abc import Callable

import numpy as np

from control.certificate import CheckResult
from control.limits import RobotLimits
from control.safety import SafetyLimits
from control.trajectory import SAMPLE_TIME, Trajectory

PADDING = 3  # samples of rest on either side: a third difference reaches that far
# Differences of float64 positions near 3 rad carry rounding noise of about 4e-16 / dt^k: 4e-7 in the third.
ROUNDING = 1e-6
REST_SPEED = 1e-6  # [rad/s]
REST_ACCELERATION = 1e-3  # [rad/s^2]
SPEED_TOLERANCE = 2e-3  # [rad/s]; twice what a jerk of 8000 rad/s^3 does within a millisecond
ACCELERATION_TOLERANCE = 0.2  # [rad/s^2]

Torque = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
HandPoses = Callable[[np.ndarray], np.ndarray]


def check_trajectory(
    trajectory: Trajectory,
    limits: RobotLimits,
    safety: SafetyLimits,
    torque: Torque | None = None,
    tcp: HandPoses | None = None,
) -> tuple[CheckResult, ...]:
    """Hold every sample of a trajectory against the limits.

    Args:
        trajectory: What would be played.
        limits: Published limits of the robot.
        safety: Shares of them that may be used, and the hand's speeds.
        torque: (q, qd, qdd), each of shape (n, 7), to torques in [Nm] of the same shape; None leaves out the checks
            `torque` and `torque_rate`.
        tcp: q of shape (n, 7) to poses of the tool centre point, shape (n, 4, 4), in any fixed frame; None leaves out
            `hand_speed` and `hand_angular_speed`.

    Returns:
        One result per check; where a joint is to blame its name stands in `bodies`. `joint_position` gives the
        distance to the nearest published limit, which must not fall below the safety margin; all others must not
        exceed their limit.
    """
    q = trajectory.q
    n = len(q)
    padded = np.concatenate([np.repeat(q[:1], PADDING, 0), q, np.repeat(q[-1:], PADDING, 0)])
    qd = np.diff(padded, axis=0, prepend=padded[:1]) / SAMPLE_TIME
    qdd = np.diff(qd, axis=0, prepend=qd[:1]) / SAMPLE_TIME
    qddd = np.diff(qdd, axis=0, prepend=qdd[:1]) / SAMPLE_TIME
    names = trajectory.joint_names
    results = [
        _position(trajectory, limits, safety),
        _joint_check("joint_velocity", qd, limits.qd * safety.velocity_scale, "rad/s", names, n),
        _joint_check("joint_acceleration", qdd, limits.qdd * safety.acceleration_scale, "rad/s^2", names, n),
        _joint_check("joint_jerk", qddd, limits.qddd, "rad/s^3", names, n),
    ]
    if torque is not None:
        tau = torque(padded, qd, qdd)
        taud = np.diff(tau, axis=0, prepend=tau[:1]) / SAMPLE_TIME
        results.append(_joint_check("torque", tau, limits.tau, "Nm", names, n))
        results.append(_joint_check("torque_rate", taud, limits.taud, "Nm/s", names, n))
    if tcp is not None:
        linear, angular = _hand_speeds(tcp(q))
        results.append(_scalar_check("hand_speed", linear, safety.hand_speed, "m/s"))
        results.append(_scalar_check("hand_angular_speed", angular, safety.hand_angular_speed, "rad/s"))
    results.append(_rest("starts_at_rest", trajectory, 0))
    results.append(_rest("ends_at_rest", trajectory, n - 1))
    results.append(_consistency(trajectory))
    return tuple(results)


def _moment(row: int, n: int) -> float:
    """Time in [s] of a row of the padded arrays, within the trajectory."""
    return min(max(row - PADDING, 0), n - 1) * SAMPLE_TIME


def _joint_check(
    name: str, values: np.ndarray, limit: np.ndarray, unit: str, joint_names: tuple[str, ...], n: int
) -> CheckResult:
    """The joint and moment nearest to (or furthest beyond) its limit."""
    share = np.abs(values) / limit
    row, joint = np.unravel_index(int(np.argmax(share)), share.shape)
    worst = float(abs(values[row, joint]))
    return CheckResult(
        name=name,
        worst=worst,
        limit=float(limit[joint]),
        unit=unit,
        ok=bool(worst <= limit[joint] + ROUNDING),
        at=_moment(int(row), n),
        bodies=(joint_names[joint],),
    )


def _scalar_check(name: str, values: np.ndarray, limit: float, unit: str) -> CheckResult:
    row = int(np.argmax(values))
    return CheckResult(
        name=name,
        worst=float(values[row]),
        limit=limit,
        unit=unit,
        ok=bool(values[row] <= limit + ROUNDING),
        at=(row + 1) * SAMPLE_TIME,
    )


def _position(trajectory: Trajectory, limits: RobotLimits, safety: SafetyLimits) -> CheckResult:
    distance = np.minimum(trajectory.q - limits.q_min, limits.q_max - trajectory.q)
    row, joint = np.unravel_index(int(np.argmin(distance)), distance.shape)
    worst = float(distance[row, joint])
    return CheckResult(
        name="joint_position",
        worst=worst,
        limit=safety.joint_margin,
        unit="rad",
        ok=worst >= safety.joint_margin - 1e-9,
        at=float(row * SAMPLE_TIME),
        bodies=(trajectory.joint_names[joint],),
    )


def _hand_speeds(poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Linear [m/s] and angular [rad/s] speeds between samples, shape (n - 1,) each.

    The angle of the relative rotation R = R0^T R1 follows from |R1 - R0|_F = 2 sqrt(2) sin(angle / 2), which keeps
    its precision for the small angles of one millisecond, where the arc cosine of the trace loses it.
    """
    steps = np.diff(poses, axis=0)
    linear = np.linalg.norm(steps[:, :3, 3], axis=-1) / SAMPLE_TIME
    chord = np.sqrt(np.sum(steps[:, :3, :3] ** 2, axis=(-2, -1))) / (2.0 * np.sqrt(2.0))
    return linear, 2.0 * np.arcsin(np.minimum(chord, 1.0)) / SAMPLE_TIME


def _rest(name: str, trajectory: Trajectory, row: int) -> CheckResult:
    """Whether the trajectory's own derivatives are zero at one end; reports whichever of the two is further off."""
    speed, acceleration = np.abs(trajectory.qd[row]), np.abs(trajectory.qdd[row])
    slow, unaccelerated = speed.max() <= REST_SPEED, acceleration.max() <= REST_ACCELERATION
    blame_speed = not slow or unaccelerated
    values = speed if blame_speed else acceleration
    joint = int(np.argmax(values))
    return CheckResult(
        name=name,
        worst=float(values[joint]),
        limit=REST_SPEED if blame_speed else REST_ACCELERATION,
        unit="rad/s" if blame_speed else "rad/s^2",
        ok=bool(slow and unaccelerated),
        at=row * SAMPLE_TIME,
        bodies=(trajectory.joint_names[joint],),
    )


def _consistency(trajectory: Trajectory) -> CheckResult:
    """Whether qd and qdd are derivatives of q.

    Central, backward and forward differences are usual choices, and analytic derivatives lie between them: so each
    value must lie between those differences, widened by a tolerance; reports the distance as a share of it.
    """
    padded = np.concatenate([np.repeat(trajectory.q[:1], 2, 0), trajectory.q, np.repeat(trajectory.q[-1:], 2, 0)])
    steps = np.diff(padded, axis=0) / SAMPLE_TIME  # steps[k + 1] leads to sample k
    turns = np.diff(steps, axis=0) / SAMPLE_TIME  # turns[k + 1] is centred on sample k
    share = np.maximum(
        _outside(trajectory.qd, steps[1:-2], steps[2:-1]) / SPEED_TOLERANCE,
        _outside(trajectory.qdd, turns[:-2], turns[1:-1], turns[2:]) / ACCELERATION_TOLERANCE,
    )
    row, joint = np.unravel_index(int(np.argmax(share)), share.shape)
    worst = float(share[row, joint])
    return CheckResult(
        name="sampled_consistently",
        worst=worst,
        limit=1.0,
        unit="of the allowed difference",
        ok=worst <= 1.0,
        at=float(row * SAMPLE_TIME),
        bodies=(trajectory.joint_names[joint],),
    )


def _outside(values: np.ndarray, *references: np.ndarray) -> np.ndarray:
    """How far values lie outside the range of the references, element by element."""
    low, high = np.minimum.reduce(references), np.maximum.reduce(references)
    return np.maximum(np.maximum(low - values, values - high), 0.0)
