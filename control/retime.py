"""Retiming: from a joint path to the 1 kHz trajectory that a robot plays.

Each segment goes from rest to rest. In this order:

1. a smooth path within a tolerance of the waypoints (`control.path_smoothing`);
2. the fastest time law under speed, acceleration and torque bounds (`control.time_law`);
3. two moving averages of the progress s(t), which bound jerk and torque rate and leave the path exactly as it was;
4. every millisecond checked by finite differences, with the rigid-body model;
5. if a limit is still broken, the time law is stretched uniformly and 3 and 4 are repeated. Velocity falls with the
   stretch, acceleration with its square, jerk with its cube, and what remains of torque is gravity: so this ends.
"""

from dataclasses import dataclass

import numpy as np

from control.errors import RetimingError
from control.limits import RobotLimits
from control.path_smoothing import SmoothPath, distinct_waypoints, smooth_path
from control.robot import RobotModel
from control.safety import SafetyLimits
from control.time_law import LARGE_SPEED, PathBounds, TimeLaw, fastest_time_law
from control.trajectory import (
    SAMPLE_TIME,
    GripperCommand,
    GripperEvent,
    JointPath,
    PathSegment,
    Trajectory,
    TrajectorySegment,
)

JOIN_TOLERANCE = 1e-6  # [rad] between the end of one segment and the start of the next
MAX_STRETCH = 100.0


@dataclass(frozen=True)
class RetimingOptions:
    """How to retime.

    Attributes:
        tolerance: Largest deviation of a joint from the waypoints' polyline in [rad]; 4 mrad move the hand by 3 mm at
            most when the arm is stretched, well below the clearances that paths are searched with.
        grasp_dwell: Time that the arm rests for a grasp in [s].
        move_dwell: Time that it rests for opening or closing to a width in [s].
        margin: Share of speed and acceleration limits that the time law aims at, so that the averages of step 3
            rarely break them.
        widths: Lengths of the moving average to choose from, in samples; the second average has half of it.
        grid: Grid intervals of the time law along a segment, at least.
    """

    tolerance: float = 0.004
    grasp_dwell: float = 0.8
    move_dwell: float = 0.5
    margin: float = 0.99
    widths: tuple[int, ...] = (8, 16, 24, 32, 48, 64)
    grid: int = 160


@dataclass(frozen=True)
class SegmentReport:
    """How one segment was retimed.

    Attributes:
        name: Of the path segment.
        duration: From rest to rest in [s], without dwell.
        bound: Shortest duration of the same smooth path with unbounded jerk and torque rate, in [s].
        deviation: Largest difference of a joint from the waypoints' polyline in [rad].
        width: Length of the moving average in samples.
        stretch: Uniform stretch that was needed, 1 = none.
    """

    name: str
    duration: float
    bound: float
    deviation: float
    width: int
    stretch: float


@dataclass(frozen=True)
class RetimingReport:
    """How a path was retimed; segments without motion do not appear."""

    segments: tuple[SegmentReport, ...]

    @property
    def deviation(self) -> float:
        """Largest difference of a joint from the waypoints' polyline in [rad]."""
        return max((s.deviation for s in self.segments), default=0.0)

    @property
    def ratio(self) -> float:
        """Moving time relative to the bound, 1 = cannot be faster."""
        bound = sum(s.bound for s in self.segments)
        return sum(s.duration for s in self.segments) / bound if bound > 0 else 1.0


def retime(
    path: JointPath,
    robot: RobotModel,
    limits: RobotLimits,
    safety: SafetyLimits,
    options: RetimingOptions | None = None,
) -> Trajectory:
    """Put a time law on a path; see `retime_with_report`."""
    return retime_with_report(path, robot, limits, safety, options)[0]


def retime_with_report(
    path: JointPath,
    robot: RobotModel,
    limits: RobotLimits,
    safety: SafetyLimits,
    options: RetimingOptions | None = None,
) -> tuple[Trajectory, RetimingReport]:
    """Put a time law on a path.

    Args:
        path: Waypoints in [rad] by segment. Segments without motion only contribute their gripper command.
        robot: Rigid-body model for torques and the hand's speed.
        limits: Published limits of the robot.
        safety: Shares of them that may be used, and the hand's speeds. A segment's speed_scale slows all speeds down
            further; accelerations stay.
        options: Tolerance, dwells and tuning.

    Returns:
        The trajectory, at rest at each end of each segment, and how it was made. The dwell of a gripper command is a
        trajectory segment of its own named after the command's kind ("grasp" or "move") that holds nothing, as the
        hand is closing or opening, and may touch what the path segment before it may.

    Raises:
        RetimingError: Waypoints that are malformed, outside the joint limits or not joined, or a pose that the arm
            cannot hold; names the segment and the limit.
    """
    options = options or RetimingOptions()
    if not path.segments:
        raise RetimingError("the path has no segments; it needs at least one")
    pieces: list[np.ndarray] = []
    events: list[GripperEvent] = []
    stretches: list[TrajectorySegment] = []
    reports: list[SegmentReport] = []
    count = 0  # samples so far
    last: np.ndarray | None = None
    for segment in path.segments:
        q = _checked_waypoints(segment, last, limits, safety)
        if last is None:
            pieces.append(q[:1])
            count = 1
        start = count if stretches else 0
        last = q[-1]
        if len(q) > 1:
            samples, report = _retime_segment(segment, q, robot, limits, safety, options)
            reports.append(report)
            pieces.append(samples)
            count += len(samples)
            stretches.append(TrajectorySegment(segment.name, start, count, segment.held, segment.touching))
        if segment.gripper is not None:
            start = count if stretches else 0
            dwell = _dwell(segment.gripper, options)
            events.append(GripperEvent((count - 1) * SAMPLE_TIME, dwell, segment.gripper))
            rest = int(np.ceil(dwell / SAMPLE_TIME))
            pieces.append(np.repeat(q[-1:], rest, axis=0))
            count += rest
            stretches.append(TrajectorySegment(segment.gripper.kind, start, count, None, segment.touching))
    if count < 2:  # nothing moves and nothing is gripped: a trajectory has two samples at least
        assert last is not None
        pieces.append(last[None])
        first = path.segments[0]
        stretches.append(TrajectorySegment(first.name, 0, 2, first.held, first.touching))
    q = np.concatenate(pieces)
    padded = np.concatenate([q[:1], q, q[-1:]])
    trajectory = Trajectory(
        q=q,
        qd=(padded[2:] - padded[:-2]) / (2.0 * SAMPLE_TIME),
        qdd=(padded[2:] - 2.0 * q + padded[:-2]) / SAMPLE_TIME**2,
        gripper=tuple(events),
        segments=tuple(stretches),
    )
    return trajectory, RetimingReport(tuple(reports))


def _dwell(command: GripperCommand, options: RetimingOptions) -> float:
    return options.grasp_dwell if command.kind == "grasp" else options.move_dwell


def _checked_waypoints(
    segment: PathSegment, last: np.ndarray | None, limits: RobotLimits, safety: SafetyLimits
) -> np.ndarray:
    """Distinct waypoints that begin exactly where the segment before ended, shape (m >= 1, 7)."""
    q = np.array(segment.q, dtype=float)
    name = f"segment '{segment.name}'"
    if q.ndim != 2 or q.shape[1] != 7 or len(q) == 0:
        raise RetimingError(f"{name} has waypoints of shape {q.shape}; they need shape (n >= 1, 7)")
    if not np.all(np.isfinite(q)):
        row, joint = np.argwhere(~np.isfinite(q))[0]
        raise RetimingError(f"{name} is not finite at waypoint {row}, joint {joint + 1}")
    if not 0.0 < segment.speed_scale <= 1.0:
        raise RetimingError(f"{name} has speed_scale {segment.speed_scale}; it must be above 0 and at most 1")
    if last is not None:
        gap = np.abs(q[0] - last)
        if gap.max() > JOIN_TOLERANCE:
            joint = int(np.argmax(gap))
            raise RetimingError(
                f"{name} starts {gap.max():.4g} rad away from where the segment before it ends (joint {joint + 1}); "
                "begin it with that segment's last waypoint"
            )
        q[0] = last
    margin = np.minimum(q - limits.q_min, limits.q_max - q)
    if margin.min() < safety.joint_margin:
        row, joint = np.unravel_index(int(np.argmin(margin)), margin.shape)
        low, high = limits.q_min[joint] + safety.joint_margin, limits.q_max[joint] - safety.joint_margin
        raise RetimingError(
            f"{name} breaks joint_position at waypoint {row}: joint {joint + 1} is at {q[row, joint]:.4f} rad; "
            f"{low:.4f} to {high:.4f} rad is allowed with the margin of {safety.joint_margin} rad"
        )
    return distinct_waypoints(q)


@dataclass(frozen=True)
class _Limits:
    """What one segment is held to: shares applied, speeds slowed down."""

    qd: np.ndarray
    qdd: np.ndarray
    qddd: np.ndarray
    tau: np.ndarray
    taud: np.ndarray
    hand: float
    turn: float


def _retime_segment(
    segment: PathSegment,
    q: np.ndarray,
    robot: RobotModel,
    limits: RobotLimits,
    safety: SafetyLimits,
    options: RetimingOptions,
) -> tuple[np.ndarray, SegmentReport]:
    """Samples after the first waypoint until rest, shape (n, 7), and how they came about."""
    share = segment.speed_scale
    allowed = _Limits(
        qd=limits.qd * safety.velocity_scale * share,
        qdd=limits.qdd * safety.acceleration_scale,
        qddd=limits.qddd,
        tau=limits.tau,
        taud=limits.taud,
        hand=min(safety.hand_speed, limits.cartesian_speed) * share,
        turn=min(safety.hand_angular_speed, limits.angular_speed) * share,
    )
    q_min, q_max = limits.q_min + safety.joint_margin, limits.q_max - safety.joint_margin
    path = smooth_path(q, options.tolerance, q_min, q_max, allowed.qd, allowed.qdd)
    dynamics = _PathDynamics(path, robot, _grid(path, options.grid))
    _check_gravity(segment, dynamics, allowed)
    bound = fastest_time_law(dynamics.bounds(allowed, 1.0)).duration
    law = fastest_time_law(dynamics.bounds(allowed, options.margin))
    width, stretch = _choose_width(law, path, dynamics, allowed, options)
    for _ in range(60):
        samples = path(_progress(law, width, stretch))
        samples[0], samples[-1] = q[0], q[-1]
        samples = np.concatenate([samples[:1], samples, samples[-1:]])  # one sample of rest makes the joins exact
        shares = _shares(samples, robot, allowed)
        name, worst = max(shares.items(), key=lambda item: item[1])
        if worst <= 1.0:
            duration = (len(samples) - 1) * SAMPLE_TIME
            report = SegmentReport(segment.name, duration, bound, path.deviation, width, stretch)
            return samples[1:], report
        if stretch > MAX_STRETCH:
            break
        stretch *= max(1.002, min(1.25, _needed_stretch(shares)))
    raise RetimingError(
        f"segment '{segment.name}': no time law keeps {name}; even {stretch:.0f} times slower it reaches "
        f"{100 * worst:.1f} % of the limit. Take another path"
    )


def _grid(path: SmoothPath, least: int) -> np.ndarray:
    """Grid that resolves every knot interval, of at least `least` intervals."""
    intervals = len(path.breaks) - 1
    parts = max(3, -(-least // intervals))
    fractions = np.arange(parts) / parts
    inner = path.breaks[:-1, None] + np.diff(path.breaks)[:, None] * fractions
    return np.append(inner.ravel(), path.breaks[-1])


class _PathDynamics:
    """Torque along a path as m(s) s'' + c(s) s'^2 + g(s), and how fast the hand moves per unit of s."""

    def __init__(self, path: SmoothPath, robot: RobotModel, s: np.ndarray) -> None:
        q, first, second = path(s), path(s, 1), path(s, 2)
        zero = np.zeros_like(q)
        self.s, self.first, self.second = s, first, second
        self.g = robot.gravity(q)
        self.m = robot.torque(q, zero, first) - self.g
        self.c = robot.torque(q, first, second) - self.g
        twist = np.einsum("nij,nj->ni", robot.tcp_jacobians(q), first)
        self.hand = np.linalg.norm(twist[:, :3], axis=1)
        self.turn = np.linalg.norm(twist[:, 3:], axis=1)

    def bounds(self, allowed: _Limits, margin: float) -> PathBounds:
        """Bounds for the time law at a share of the speed and acceleration limits."""
        slowness = np.max(np.abs(self.first) / allowed.qd, axis=1)
        slowness = np.maximum(slowness, np.maximum(self.hand / allowed.hand, self.turn / allowed.turn))
        acceleration = np.broadcast_to(allowed.qdd * margin, self.first.shape)
        return PathBounds(
            s=self.s,
            a=np.concatenate([self.first, self.m], axis=1),
            b=np.concatenate([self.second, self.c], axis=1),
            low=np.concatenate([-acceleration, np.minimum(-allowed.tau - self.g, 0.0)], axis=1),
            high=np.concatenate([acceleration, np.maximum(allowed.tau - self.g, 0.0)], axis=1),
            cap=np.minimum((margin / np.maximum(slowness, 1e-9)) ** 2, LARGE_SPEED),
        )

    def torque(self, s: np.ndarray) -> np.ndarray:
        """Torques of samples s(t) every millisecond, from the grid by linear interpolation, in [Nm], shape (n, 7)."""
        padded = np.concatenate([s[:1], s, s[-1:]])
        speed = ((padded[2:] - padded[:-2]) / (2.0 * SAMPLE_TIME))[:, None]
        acceleration = ((padded[2:] - 2.0 * s + padded[:-2]) / SAMPLE_TIME**2)[:, None]
        k = np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, len(self.s) - 2)
        f = ((s - self.s[k]) / (self.s[k + 1] - self.s[k]))[:, None]

        def between(values: np.ndarray) -> np.ndarray:
            return values[k] * (1.0 - f) + values[k + 1] * f

        return between(self.m) * acceleration + between(self.c) * speed**2 + between(self.g)


def _check_gravity(segment: PathSegment, dynamics: _PathDynamics, allowed: _Limits) -> None:
    share = np.abs(dynamics.g) / allowed.tau
    if share.max() > 1.0:
        row, joint = np.unravel_index(int(np.argmax(share)), share.shape)
        raise RetimingError(
            f"segment '{segment.name}': holding still already breaks torque: joint {joint + 1} needs "
            f"{abs(dynamics.g[row, joint]):.1f} Nm, {allowed.tau[joint]:.1f} Nm is allowed. "
            "Carry less or nearer to the body"
        )


def _progress(law: TimeLaw, width: int, stretch: float) -> np.ndarray:
    """Progress s every millisecond of the stretched law after two moving averages of width and width / 2."""
    steps = int(np.ceil(law.duration * stretch / SAMPLE_TIME))
    s = law.at(np.arange(steps + 1) * (SAMPLE_TIME / stretch))
    half = max(width // 2, 1)
    kernel = np.convolve(np.full(width, 1.0 / width), np.full(half, 1.0 / half))
    reach = len(kernel) - 1
    # The filter may overshoot the ends by rounding only; that must not leave the path.
    smooth = np.convolve(np.concatenate([np.full(reach, s[0]), s, np.full(reach, law.s[-1])]), kernel, "valid")
    return np.clip(smooth, law.s[0], law.s[-1])


def _choose_width(
    law: TimeLaw, path: SmoothPath, dynamics: _PathDynamics, allowed: _Limits, options: RetimingOptions
) -> tuple[int, float]:
    """Width of the averages with the shortest duration after the stretch that it seems to need, and that stretch."""
    best = (np.inf, options.widths[0], 1.0)
    for width in options.widths:
        s = _progress(law, width, 1.0)
        shares = _difference_shares(path(s), dynamics.torque(s), allowed)
        stretch = max(1.0, _needed_stretch(shares))
        best = min(best, (law.duration * stretch + 1.5 * width * SAMPLE_TIME, width, stretch))
    return best[1], best[2]


def _needed_stretch(shares: dict[str, float]) -> float:
    """Stretch that would bring every share (1 = at the limit) down to 1, by the order in time of each quantity."""
    order = {"joint_acceleration": 2, "torque": 2, "joint_jerk": 3, "torque_rate": 3}
    return max(share ** (1.0 / order.get(name, 1)) for name, share in shares.items())


def _difference_shares(q: np.ndarray, tau: np.ndarray, allowed: _Limits) -> dict[str, float]:
    """Largest share of each limit that samples take; q moves from rest to rest."""
    rest = np.concatenate([np.repeat(q[:1], 3, 0), q, np.repeat(q[-1:], 3, 0)])
    qd = np.diff(rest, axis=0) / SAMPLE_TIME
    qdd = np.diff(qd, axis=0) / SAMPLE_TIME
    qddd = np.diff(qdd, axis=0) / SAMPLE_TIME
    taud = np.diff(tau, axis=0) / SAMPLE_TIME
    pairs = {
        "joint_velocity": (qd, allowed.qd),
        "joint_acceleration": (qdd, allowed.qdd),
        "joint_jerk": (qddd, allowed.qddd),
        "torque": (tau, allowed.tau),
        "torque_rate": (taud, allowed.taud),
    }
    return {name: float(np.max(np.abs(values) / limit)) for name, (values, limit) in pairs.items()}


def _shares(q: np.ndarray, robot: RobotModel, allowed: _Limits) -> dict[str, float]:
    """Largest share of every limit, with torques and hand speeds of the rigid-body model at every sample."""
    rest = np.concatenate([np.repeat(q[:1], 3, 0), q, np.repeat(q[-1:], 3, 0)])
    qd = np.diff(rest, axis=0, prepend=rest[:1]) / SAMPLE_TIME
    qdd = np.diff(qd, axis=0, prepend=qd[:1]) / SAMPLE_TIME
    shares = _difference_shares(q, robot.torque(rest, qd, qdd), allowed)
    poses = robot.tcp_poses(q)
    moved = np.diff(poses, axis=0)
    # |R1 - R0|_F / sqrt(2) = 2 sin(angle / 2): within 1e-7 of the small angle of one millisecond.
    angle = np.sqrt(np.sum(moved[:, :3, :3] ** 2, axis=(1, 2)) / 2.0)
    shares["hand_speed"] = float(np.max(np.linalg.norm(moved[:, :3, 3], axis=1)) / SAMPLE_TIME / allowed.hand)
    shares["hand_angular_speed"] = float(np.max(angle) / SAMPLE_TIME / allowed.turn)
    return shares
