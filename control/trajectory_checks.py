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
            all checks of the hand (speed, acceleration and jerk, linear and angular).

    Returns:
        One result per check; where a joint is to blame its name stands in `bodies`. `joint_position` gives the
        distance to the nearest published limit, which must not fall below the safety margin; all others must not
        exceed their limit.
    """
    q = trajectory.q
    n = len(q)
    padded, qd, qdd, qddd = commanded_differences(q)
    names = trajectory.joint_names
    results = [
        _position(trajectory, limits, safety),
        _joint_check(
            "joint_velocity", qd, _largest_speeds(padded, qd, limits) * safety.velocity_scale, "rad/s", names, n
        ),
        _joint_check("joint_acceleration", qdd, limits.qdd * safety.acceleration_scale, "rad/s^2", names, n),
        _joint_check("joint_jerk", qddd, limits.qddd, "rad/s^3", names, n),
    ]
    if torque is not None:
        tau = torque(padded, qd, qdd)
        taud = np.diff(tau, axis=0, prepend=tau[:1]) / SAMPLE_TIME
        results.append(_joint_check("torque", tau, limits.tau, "Nm", names, n))
        results.append(_joint_check("torque_rate", taud, limits.taud, "Nm/s", names, n))
    if tcp is not None:
        results.extend(_hand(tcp(padded), limits, safety, n))
    results.append(_rest("starts_at_rest", trajectory, 0))
    results.append(_rest("ends_at_rest", trajectory, n - 1))
    results.append(_consistency(trajectory))
    return tuple(results)


def commanded_differences(q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Positions, velocities, accelerations and jerks of commanded samples as the control box takes them.

    Args:
        q: Samples every millisecond in [rad], shape (n, 7).

    Returns:
        Positions with PADDING rows of rest at either end, and their backward differences in [rad/s], [rad/s^2] and
        [rad/s^3], all of shape (n + 2 PADDING, 7).
    """
    padded = np.concatenate([np.repeat(q[:1], PADDING, 0), q, np.repeat(q[-1:], PADDING, 0)])
    qd = np.diff(padded, axis=0, prepend=padded[:1]) / SAMPLE_TIME
    qdd = np.diff(qd, axis=0, prepend=qd[:1]) / SAMPLE_TIME
    return padded, qd, qdd, np.diff(qdd, axis=0, prepend=qdd[:1]) / SAMPLE_TIME


def hand_velocities(poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Linear [m/s] and angular [rad/s] velocities of the hand by backward differences, shape (n, 3) each.

    Args:
        poses: Of the tool centre point every millisecond, shape (n, 4, 4); it rests before the first.
    """
    linear = np.diff(poses[:, :3, 3], axis=0, prepend=poses[:1, :3, 3]) / SAMPLE_TIME
    return linear, np.concatenate([np.zeros((1, 3)), _turns(poses[:, :3, :3])]) / SAMPLE_TIME


def _moment(row: int, n: int) -> float:
    """Time in [s] of a row of the padded arrays, within the trajectory."""
    return min(max(row - PADDING, 0), n - 1) * SAMPLE_TIME


def _largest_speeds(padded: np.ndarray, qd: np.ndarray, limits: RobotLimits) -> np.ndarray:
    """Published speed limits in [rad/s] of each difference, shape of qd.

    Where they depend on the position, braking from the speed v must end offset before the joint's end:
    (v + offset)^2 <= 2 deceleration distance, at the sample before and at the sample after the difference.
    """
    largest = np.broadcast_to(limits.qd, qd.shape)
    ends = limits.velocity_ends
    if ends is None:
        return largest
    for q in (padded, np.concatenate([padded[:1], padded[:-1]])):
        distance = np.where(qd > 0.0, ends.q_high - q, q - ends.q_low)
        braking = np.sqrt(2.0 * ends.deceleration * np.clip(distance, 0.0, None)) - ends.offset
        largest = np.minimum(largest, np.clip(braking, 0.0, None))
    return largest


def _joint_check(
    name: str, values: np.ndarray, limit: np.ndarray, unit: str, joint_names: tuple[str, ...], n: int
) -> CheckResult:
    """The joint and moment nearest to (or furthest beyond) its limit; limits of joints, or of each moment as well."""
    limit = np.broadcast_to(limit, values.shape)
    share = np.abs(values) / np.maximum(limit, ROUNDING)
    row, joint = np.unravel_index(int(np.argmax(share)), share.shape)
    worst = float(abs(values[row, joint]))
    return CheckResult(
        name=name,
        worst=worst,
        limit=float(limit[row, joint]),
        unit=unit,
        ok=bool(worst <= limit[row, joint] + ROUNDING),
        at=_moment(int(row), n),
        bodies=(joint_names[joint],),
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


def _hand(poses: np.ndarray, limits: RobotLimits, safety: SafetyLimits, n: int) -> list[CheckResult]:
    """Speed, acceleration and jerk of the hand, linear then angular of each; poses rest at both ends."""
    linear, angular = hand_velocities(poses)
    accelerations = safety.acceleration_scale
    table = (
        ("hand_speed", min(safety.hand_speed, limits.cartesian_speed), "m/s"),
        ("hand_angular_speed", min(safety.hand_angular_speed, limits.angular_speed), "rad/s"),
        ("hand_acceleration", limits.cartesian_acceleration * accelerations, "m/s^2"),
        ("hand_angular_acceleration", limits.angular_acceleration * accelerations, "rad/s^2"),
        ("hand_jerk", limits.cartesian_jerk, "m/s^3"),
        ("hand_angular_jerk", limits.angular_jerk, "rad/s^3"),
    )
    results = []
    for k, (name, limit, unit) in enumerate(table):
        rates, order = (linear if k % 2 == 0 else angular), k // 2
        values = np.linalg.norm(np.diff(rates, n=order, axis=0), axis=1) / SAMPLE_TIME**order
        row = int(np.argmax(values))
        worst = float(values[row])
        at = _moment(row + order, n)
        results.append(CheckResult(name, worst, limit, unit, ok=worst <= limit + ROUNDING, at=at))
    return results


def _turns(rotations: np.ndarray) -> np.ndarray:
    """Rotation vectors in [rad] from each rotation to the next in the fixed frame, shape (n - 1, 3).

    Half the sum of the cross products of each axis before with itself after is sin(angle) times the axis of rotation;
    for the small angles of one millisecond it keeps the precision that the arc cosine of the trace loses.
    """
    halves = 0.5 * np.cross(rotations[:-1], rotations[1:], axis=1).sum(axis=2)
    sine = np.linalg.norm(halves, axis=1, keepdims=True)
    angle = np.arcsin(np.minimum(sine, 1.0))
    return halves * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 1.0)


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
