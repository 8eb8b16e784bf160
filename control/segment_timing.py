"""Timing one segment of a path, from rest to rest.

In this order:

1. a smooth path within a tolerance of the waypoints (`control.path_smoothing`);
2. the fastest time law under speed, acceleration and torque bounds (`control.time_law`);
3. two moving averages of the progress s(t), which bound jerk and torque rate and leave the path exactly as it was;
4. where samples still break a limit, mostly by torque rate in tight corners, the bounds of 2 are lowered there and 2
   and 3 are repeated a few times;
5. every millisecond is checked by finite differences with the rigid-body model, and if anything is still broken, the
   time law is stretched uniformly. Velocity falls with the stretch, acceleration with its square, jerk with its cube,
   and what remains of torque is gravity: so this ends.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d

from control.errors import RetimingError
from control.limits import RobotLimits
from control.path_smoothing import SmoothPath, smooth_path
from control.robot import RobotModel
from control.safety import SafetyLimits
from control.time_law import LARGE_SPEED, PathBounds, TimeLaw, fastest_time_law
from control.trajectory import SAMPLE_TIME, PathSegment

MAX_STRETCH = 100.0
ROUNDS = 5  # of lowering the bounds locally
GOOD_ENOUGH = 1.004  # a uniform stretch smaller than this is not worth another round
WORTH_WIDENING = 1.03  # one larger than this is worth trying wider averages
MOST_LOWERED = 1.5  # factor by which one round lowers speeds at most
HOPELESS = 10.0  # a stretch above this has no local cause: a uniform stretch it is
PADDING = 3  # samples of rest on either side: a third difference reaches that far
# How a quantity falls when time is stretched by k: with 1 / k^order, gravity aside.
ORDER = {"joint_acceleration": 2, "joint_jerk": 3, "torque": 2, "torque_rate": 3}


@dataclass(frozen=True)
class RetimingOptions:
    """How to retime.

    Attributes:
        tolerance: Largest deviation of a joint from the waypoints' polyline in [rad]; 4 mrad of one joint move the
            hand of a stretched Panda by less than 4 mm.
        grasp_dwell: Time that the arm rests for a grasp in [s]; longer where the gripper needs it for its whole stroke.
        move_dwell: Time that it rests for opening or closing to a width in [s]; as for a grasp.
        margin: Share of speed and acceleration limits that the time law aims at, so that the moving averages rarely
            break them.
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
    """How one segment was timed.

    Attributes:
        name: Of the path segment.
        duration: From rest to rest in [s], without dwell.
        bound: Shortest duration of the same smooth path with unbounded jerk and torque rate, in [s].
        deviation: Largest difference of a joint from the waypoints' polyline in [rad].
        width: Length of the moving average in samples.
        stretch: Uniform stretch that was needed at last, 1 = none.
    """

    name: str
    duration: float
    bound: float
    deviation: float
    width: int
    stretch: float


@dataclass(frozen=True)
class _Allowed:
    """What a segment is held to: shares applied, speeds slowed down; units as in RobotLimits and SafetyLimits."""

    qd: np.ndarray
    qdd: np.ndarray
    qddd: np.ndarray
    tau: np.ndarray
    taud: np.ndarray
    hand: float
    turn: float

    @classmethod
    def of(cls, limits: RobotLimits, safety: SafetyLimits, speed_scale: float) -> "_Allowed":
        return cls(
            qd=limits.qd * safety.velocity_scale * speed_scale,
            qdd=limits.qdd * safety.acceleration_scale,
            qddd=limits.qddd,
            tau=limits.tau,
            taud=limits.taud,
            hand=min(safety.hand_speed, limits.cartesian_speed) * speed_scale,
            turn=min(safety.hand_angular_speed, limits.angular_speed) * speed_scale,
        )


def time_segment(
    segment: PathSegment,
    q: np.ndarray,
    robot: RobotModel,
    limits: RobotLimits,
    safety: SafetyLimits,
    options: RetimingOptions,
) -> tuple[np.ndarray, SegmentReport]:
    """Samples from rest to rest.

    Args:
        segment: Name and speed_scale of the segment.
        q: Its distinct waypoints in [rad], shape (m >= 2, 7), within the joint limits.
        robot: Rigid-body model.
        limits: Published limits.
        safety: Shares of them that may be used, and the hand's speeds.
        options: Tolerance and tuning.

    Returns:
        Joint positions every millisecond in [rad], shape (n, 7), beginning one millisecond after the arm rested at
        q[0] and ending with two equal samples at q[-1]; and how they came about.

    Raises:
        RetimingError: No time law keeps the limits; names the segment and the limit.
    """
    allowed = _Allowed.of(limits, safety, segment.speed_scale)
    q_min, q_max = limits.q_min + safety.joint_margin, limits.q_max - safety.joint_margin
    path = smooth_path(q, options.tolerance, q_min, q_max, allowed.qd, allowed.qdd)
    dynamics = _PathDynamics(path, robot, _grid(path, options.grid), allowed)
    dynamics.check_gravity(segment.name)
    try:
        bound = fastest_time_law(dynamics.bounds(1.0)).duration
        law, width, stretch = _lower_where_needed(path, dynamics, options)
    except RetimingError as error:
        raise RetimingError(f"segment '{segment.name}': {error}") from error
    stretch = min(stretch, MAX_STRETCH / 2)
    name, worst = "", np.inf
    while stretch <= MAX_STRETCH:
        samples = path(_progress(law, width, stretch))
        samples[0], samples[-1] = q[0], q[-1]
        samples = np.concatenate([samples[:1], samples, samples[-1:]])  # one sample of rest makes the joins exact
        needed, name, worst = _needed_with_model(samples, robot, allowed)
        if worst <= 1.0:
            duration = (len(samples) - 1) * SAMPLE_TIME
            return samples[1:], SegmentReport(segment.name, duration, bound, path.deviation, width, stretch)
        stretch *= min(1.25, max(1.001, needed))
    raise RetimingError(
        f"segment '{segment.name}': no time law keeps {name}; even {MAX_STRETCH:.0f} times slower than the fastest "
        f"it reaches {100 * worst:.1f} % of the limit. Take another path"
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

    def __init__(self, path: SmoothPath, robot: RobotModel, s: np.ndarray, allowed: _Allowed) -> None:
        q, first, second = path(s), path(s, 1), path(s, 2)
        self.s, self.first, self.second, self.allowed = s, first, second, allowed
        self.g = robot.gravity(q)
        self.m = robot.torque(q, np.zeros_like(q), first) - self.g
        self.c = robot.torque(q, first, second) - self.g
        twist = np.einsum("nij,nj->ni", robot.tcp_jacobians(q), first)
        hand, turn = np.linalg.norm(twist[:, :3], axis=1), np.linalg.norm(twist[:, 3:], axis=1)
        slowness = np.max(np.abs(first) / allowed.qd, axis=1)
        self.slowness = np.maximum(slowness, np.maximum(hand / allowed.hand, turn / allowed.turn))  # 1 / largest s'

    def check_gravity(self, name: str) -> None:
        """Raise RetimingError where the arm cannot even rest."""
        allowed = self.allowed.tau
        row, joint = np.unravel_index(int(np.argmax(np.abs(self.g) / allowed)), self.g.shape)
        if abs(self.g[row, joint]) > allowed[joint]:
            raise RetimingError(
                f"segment '{name}' breaks torque even at rest: joint {joint + 1} needs {abs(self.g[row, joint]):.1f} "
                f"Nm against gravity, {allowed[joint]:.1f} Nm is allowed. Carry less, or nearer to the base"
            )

    def bounds(self, margin: float | np.ndarray) -> PathBounds:
        """Bounds for the time law at a share of the speed limits and its square of the acceleration limits.

        Args:
            margin: One share, or one per grid point, shape (n,).
        """
        share = np.broadcast_to(margin, self.s.shape)
        acceleration = self.allowed.qdd * share[:, None] ** 2
        return PathBounds(
            s=self.s,
            a=np.concatenate([self.first, self.m], axis=1),
            b=np.concatenate([self.second, self.c], axis=1),
            low=np.concatenate([-acceleration, np.minimum(-self.allowed.tau - self.g, 0.0)], axis=1),
            high=np.concatenate([acceleration, np.maximum(self.allowed.tau - self.g, 0.0)], axis=1),
            cap=np.minimum((share / np.maximum(self.slowness, 1e-9)) ** 2, LARGE_SPEED),
        )

    def torque(self, s: np.ndarray) -> np.ndarray:
        """Torques of samples s(t) every millisecond, from the grid by linear interpolation, in [Nm], shape (n, 7)."""
        speed = np.diff(s, prepend=s[0])[:, None] / SAMPLE_TIME
        acceleration = np.diff(speed, axis=0, prepend=0.0) / SAMPLE_TIME
        k = np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, len(self.s) - 2)
        f = ((s - self.s[k]) / (self.s[k + 1] - self.s[k]))[:, None]

        def between(values: np.ndarray) -> np.ndarray:
            return values[k] * (1.0 - f) + values[k + 1] * f

        return between(self.m) * acceleration + between(self.c) * speed**2 + between(self.g)


def _progress(law: TimeLaw, width: int, stretch: float) -> np.ndarray:
    """Progress s every millisecond of the stretched law after two moving averages of width and width / 2."""
    steps = int(np.ceil(law.duration * stretch / SAMPLE_TIME))
    s = law.at(np.arange(steps + 1) * (SAMPLE_TIME / stretch))
    half = max(width // 2, 1)
    kernel = np.convolve(np.full(width, 1.0 / width), np.full(half, 1.0 / half))
    reach = len(kernel) - 1
    smooth = np.convolve(np.concatenate([np.full(reach, s[0]), s, np.full(reach, law.s[-1])]), kernel, "valid")
    return np.clip(smooth, law.s[0], law.s[-1])  # rounding must not leave the path


def _lower_where_needed(
    path: SmoothPath, dynamics: _PathDynamics, options: RetimingOptions
) -> tuple[TimeLaw, int, float]:
    """Time law, width of the moving averages, and the uniform stretch that they still seem to need."""
    law = fastest_time_law(dynamics.bounds(options.margin))
    plain = [_attempt(law, width, path, dynamics) for width in options.widths]
    best = min(plain, key=lambda attempt: attempt.duration)
    # Wider averages cure torque rates where the acceleration switches, lower bounds cure those of tight corners; so
    # the width that was best without lowering comes first, wider ones only when lowering does not help enough.
    for start in (a for a in plain if a.width >= best.width):
        if best.stretch < GOOD_ENOUGH or best.stretch > HOPELESS:
            break
        share = np.full(len(dynamics.s), options.margin)
        attempt = start
        for _ in range(ROUNDS):
            # More than what is needed, as averages blend in the neighbourhood; not too much, as it is a first guess.
            share = share / np.minimum(_at_grid(dynamics.s, attempt) ** 1.1, MOST_LOWERED)
            attempt = _attempt(fastest_time_law(dynamics.bounds(share)), start.width, path, dynamics)
            best = min(best, attempt, key=lambda a: a.duration)
            if attempt.stretch < GOOD_ENOUGH:
                break
        if best.stretch < WORTH_WIDENING:
            break
    return best.law, best.width, best.stretch


@dataclass(frozen=True)
class _Attempt:
    """A time law after averaging: progress samples s and the local stretch that each asks for, shape (n,)."""

    law: TimeLaw
    width: int
    s: np.ndarray
    needed: np.ndarray

    @property
    def stretch(self) -> float:
        """Uniform stretch that would be needed."""
        return float(self.needed.max())

    @property
    def duration(self) -> float:
        """What it would then take in [s]."""
        return self.law.duration * self.stretch + 1.5 * self.width * SAMPLE_TIME


def _at_grid(grid: np.ndarray, attempt: _Attempt) -> np.ndarray:
    """The most that any sample between a grid point's neighbours asks for, shape (n,)."""
    out = np.interp(grid, attempt.s, attempt.needed)
    k = np.clip(np.searchsorted(grid, attempt.s, side="right") - 1, 0, len(grid) - 2)
    np.maximum.at(out, k, attempt.needed)
    np.maximum.at(out, k + 1, attempt.needed)
    return out


def _attempt(law: TimeLaw, width: int, path: SmoothPath, dynamics: _PathDynamics) -> _Attempt:
    """Average a time law and see where it breaks limits; demands are spread over the width of the averages."""
    s = _progress(law, width, 1.0)
    s = np.concatenate([np.full(PADDING, s[0]), s, np.full(PADDING, s[-1])])
    shares = _shares(path(s), dynamics.torque(s), dynamics.allowed)
    needed = np.max([share ** (1.0 / ORDER.get(name, 1)) for name, share in shares.items()], axis=0)
    return _Attempt(law, width, s, maximum_filter1d(np.maximum(1.0, needed), 2 * width + 1))


def _shares(q: np.ndarray, tau: np.ndarray, allowed: _Allowed) -> dict[str, np.ndarray]:
    """Share of each limit that each sample takes by backward differences, shape (n,); q begins and ends at rest."""
    qd = np.diff(q, axis=0, prepend=q[:1]) / SAMPLE_TIME
    qdd = np.diff(qd, axis=0, prepend=qd[:1]) / SAMPLE_TIME
    pairs = {
        "joint_velocity": (qd, allowed.qd),
        "joint_acceleration": (qdd, allowed.qdd),
        "joint_jerk": (np.diff(qdd, axis=0, prepend=qdd[:1]) / SAMPLE_TIME, allowed.qddd),
        "torque": (tau, allowed.tau),
        "torque_rate": (np.diff(tau, axis=0, prepend=tau[:1]) / SAMPLE_TIME, allowed.taud),
    }
    return {name: np.max(np.abs(values) / limit, axis=1) for name, (values, limit) in pairs.items()}


def _needed_with_model(q: np.ndarray, robot: RobotModel, allowed: _Allowed) -> tuple[float, str, float]:
    """Stretch that samples need by the rigid-body model, and the name and share of the limit that asks for it."""
    rest = np.concatenate([np.repeat(q[:1], PADDING, 0), q, np.repeat(q[-1:], PADDING, 0)])
    qd = np.diff(rest, axis=0, prepend=rest[:1]) / SAMPLE_TIME
    qdd = np.diff(qd, axis=0, prepend=qd[:1]) / SAMPLE_TIME
    shares = {k: float(v.max()) for k, v in _shares(rest, robot.torque(rest, qd, qdd), allowed).items()}
    moved = np.diff(robot.tcp_poses(q), axis=0)
    # |R1 - R0|_F / sqrt(2) = 2 sin(angle / 2): within 1e-9 of the small angle of one millisecond.
    angle = np.sqrt(np.sum(moved[:, :3, :3] ** 2, axis=(1, 2)) / 2.0)
    shares["hand_speed"] = float(np.max(np.linalg.norm(moved[:, :3, 3], axis=1))) / SAMPLE_TIME / allowed.hand
    shares["hand_angular_speed"] = float(np.max(angle)) / SAMPLE_TIME / allowed.turn
    needed = {name: share ** (1.0 / ORDER.get(name, 1)) for name, share in shares.items()}
    name = max(needed, key=lambda key: needed[key])
    return needed[name], name, shares[name]
