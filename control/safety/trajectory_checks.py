"""Independent check of a 1 kHz trajectory by finite differences, as the Panda's control box makes them.

Needs numpy only; torques and the hand's pose come from callables. It shares no code with the retiming, so that a
mistake there cannot hide itself here. Velocities, accelerations and jerks are backward differences of the commanded
positions (not the trajectory's own derivatives), with the arm at rest before the first and after the last sample.
Source: Franka Control Interface documentation, "Robot and interface specifications" (limits hold for the
differences of the commands that arrive every millisecond).

A robot waits for the answer before it moves, so arrays here lie joint by joint in memory (Fortran order), where numpy
finds each joint's largest value at the speed of memory; row by row it takes twenty times as long.
"""

from collections.abc import Callable

import numpy as np

from control.robot.limits import RobotLimits
from control.safety.certificate import CheckResult
from control.safety.limits import SafetyLimits
from control.trajectory.samples import SAMPLE_TIME, Trajectory

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
        _position(padded[PADDING:-PADDING], trajectory.joint_names, limits, safety),
        _joint_check(
            "joint_velocity", qd, _largest_speeds(padded, qd, limits) * safety.velocity_scale, "rad/s", names, n
        ),
        _joint_check("joint_acceleration", qdd, limits.qdd * safety.acceleration_scale, "rad/s^2", names, n),
        _joint_check("joint_jerk", qddd, limits.qddd, "rad/s^3", names, n),
    ]
    if torque is not None:
        tau = np.asfortranarray(torque(padded, qd, qdd))
        results.append(_joint_check("torque", tau, limits.tau, "Nm", names, n))
        results.append(_joint_check("torque_rate", _rates(tau), limits.taud, "Nm/s", names, n))
    if tcp is not None:
        results.extend(_hand(tcp(padded), limits, safety, n))
    results.append(_rest("starts_at_rest", trajectory, 0))
    results.append(_rest("ends_at_rest", trajectory, n - 1))
    results.append(_consistency(trajectory, qd, qdd))
    return tuple(results)


def commanded_differences(q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Positions, velocities, accelerations and jerks of commanded samples as the control box takes them.

    Args:
        q: Samples every millisecond in [rad], shape (n, 7).

    Returns:
        Positions with PADDING rows of rest at either end, and their backward differences in [rad/s], [rad/s^2] and
        [rad/s^3], all of shape (n + 2 PADDING, 7).
    """
    padded = np.empty((len(q) + 2 * PADDING, q.shape[1]), order="F")
    padded[:PADDING], padded[PADDING:-PADDING], padded[-PADDING:] = q[0], q, q[-1]
    qd = _rates(padded)
    qdd = _rates(qd)
    return padded, qd, qdd, _rates(qdd)


def _rates(rows: np.ndarray) -> np.ndarray:
    """Backward differences of rows a millisecond apart, per second; the first is zero."""
    rates = np.empty_like(rows)
    rates[0] = 0.0
    np.subtract(rows[1:], rows[:-1], out=rates[1:])
    rates /= SAMPLE_TIME
    return rates


def hand_velocities(poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Linear [m/s] and angular [rad/s] velocities of the hand by backward differences, shape (n, 3) each.

    Args:
        poses: Of the tool centre point every millisecond, shape (n, 4, 4); it rests before the first.
    """
    linear = _rates(np.asfortranarray(poses[:, :3, 3]))
    angular = np.zeros_like(linear)
    np.divide(_turns(poses[:, :3, :3]), SAMPLE_TIME, out=angular[1:])
    return linear, angular


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
    sizes, limits = np.abs(values), np.broadcast_to(limit, values.shape)
    shares = sizes if limit.ndim == 1 else sizes / np.maximum(limit, ROUNDING)
    rows, joints = np.argmax(shares, axis=0), np.arange(values.shape[1])  # each joint's worst moment
    share = sizes[rows, joints] / np.maximum(limits[rows, joints], ROUNDING)
    joint = int(np.argmax(share))
    row = int(rows[joint])
    worst = float(sizes[row, joint])
    return CheckResult(
        name=name,
        worst=worst,
        limit=float(limits[row, joint]),
        unit=unit,
        ok=bool(worst <= limits[row, joint] + ROUNDING),
        at=_moment(row, n),
        bodies=(joint_names[joint],),
    )


def _position(q: np.ndarray, joint_names: tuple[str, ...], limits: RobotLimits, safety: SafetyLimits) -> CheckResult:
    low, high = np.argmin(q, axis=0), np.argmax(q, axis=0)
    joints = np.arange(q.shape[1])
    below, above = q[low, joints] - limits.q_min, limits.q_max - q[high, joints]
    joint = int(np.argmin(np.minimum(below, above)))
    row, worst = (low, float(below[joint])) if below[joint] <= above[joint] else (high, float(above[joint]))
    return CheckResult(
        name="joint_position",
        worst=worst,
        limit=safety.joint_margin,
        unit="rad",
        ok=worst >= safety.joint_margin - 1e-9,
        at=float(row[joint] * SAMPLE_TIME),
        bodies=(joint_names[joint],),
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
        values = _lengths(np.diff(rates, n=order, axis=0)) / SAMPLE_TIME**order
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
    # One contiguous array an element: numpy's own cross product of so many small vectors takes ten times as long.
    elements = np.ascontiguousarray(rotations.transpose(1, 2, 0))
    before, after = elements[:, :, :-1], elements[:, :, 1:]
    halves = np.empty((len(rotations) - 1, 3), order="F")
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        halves[:, k] = 0.5 * (before[i] * after[j] - before[j] * after[i]).sum(axis=0)
    sine = _lengths(halves)
    angle = np.arcsin(np.minimum(sine, 1.0))
    halves *= np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 1.0)[:, None]
    return halves


def _lengths(vectors: np.ndarray) -> np.ndarray:
    """Euclidean lengths, (n, 3) to (n,)."""
    x, y, z = vectors.T
    return np.sqrt(x * x + y * y + z * z)


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


def _consistency(trajectory: Trajectory, speeds: np.ndarray, accelerations: np.ndarray) -> CheckResult:
    """Whether qd and qdd are derivatives of q.

    Central, backward and forward differences are usual choices, and analytic derivatives lie between them: so each
    value must lie between those differences, widened by a tolerance; reports the distance as a share of it.

    Args:
        speeds, accelerations: As `commanded_differences` gives them.
    """
    n = len(trajectory.q)
    # Row k + PADDING of the differences leads to sample k, and a second difference is centred a row earlier.
    steps = [speeds[k : k + n] for k in (PADDING, PADDING + 1)]
    turns = [accelerations[k : k + n] for k in (PADDING, PADDING + 1, PADDING + 2)]
    outside = (
        _outside(trajectory.qd, steps) / SPEED_TOLERANCE,
        _outside(trajectory.qdd, turns) / ACCELERATION_TOLERANCE,
    )
    share = np.maximum(*outside)
    rows = np.argmax(share, axis=0)
    joint = int(np.argmax(share[rows, np.arange(share.shape[1])]))
    row = int(rows[joint])
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


def _outside(values: np.ndarray, references: list[np.ndarray]) -> np.ndarray:
    """How far values lie outside the range of the references, element by element."""
    low, high = np.minimum(*references[:2]), np.maximum(*references[:2])
    for reference in references[2:]:
        np.minimum(low, reference, out=low)
        np.maximum(high, reference, out=high)
    values = np.asfortranarray(values)
    np.subtract(low, values, out=low)
    np.subtract(values, high, out=high)
    np.maximum(low, high, out=low)
    return np.maximum(low, 0.0, out=low)
