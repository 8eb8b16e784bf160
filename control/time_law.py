"""The fastest time law along a path under bounds on speed, acceleration and torque (TOPP-RA).

Along a path q(s) everything bounded is linear in u = s'' and x = s'^2:

    q'(s) u + q''(s) x            within the joint accelerations
    m(s) u + c(s) x + g(s)        within the joint torques
    x <= cap(s)                   from joint, hand and angular speeds

A backward pass finds the largest x at each grid point from which the end can be reached at rest, a forward pass then
accelerates as hard as it may below them. Source: Pham and Pham, "A New Approach to Time-Optimal Path Parameterization
Based on Reachability Analysis", 2018. Here standing still (u = x = 0) is always allowed, so the reachable sets are
[0, K] and the linear programmes in two variables have closed forms. Bounds hold at both ends of every grid interval.
"""

from dataclasses import dataclass

import numpy as np

LARGE_SPEED = 1e6  # squared speed cap where nothing moves
SMALL = 1e-12


@dataclass(frozen=True)
class PathBounds:
    """Bounds along a path.

    Attributes:
        s: Grid, shape (n,).
        a, b: Coefficients of u and x, shape (n, r).
        low, high: Bounds of a u + b x, shape (n, r), low <= 0 <= high.
        cap: Largest x, shape (n,).
    """

    s: np.ndarray
    a: np.ndarray
    b: np.ndarray
    low: np.ndarray
    high: np.ndarray
    cap: np.ndarray


@dataclass(frozen=True)
class TimeLaw:
    """Progress along a path from rest to rest; s'' is constant within each grid interval.

    Attributes:
        s: Grid, shape (n,).
        t: Times at which it is passed in [s], shape (n,).
        speed: s' at the grid, shape (n,).
    """

    s: np.ndarray
    t: np.ndarray
    speed: np.ndarray

    @property
    def duration(self) -> float:
        """Time from start to end in [s]."""
        return float(self.t[-1])

    def at(self, t: np.ndarray) -> np.ndarray:
        """Progress s at times in [s], shape (m,)."""
        k = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.s) - 2)
        within = np.clip(t - self.t[k], 0.0, self.t[k + 1] - self.t[k])
        step = self.t[k + 1] - self.t[k]
        acceleration = (self.speed[k + 1] - self.speed[k]) / np.maximum(step, SMALL)
        return np.minimum(self.s[k] + self.speed[k] * within + 0.5 * acceleration * within**2, self.s[-1])


def fastest_time_law(bounds: PathBounds) -> TimeLaw:
    """The time-optimal law on the grid; see the module's description."""
    s, delta = bounds.s, np.diff(bounds.s)
    # Every row as  low <= u + ratio x <= high  after division by its (made positive) coefficient of u.
    ratio, low, high = _normalised_rows(bounds, delta)
    limit = np.minimum(bounds.cap[:-1], _largest_speed(ratio, low, high, delta))
    n = len(s)
    inverse = 1.0 / (2.0 * delta)
    reach = np.zeros(n)
    for k in range(n - 2, -1, -1):
        # u <= (reach[k + 1] - x) / (2 delta) must leave room above every lower bound  u >= low - ratio x.
        room = inverse[k] - ratio[k]
        binding = room > 0
        x = (reach[k + 1] * inverse[k] - low[k][binding]) / room[binding]
        reach[k] = min(limit[k], x.min()) if x.size else limit[k]
    x = np.zeros(n)
    for k in range(n - 1):
        u = np.min(high[k] - ratio[k] * x[k])
        x[k + 1] = min(max(x[k] + 2.0 * delta[k] * u, 0.0), reach[k + 1])
    speed = np.sqrt(x)
    mean = (speed[1:] + speed[:-1]) / 2
    t = np.concatenate([[0.0], np.cumsum(delta / np.maximum(mean, SMALL))])
    return TimeLaw(s, t, speed)


def _normalised_rows(bounds: PathBounds, delta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows of each interval at its start and, through x_next = x + 2 delta u, at its end; shapes (n - 1, 2 r)."""
    b_next = bounds.b[1:]
    a = np.concatenate([bounds.a[:-1], bounds.a[1:] + 2.0 * delta[:, None] * b_next], axis=1)
    b = np.concatenate([bounds.b[:-1], b_next], axis=1)
    low = np.concatenate([bounds.low[:-1], bounds.low[1:]], axis=1)
    high = np.concatenate([bounds.high[:-1], bounds.high[1:]], axis=1)
    flip = a < 0
    a, b = np.where(flip, -a, a), np.where(flip, -b, b)
    low, high = np.where(flip, -high, low), np.where(flip, -low, high)
    a = np.maximum(a, SMALL)
    return b / a, low / a, high / a


def _largest_speed(ratio: np.ndarray, low: np.ndarray, high: np.ndarray, delta: np.ndarray) -> np.ndarray:
    """Largest x for which some u >= -x / (2 delta) satisfies all rows of an interval, shape (n - 1,).

    A lower row l and an upper row h leave room while  x (ratio_h - ratio_l) <= high_h - low_l.
    """
    stop = 1.0 / (2.0 * delta)[:, None]
    ratio_low = np.concatenate([ratio, stop], axis=1)  # the last one: x_next must not become negative
    low = np.concatenate([low, np.zeros_like(stop)], axis=1)
    slope = ratio[:, :, None] - ratio_low[:, None, :]
    room = high[:, :, None] - low[:, None, :]
    with np.errstate(divide="ignore", invalid="ignore"):
        x = np.where(slope > SMALL, room / slope, np.inf)
    return np.minimum(x.min(axis=(1, 2)), LARGE_SPEED)
