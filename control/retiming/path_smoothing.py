"""Smooth paths from waypoints, which retiming needs.

Waypoints from a motion search are a polyline: dense and slightly noisy, or coarse with corners. Both become a quintic
B-spline that starts and ends exactly where the polyline does and stays within a tolerance of it per joint:

* least squares on evenly spaced knots, with the fewest knots that keep the tolerance: smoothest for curved and noisy
  paths;
* the variation-diminishing spline of Schoenberg (control points = the polyline at the Greville abscissae) on knots
  that are halved where the tolerance is broken: rounds corners, reproduces straight pieces exactly, cannot overshoot
  (every point is a convex combination of points of the polyline) and so always exists inside the joint limits.
  Source: Marsden and Schoenberg, "On variation diminishing spline approximation methods", 1966.

The faster of the two is taken.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.signal import savgol_filter

from control.retiming.bounds import MotionBounds

DEGREE = 5
DENSE = 512  # points at which the polyline is fitted and compared
LEAST_SQUARES_KNOTS = (1, 2, 3, 4, 6, 8, 11, 15, 20, 27, 36, 48)
SAME_POINT = 1e-9  # [rad]; waypoints nearer than this are one
MAX_INTERVALS = 6000  # of the corner-rounding spline; a limit on memory, not a tuning parameter
MAX_GRADING = 2.5  # longest knot interval relative to its neighbour: keeps curvature even next to a corner


@dataclass(frozen=True)
class SmoothPath:
    """A smooth path q(s), 0 <= s <= length.

    Attributes:
        spline: Quintic, seven components in [rad].
        breaks: Distinct knots, shape (k,).
        deviation: Largest difference of a joint from the waypoints' polyline in [rad].
        waypoints: Which of the waypoints the path goes through or by, as rows of what was given, shape (m,).
        passed: Parameters at which it does, increasing, shape (m,).
        lengths: Length of the waypoints' polyline up to each of them in [rad], shape (m,).
    """

    spline: BSpline
    breaks: NDArray[np.float64]
    deviation: float
    waypoints: NDArray[np.int64]
    passed: NDArray[np.float64]
    lengths: NDArray[np.float64]

    @property
    def length(self) -> float:
        """End of the parameter."""
        return float(self.breaks[-1])

    def __call__(self, s: np.ndarray, order: int = 0) -> np.ndarray:
        """The path or a derivative with respect to s at parameters of shape (n,); returns shape (n, 7)."""
        return self.spline(s, nu=order)

    def rescaled(self, length: float) -> "SmoothPath":
        """The same path with another end of the parameter."""
        factor = length / self.length
        spline = BSpline(self.spline.t * factor, self.spline.c, self.spline.k)
        return replace(self, spline=spline, breaks=self.breaks * factor, passed=self.passed * factor)

    def place(self, s: float) -> str:
        """Where a parameter is, for people: the nearest waypoint and the share of the polyline up to there."""
        row = self.waypoints[int(np.argmin(np.abs(self.passed - s)))]
        share = float(np.interp(s, self.passed, self.lengths)) / float(self.lengths[-1])
        return f"at waypoint {row} ({100 * share:.0f} % of its length)"


def distinct_waypoints(q: np.ndarray) -> np.ndarray:
    """Rows of waypoints without repetitions, shape (m,), m >= 1; the last waypoint itself is always kept."""
    kept = [0]
    for k in range(1, len(q)):
        if np.max(np.abs(q[k] - q[kept[-1]])) > SAME_POINT:
            kept.append(k)
    if len(kept) > 1:
        kept[-1] = len(q) - 1
    return np.array(kept)


def smooth_path(
    waypoints: np.ndarray, tolerance: float, q_min: np.ndarray, q_max: np.ndarray, bounds: MotionBounds
) -> SmoothPath:
    """The smooth path through waypoints that can be traversed fastest.

    Args:
        waypoints: In [rad], shape (n, 7), inside the limits, two of them at least apart from each other.
        tolerance: Largest deviation of a joint from the polyline in [rad].
        q_min, q_max: Joint limits that the smooth path keeps as well, in [rad].
        bounds: Speed, acceleration and jerk of joints by which candidates are compared.

    Returns:
        A path whose parameter ends at its roughly estimated duration in [s], so that speeds along it are near one.
    """
    rows = distinct_waypoints(waypoints)
    q = waypoints[rows]
    u = _chord_parameter(q)
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(q, axis=0), axis=1))])
    found = [_least_squares(u, q, tolerance, q_min, q_max), _corner_rounding(u, q, tolerance)]
    candidates = [SmoothPath(f[0], f[1], f[2], rows, u, lengths) for f in found if f is not None]
    times = [_estimated_time(path, bounds) for path in candidates]
    best = int(np.argmin(times))
    return candidates[best].rescaled(max(times[best], 1e-3))


def _chord_parameter(q: np.ndarray) -> np.ndarray:
    """Distance along the waypoints from 0 to 1, shape (m,).

    Of a low-passed copy where there are many waypoints, because noise lengthens slow pieces of a path.
    """
    raw = np.linalg.norm(np.diff(q, axis=0), axis=1)
    steps = raw
    if len(q) >= 20:
        low = np.asarray(savgol_filter(q, 9, 3, axis=0))
        steps = np.maximum(np.linalg.norm(np.diff(low, axis=0), axis=1), 0.1 * raw)
    u = np.concatenate([[0.0], np.cumsum(steps)])
    return u / u[-1]


def _polyline(u: np.ndarray, q: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Points of the polyline at parameters `at`, shape (n, 7)."""
    k = np.clip(np.searchsorted(u, at, side="right") - 1, 0, len(u) - 2)
    f = ((at - u[k]) / (u[k + 1] - u[k]))[:, None]
    return q[k] * (1.0 - f) + q[k + 1] * f


def _clamped_knots(breaks: np.ndarray) -> np.ndarray:
    return np.concatenate([[breaks[0]] * DEGREE, breaks, [breaks[-1]] * DEGREE])


@lru_cache(maxsize=len(LEAST_SQUARES_KNOTS))
def _even_basis(intervals: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Knots, inner basis functions at DENSE even parameters, and the pseudo-inverse that fits them."""
    knots = _clamped_knots(np.linspace(0.0, 1.0, intervals + 1))
    basis = BSpline.design_matrix(np.linspace(0.0, 1.0, DENSE), knots, DEGREE).toarray()[:, 1:-1]
    return knots, basis, np.linalg.pinv(basis)


def _least_squares(
    u: np.ndarray, q: np.ndarray, tolerance: float, q_min: np.ndarray, q_max: np.ndarray
) -> tuple[BSpline, np.ndarray, float] | None:
    """Spline, breaks and deviation of the fit with the fewest even knots that keeps tolerance and limits, or None."""
    even = np.linspace(0.0, 1.0, DENSE)
    dense = _polyline(u, q, even)
    # The end points are held exactly: the first and last control points are taken out of the fit.
    ends = np.zeros((2, q.shape[1]))
    ends[0], ends[1] = q[0], q[-1]
    for intervals in LEAST_SQUARES_KNOTS:
        knots, basis, inverse = _even_basis(intervals)
        first = np.clip(1.0 - even * intervals, 0.0, None) ** DEGREE  # the first basis function of clamped knots
        target = dense - first[:, None] * ends[0] - first[::-1, None] * ends[1]
        inner = inverse @ target
        if np.max(np.abs(basis @ inner - target)) > tolerance:
            continue
        spline = BSpline(knots, np.vstack([ends[:1], inner, ends[1:]]), DEGREE)
        fitted = spline(np.concatenate([even, u]))
        deviation = float(np.max(np.abs(fitted - np.concatenate([dense, q]))))
        if deviation <= tolerance and np.all(fitted >= q_min) and np.all(fitted <= q_max):
            return spline, np.linspace(0.0, 1.0, intervals + 1), deviation
    return None


def _corner_rounding(u: np.ndarray, q: np.ndarray, tolerance: float) -> tuple[BSpline, np.ndarray, float]:
    """Schoenberg's spline on knots that are halved until the tolerance is kept, its breaks and its deviation."""
    breaks = np.linspace(0.0, 1.0, 5)
    while True:
        knots = _clamped_knots(breaks)
        greville = np.convolve(knots[1:-1], np.full(DEGREE, 1.0 / DEGREE), "valid")
        greville[0], greville[-1] = 0.0, 1.0  # rounding would put them outside
        control = _polyline(u, q, np.clip(greville, 0.0, 1.0))
        control[0], control[-1] = q[0], q[-1]
        spline = BSpline(knots, control, DEGREE)
        inside = np.linspace(0.0, 1.0, 6)[:-1]
        at = np.concatenate([(breaks[:-1, None] + np.diff(breaks)[:, None] * inside).ravel(), u])
        error = np.max(np.abs(spline(at) - _polyline(u, q, at)), axis=1)
        interval = np.clip(np.searchsorted(breaks, at, side="right") - 1, 0, len(breaks) - 2)
        worst = np.zeros(len(breaks) - 1)
        np.maximum.at(worst, interval, error)
        if worst.max() <= tolerance or len(breaks) > MAX_INTERVALS:
            return spline, breaks, float(worst.max())
        breaks = _split(breaks, worst > tolerance)


def _split(breaks: np.ndarray, split: np.ndarray) -> np.ndarray:
    """Halve the marked intervals, and others until none is much longer than its neighbour."""
    while np.any(split):
        middles = (breaks[:-1] + breaks[1:])[split] / 2
        breaks = np.sort(np.concatenate([breaks, middles]))
        widths = np.diff(breaks)
        neighbour = np.minimum(np.concatenate([[np.inf], widths[:-1]]), np.concatenate([widths[1:], [np.inf]]))
        split = widths > MAX_GRADING * neighbour
    return breaks


def _estimated_time(path: SmoothPath, bounds: MotionBounds) -> float:
    """Rough duration in [s]: at the speed that velocity limits and the path's curvature allow, plus acceleration."""
    s = np.unique(np.concatenate([np.linspace(0.0, 1.0, 200), (path.breaks[:-1] + path.breaks[1:]) / 2]))
    slowness = np.zeros(len(s))
    for order, limit in ((1, bounds.qd), (2, bounds.qdd), (3, bounds.qddd)):
        slowness = np.maximum(slowness, np.max(np.abs(path(s, order)) / limit, axis=1) ** (1.0 / order))
    cruise = float(np.sum((slowness[1:] + slowness[:-1]) / 2 * np.diff(s)))
    reach = np.ptp(path.spline.c, axis=0)
    return max(cruise, 2.0 * float(np.sqrt(np.max(reach / bounds.qdd))))
