"""The TOPP-RA profile: the fastest timing of a path within bounds on speed, acceleration and torque, by toppra.

Along a path q(s) everything bounded is linear in u = s'' and x = s'^2:

    q'(s) u + q''(s) x            within the joint accelerations
    m(s) u + c(s) x + g(s)        within the joint torques
    x <= cap(s)                   from joint, hand and angular speeds

TOPP-RA finds the largest x at each grid point from which the end can be reached at rest by a backward pass, and
accelerates as hard as it may below them in a forward pass. Source: Pham and Pham, "A New Approach to Time-Optimal Path
Parameterization Based on Reachability Analysis", 2018. Bounds hold at both ends of every grid interval.

toppra's linear programmes compare with absolute tolerances of 1e-8 to 1e-10. They are therefore given the problem
without units: a path of length one, rows relative to their bounds, x relative to what the path can reach. With units
it fails for a move of 1e-7 rad. The library is imported when first used, as it takes a plotting library along.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from control.errors import RetimingError

LARGE_SPEED = 1e6  # squared speed cap where nothing moves
SMALL = 1e-12


@dataclass(frozen=True)
class PathBounds:
    """Bounds along a path.

    Attributes:
        s: Grid, increasing, shape (n,).
        a, b: Coefficients of u and x, shape (n, r).
        low, high: Bounds of a u + b x, shape (n, r), low <= 0 <= high and low < high: resting is allowed everywhere.
        cap: Largest x, shape (n,), above 0.
    """

    s: NDArray[np.float64]
    a: NDArray[np.float64]
    b: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    cap: NDArray[np.float64]


@dataclass(frozen=True)
class ToppraProfile:
    """Progress along a path from rest to rest; s'' is constant within each grid interval.

    Attributes:
        s: Grid, shape (n,).
        t: Times at which it is passed in [s], shape (n,).
        speed: s' at the grid, shape (n,).
    """

    s: NDArray[np.float64]
    t: NDArray[np.float64]
    speed: NDArray[np.float64]

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


def fastest_profile(bounds: PathBounds) -> ToppraProfile:
    """The time-optimal profile on the grid; see the module's description.

    Raises:
        RetimingError: There is none, or the solver does not find it; the caller knows which segment it was for.
    """
    import toppra
    from toppra.algorithm import TOPPRA
    from toppra.constraint import LinearConstraint, canlinear_colloc_to_interpolate

    length = bounds.s[-1] - bounds.s[0]
    size = np.maximum(-bounds.low, bounds.high)
    # What full acceleration over the whole length would reach, unless the caps are lower.
    reach = length / max(float(np.mean(np.max(np.abs(bounds.a) / size, axis=1))), SMALL)
    top = min(float(bounds.cap.max()), reach)
    a, b = bounds.a / size * (top / length), bounds.b / size * top
    low, high = bounds.low / size, bounds.high / size
    grid = (bounds.s - bounds.s[0]) / length

    class Rows(LinearConstraint):
        """a u + b x - high <= 0 and -a u - b x + low <= 0, the same at the next grid point, and 0 <= x <= cap."""

        def __init__(self) -> None:
            super().__init__()
            self.identical = True  # the rows are taken as they are, F = 1, at every grid point

        def compute_constraint_params(self, path, gridpoints, *args, **kwargs):
            rows = np.hstack([a, -a]), np.hstack([b, -b]), np.hstack([-high, low])
            count = rows[0].shape[1]
            ends = canlinear_colloc_to_interpolate(
                *rows, np.eye(count), np.zeros(count), None, None, gridpoints, identical=True
            )
            cap = np.stack([np.zeros_like(bounds.cap), bounds.cap / top], axis=1)
            return *ends[:5], None, cap

    line = toppra.PolynomialPath([0.0, 1.0], 0.0, 1.0)  # the rows say all about the path
    solver = TOPPRA([Rows()], line, gridpoints=grid, solver_wrapper="seidel")
    speed = solver.compute_parameterization(0.0, 0.0)[1]
    if speed is None or not np.all(np.isfinite(speed)):
        code = solver.problem_data.return_code.name
        raise RetimingError(
            f"has no TOPP-RA profile on {len(grid)} grid points ({code}); resting must be allowed everywhere, take "
            "another path or one with wider corners"
        )
    speed = speed * np.sqrt(top)
    mean = (speed[1:] + speed[:-1]) / 2
    t = np.concatenate([[0.0], np.cumsum(np.diff(bounds.s) / np.maximum(mean, SMALL))])
    return ToppraProfile(bounds.s, t, speed)
