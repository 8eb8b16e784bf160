"""Timing one segment of a path, from rest to rest.

In this order:

1. a smooth path within a tolerance of the waypoints (`control.retiming.path_smoothing`);
2. the TOPP-RA profile, without limits on jerk and torque rate (`control.retiming.path_dynamics`), smoothed into an
   initial guess (`control.retiming.initial_guess`);
3. the shortest timing under all limits (`control.retiming.constraints`, `control.retiming.interior_point`), twice: the
   first result is the initial guess of the second, on finer cells;
4. every millisecond is checked by finite differences, with the rigid-body model where 3 came near a limit that needs
   it; where limits are broken between the points that 3 checks, they are tightened and 3 is repeated;
5. if anything is still broken, the timing is stretched uniformly. Velocity falls with the stretch, acceleration with
   its square, jerk with its cube, and what remains of torque is gravity; so this step ends. The last check evaluates
   the rigid-body model at every millisecond.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, maximum_filter1d

from control.errors import RetimingError
from control.retiming.bounds import MotionBounds
from control.retiming.constraints import AT_NODES, IN_CELLS, RowBlock, row_blocks
from control.retiming.initial_guess import InitialGuess, cell_times, initial_guess
from control.retiming.interior_point import GAP, PathTiming, minimise_duration, peak_utilisation
from control.retiming.limit_utilisation import ORDER, PADDING, limit_utilisation
from control.retiming.path_dynamics import PathDynamics
from control.retiming.path_smoothing import SmoothPath, smooth_path
from control.retiming.toppra_profile import ToppraProfile
from control.robot.dynamics import RobotModel
from control.robot.limits import RobotLimits
from control.safety.limits import SafetyLimits
from control.trajectory.samples import SAMPLE_TIME, PathSegment

MAX_STRETCH = 100.0
TIGHTENED = 3  # times that limits are tightened at most
GOOD_ENOUGH, GOOD_ENOUGH_AGAIN = 1.002, 1.005  # a uniform stretch smaller than this is not worth tightening limits
COARSE, FINE = 100, 500  # cells of the first and second initial guess, at most unless the path has many pieces
FINEST = 2.5e-3  # [s]; cells need not be shorter
LONGEST = 0.01  # [s]; nor should they be longer in the second
COARSE_PER_PIECE, FINE_PER_PIECE = 2, 4  # cells for each piece of the path, so that none is missed
CLOSELY = 0.5
SHORT_RAMP = 0.004  # [s]
MOST_CELLS = 2000  # a limit on memory
COARSE_GAP = 0.02  # duality gap with which the first result is good enough to start the second
TIGHTENED_BARRIER = 0.01  # for `minimise_duration`, when limits were tightened a little
START_UTILISATION = 0.9  # largest squared utilisation of a limit that the search starts with
USED = 0.3  # the second result leaves out groups of rows with a smaller peak of squared utilisation in the first
USED_AGAIN = 0.5  # the same when limits are tightened, as little changes then
NEAR = 0.5  # squared utilisation of a limit in a row from which the model is evaluated at the samples around it
OVERDONE = 1.005  # by how much more than needed limits are tightened
OVERSHOOT, MOST_OVERSHOOT = 0.5, 0.02  # and more by this share of what was needed, up to so much
LEAST_STRETCH = 1.0005  # of uniform stretches, the first


@dataclass(frozen=True)
class RetimingOptions:
    """How to retime.

    Attributes:
        tolerance: Largest deviation of a joint from the waypoints' polyline in [rad]; 4 mrad of one joint move the
            hand of a stretched Panda by less than 4 mm.
        grasp_dwell: Time that the arm rests for a grasp in [s]; longer where the gripper needs it for its whole stroke.
        move_dwell: Time that it rests for opening or closing to a width in [s]; as for a grasp.
        grid: Grid intervals of the timing without limits on jerk along a segment, at least.
    """

    tolerance: float = 0.004
    grasp_dwell: float = 0.8
    move_dwell: float = 0.5
    grid: int = 240


@dataclass(frozen=True)
class SegmentReport:
    """How one segment was timed.

    Attributes:
        name: Of the path segment.
        duration: From rest to rest in [s], without dwell.
        bound: Shortest duration of the same smooth path with unbounded jerk and torque rate, in [s].
        deviation: Largest difference of a joint from the waypoints' polyline in [rad].
        stretch: Uniform stretch that was needed at last, 1 = none.
    """

    name: str
    duration: float
    bound: float
    deviation: float
    stretch: float


def time_segment(
    segment: PathSegment,
    robot: RobotModel,
    limits: RobotLimits,
    safety: SafetyLimits,
    options: RetimingOptions,
) -> tuple[np.ndarray, SegmentReport]:
    """Samples from rest to rest.

    Args:
        segment: Name, speed_scale and waypoints in [rad], shape (m, 7), within the joint limits, two of them at least
            apart from each other.
        robot: Rigid-body model, with whatever the hand holds.
        limits: Published limits.
        safety: Shares of them that may be used, and the hand's speeds.
        options: Tolerance and tuning.

    Returns:
        Joint positions every millisecond in [rad], shape (n, 7), beginning one millisecond after the arm rested at
        the first waypoint and ending with two equal samples at the last one; and a report.

    Raises:
        RetimingError: No timing keeps the limits; names the segment, the place and the limit.
    """
    try:
        return _timed(segment, robot, limits, safety, options)
    except RetimingError as error:
        raise RetimingError(f"segment '{segment.name}' {error}") from error


def shortest_time(
    segment: PathSegment, robot: RobotModel, limits: RobotLimits, safety: SafetyLimits, options: RetimingOptions
) -> float:
    """Shortest duration in [s] of the smooth path of a segment with unbounded jerk and torque rate.

    Arguments and errors as for `time_segment`; `options.grid` is how finely the path is looked at.
    """
    path, bounds = _smoothed(segment, limits, safety, options)
    return PathDynamics(path, robot, bounds, options.grid).fastest_profile().duration


def _smoothed(
    segment: PathSegment, limits: RobotLimits, safety: SafetyLimits, options: RetimingOptions
) -> tuple[SmoothPath, MotionBounds]:
    bounds = MotionBounds.of(limits, safety, segment.speed_scale)
    q_min, q_max = limits.q_min + safety.joint_margin, limits.q_max - safety.joint_margin
    return smooth_path(segment.q, options.tolerance, q_min, q_max, bounds), bounds


def _timed(
    segment: PathSegment, robot: RobotModel, limits: RobotLimits, safety: SafetyLimits, options: RetimingOptions
) -> tuple[np.ndarray, SegmentReport]:
    path, bounds = _smoothed(segment, limits, safety, options)
    dynamics = PathDynamics(path, robot, bounds, options.grid)
    dynamics.check()
    profile = dynamics.fastest_profile()  # what the report compares with: without jerk, and without headroom
    bounds = bounds.with_headroom()
    search = _TimingSearch(path, robot, bounds)
    timing = search.first(profile)

    def sampled(timing: PathTiming, stretch: float, near: _Near | None) -> _Samples:
        return _Samples.of(timing, stretch, near, segment.q, path, robot, bounds)

    seen: list[tuple[PathTiming, _Samples]] = []  # with the model asked for every sample
    for k in range(TIGHTENED + 1):
        samples = sampled(timing, 1.0, search.near(timing))
        # The last tightening must not overlook anything; nor may what is good enough otherwise.
        good = samples.needed <= (GOOD_ENOUGH if k == 0 else GOOD_ENOUGH_AGAIN)
        if good or k >= TIGHTENED - 1:
            samples = sampled(timing, _small_stretch(samples.needed) if good else 1.0, None)
            seen.append((timing, samples))
            if samples.needed <= GOOD_ENOUGH:
                break
        other = search.tightened(timing, samples) if k < TIGHTENED else None
        if other is None:
            break
        timing = other
    if not seen:
        seen.append((timing, sampled(timing, 1.0, None)))
    timing, samples = min(seen, key=_stretched_duration)
    least = LEAST_STRETCH
    while samples.needed > 1.0:
        stretch = samples.stretch * _small_stretch(samples.needed, least)
        least = 2.0 * least - 1.0  # a peak may hide between samples: steps as small as the first could go on for long
        if stretch > MAX_STRETCH:
            name, used, s = samples.worst
            raise RetimingError(_no_timing(name, used, path.place(s)))
        samples = sampled(timing, stretch, None)
    duration = (len(samples.q) - 1) * SAMPLE_TIME
    return samples.q[1:], SegmentReport(segment.name, duration, profile.duration, path.deviation, samples.stretch)


def _small_stretch(needed: float, least: float = LEAST_STRETCH) -> float:
    """By how much to stretch next when so much seems to be needed; 1 when nothing is."""
    return 1.0 if needed <= 1.0 else min(1.25, max(least, needed))


def _no_timing(name: str, used: float, place: str) -> str:
    return (
        f"has no timing that keeps {name} {place}: even {MAX_STRETCH:.0f} times slower than the fastest it reaches "
        f"{100 * used:.1f} % of the limit. Take another path"
    )


def _stretched_duration(found: "tuple[PathTiming, _Samples]") -> float:
    timing, samples = found
    return timing.duration * samples.stretch * max(samples.needed, 1.0)


def _named(limit: str, joint: int | None) -> str:
    return limit if joint is None else f"{limit} of joint {joint + 1}"


@dataclass(frozen=True)
class _Near:
    """Cells of an initial guess in which torques, and the hand, come near their limits: masks of shape (cells,)."""

    torque: NDArray[np.bool_]
    hand: NDArray[np.bool_]


class _TimingSearch:
    """Finds the shortest timing along one path; keeps the rows of the last one for tightening."""

    def __init__(self, path: SmoothPath, robot: RobotModel, bounds: MotionBounds) -> None:
        self._path, self._robot, self._bounds = path, robot, bounds
        self._blocks: tuple[RowBlock, ...] = ()

    def first(self, profile: ToppraProfile) -> PathTiming:
        """The fastest timing, in two rounds.

        Raises:
            RetimingError: The limits are broken at any speed; names the place.
        """
        pieces = len(self._path.breaks) - 1
        cells = _cells(profile.duration, max(COARSE, COARSE_PER_PIECE * pieces))
        coarse = self._round(profile.at, profile.duration, cells, None)
        keep = self._relevant(coarse.beta, USED)
        cells = _cells(coarse.duration, max(FINE, FINE_PER_PIECE * pieces, int(coarse.duration / LONGEST)))
        return self._round(coarse.progress, coarse.duration, cells, keep)

    def _round(
        self, progress: Callable[[np.ndarray], np.ndarray], duration: float, cells: int, keep: list[np.ndarray] | None
    ) -> PathTiming:
        ramp = float(np.max(self._bounds.qdd / self._bounds.qddd))
        times = cell_times(progress, duration, cells, self._path.breaks, CLOSELY * min(1.0, SHORT_RAMP / ramp))
        start, squared_speed = initial_guess(progress, times)
        self._blocks = row_blocks(self._path, start, self._robot, self._bounds)
        beta = self._slowed(start, squared_speed)
        if keep is None:
            return PathTiming(start, minimise_duration(self._blocks, start.cell, beta, COARSE_GAP))
        return PathTiming(start, minimise_duration(self._only(keep), start.cell, beta, GAP))

    def _relevant(self, beta: np.ndarray, least: float) -> list[np.ndarray]:
        """Masks of the groups of each block whose largest squared utilisation at a timing is above the least."""
        masks = [block.used(beta).max(axis=1) > least for block in self._blocks]
        masks[0][:2] = True  # speeds
        return masks

    def _only(self, keep: list[np.ndarray]) -> list[RowBlock]:
        """The blocks with some groups only, without those of which none is kept."""
        return [block.kept(groups) for block, groups in zip(self._blocks, keep, strict=True) if np.any(groups)]

    def _slowed(self, start: InitialGuess, beta: np.ndarray) -> np.ndarray:
        """Coefficients slowed down until they are within all limits."""
        slowest = beta / MAX_STRETCH**2
        rest = peak_utilisation(self._blocks[:1], 1e-12 * beta)  # what gravity takes
        enough = max(START_UTILISATION, 0.5 * (1.0 + rest))
        while peak_utilisation(self._blocks, beta) > enough:
            beta = 0.8 * beta
            if beta[0] < slowest[0]:
                raise RetimingError(self._infeasible(start, beta))
        return beta

    def _infeasible(self, start: InitialGuess, beta: np.ndarray) -> str:
        """Name and place of the limit that is broken even at the slowest timing."""
        worst, name, cell = 0.0, "", 0
        for block, groups in zip(self._blocks, (AT_NODES, IN_CELLS), strict=True):
            used = block.used(beta)
            group, point = np.unravel_index(int(np.argmax(used)), used.shape)
            if used[group, point] > worst:
                worst, name, cell = float(used[group, point]), _named(*groups[group]), int(point) % block.places
        s = float(start(np.array([(cell + 0.5) * start.cell]))[0])
        return _no_timing(name, float(np.sqrt(worst)), self._path.place(s))

    def near(self, timing: PathTiming) -> _Near:
        """Where the rows at a timing come near the limits that need the rigid-body model.

        The hand's speeds are left out: an arm may go at them all the way, and they change little between nodes.
        """
        nodes, cells = (block.used(timing.beta) > NEAR for block in self._blocks)
        masks = []
        for names in (("torque", "torque_rate"), ("hand_acceleration", "hand_angular", "hand_jerk")):
            at_node, in_cell = (
                np.any(used[[name.startswith(names) for name, _ in groups]], axis=0)
                for used, groups in ((nodes, AT_NODES), (cells, IN_CELLS))
            )
            ends = at_node[:-1] | at_node[1:] | in_cell[: timing.start.cells] | in_cell[timing.start.cells :]
            masks.append(binary_dilation(ends))
        return _Near(masks[0], masks[1])

    def tightened(self, timing: PathTiming, samples: "_Samples") -> PathTiming | None:
        """The fastest timing with limits tightened where samples break them; None where that leaves no room."""
        start = timing.start
        cells = start.cells_at(samples.parameter)
        at_nodes, in_cells = samples.by_group()
        blocks, keep = [], self._relevant(timing.beta, USED_AGAIN)
        for block, utilisation, groups in zip(self._blocks, (at_nodes, in_cells), keep, strict=True):
            groups |= utilisation.max(axis=0) > 1.0
            wanted = OVERDONE * utilisation + np.clip(OVERSHOOT * (utilisation - 1.0), 0.0, MOST_OVERSHOOT)
            factor = np.ones((start.cells, utilisation.shape[1]))
            np.maximum.at(factor, cells, np.where(utilisation > 1.0, wanted, 1.0))
            factor = maximum_filter1d(factor, 3, axis=0)
            if block is self._blocks[0]:  # a node belongs to the cells on either side
                factor = np.maximum(np.concatenate([factor[:1], factor]), np.concatenate([factor, factor[-1:]]))
            else:
                factor = np.concatenate([factor, factor])
            blocks.append(replace(block, tight=block.tight * factor.T**2))
        self._blocks = tuple(blocks)
        kept, beta = self._only(keep), timing.beta
        for _ in range(20):
            if peak_utilisation(kept, beta) <= START_UTILISATION:
                return PathTiming(start, minimise_duration(kept, start.cell, beta, GAP, TIGHTENED_BARRIER))
            beta = 0.9 * beta
        return None


def _cells(duration: float, most: int) -> int:
    return int(np.clip(np.ceil(duration / FINEST), 2, min(most, MOST_CELLS)))


@dataclass(frozen=True)
class _Samples:
    """Samples of a timing and their utilisation of each limit.

    Attributes:
        q: Every millisecond in [rad], shape (n, 7), at rest in the first and in the last two.
        parameter: Of the initial guess where the middle of each difference lies, in [s], shape (n + 2 PADDING,).
        s: Progress along the path there, of the same shape.
        utilisation: As `limit_utilisation` gives them.
        stretch: Of the timing, 1 = none.
        all_seen: Whether the rigid-body model was asked for every sample.
    """

    q: NDArray[np.float64]
    parameter: NDArray[np.float64]
    s: NDArray[np.float64]
    utilisation: dict[str, np.ndarray]
    stretch: float
    all_seen: bool

    @classmethod
    def of(
        cls,
        timing: PathTiming,
        stretch: float,
        near: _Near | None,
        waypoints: np.ndarray,
        path: SmoothPath,
        robot: RobotModel,
        bounds: MotionBounds,
    ) -> "_Samples":
        steps = int(np.ceil(timing.duration * stretch / SAMPLE_TIME))
        parameter = timing.parameter(np.arange(steps + 1) * (SAMPLE_TIME / stretch))
        s = timing.start(parameter)
        q = path(s)
        q[0], q[-1] = waypoints[0], waypoints[-1]
        q = np.concatenate([q[:1], q, q[-1:]])  # one sample of rest makes the joins exact
        # A second or third difference is of one or one and a half milliseconds earlier.
        rows = np.clip(np.arange(-PADDING, len(q) + PADDING) - 2, 0, steps)
        look = None
        if near is not None:
            cells = timing.start.cells_at(parameter[rows])
            look = near.torque[cells], near.hand[cells]
        return cls(q, parameter[rows], s[rows], limit_utilisation(q, robot, bounds, look), stretch, look is None)

    def by_group(self) -> tuple[np.ndarray, np.ndarray]:
        """Utilisation in the order of `AT_NODES` and of `IN_CELLS`, each (n + 2 PADDING, groups)."""
        x = self.utilisation
        # Utilisation of speed counts with the square, as the rows bound the square.
        joints = np.max(x["joint_velocity"], axis=1) ** 2
        hand = np.maximum(x["hand_speed"], x["hand_angular_speed"])[:, 0] ** 2
        nodes = ("joint_acceleration", "torque", "hand_acceleration", "hand_angular_acceleration")
        cells = ("joint_jerk", "torque_rate", "hand_jerk", "hand_angular_jerk")
        return np.hstack([joints[:, None], hand[:, None], *(x[n] for n in nodes)]), np.hstack([x[n] for n in cells])

    @property
    def needed(self) -> float:
        """Uniform stretch that the samples seem to need; 1 or less where all limits are kept."""
        return max(float(used.max()) ** (1.0 / ORDER[name]) for name, used in self.utilisation.items())

    @property
    def worst(self) -> tuple[str, float, float]:
        """The limit that asks for it, with its joint, its utilisation, and the progress where that is."""
        name = max(self.utilisation, key=lambda n: float(self.utilisation[n].max()) ** (1.0 / ORDER[n]))
        used = self.utilisation[name]
        row, joint = np.unravel_index(int(np.argmax(used)), used.shape)
        label = _named(name, int(joint) if used.shape[1] > 1 else None)
        return label, float(used[row, joint]), float(self.s[row])
