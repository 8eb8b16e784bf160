"""The initial guess of a path's timing: any timing, smoothed until its jerk is bounded and it starts from rest."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.ndimage import gaussian_filter1d

NEGLIGIBLE = 0.12  # way of a coefficient relative to the next one's that counts as none
GRADUAL = 3.0  # cells over which their length is averaged


@dataclass(frozen=True)
class InitialGuess:
    """Progress s(p) along a path for 0 <= p <= n cells, a cubic spline that rests at both ends.

    Its coefficients are samples of a timing: such a spline is monotonic when they are (Marsden and Schoenberg,
    1966), keeps to their range, and jerks by steps from cell to cell.

    Attributes:
        coefficients: Progress, not decreasing, shape (n + 3,): three equal ones at either end.
        cell: Length of a cell in [s].
    """

    coefficients: NDArray[np.float64]
    cell: float

    @property
    def cells(self) -> int:
        """Number of cells."""
        return len(self.coefficients) - 3

    def cells_at(self, p: np.ndarray) -> np.ndarray:
        """Which cell p in [s] is in, shape (k,)."""
        return np.clip((p / self.cell).astype(int), 0, self.cells - 1)

    def at_nodes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Progress and its first two derivatives at the nodes, shape (n + 1,), and the third in cells, shape (n,)."""
        before, here, after = self.coefficients[:-2], self.coefficients[1:-1], self.coefficients[2:]
        s = (before + 4.0 * here + after) / 6.0
        second = (before - 2.0 * here + after) / self.cell**2
        return s, (after - before) / (2.0 * self.cell), second, np.diff(second) / self.cell

    def __call__(self, p: np.ndarray) -> np.ndarray:
        """Progress at p in [s], shape (k,)."""
        knots = np.arange(-3, len(self.coefficients) + 1) * self.cell
        s = BSpline(knots, self.coefficients, 3)(np.clip(p, 0.0, self.cells * self.cell))
        return np.clip(s, self.coefficients[0], self.coefficients[-1])  # rounding must not leave the path


def cell_times(
    progress: Callable[[np.ndarray], np.ndarray], duration: float, cells: int, breaks: np.ndarray, closely: float
) -> np.ndarray:
    """Times for `initial_guess` that lie close together on short pieces of a path.

    Args:
        progress: Times in [s] to progress along the path, as for `initial_guess`.
        duration: Of the timing in [s].
        cells: How many cells.
        breaks: Progress at which pieces of the path end, increasing, from the start of the path to its end.
        closely: Share of the cells that is dealt out by pieces instead of by time, 0..1.

    Returns:
        Times from 0 to the duration, shape (cells + 1,); the length of cells changes gradually.
    """
    dense = np.linspace(0.0, duration, 4 * cells + 1)
    passed = np.interp(progress(dense), breaks, np.linspace(0.0, 1.0, len(breaks)))
    portion = (1.0 - closely) * dense / duration + closely * passed / passed[-1]
    times = np.interp(np.linspace(0.0, 1.0, cells + 1), portion, dense)
    lengths = np.exp(gaussian_filter1d(np.log(np.diff(times)), GRADUAL, mode="nearest"))
    return np.concatenate([[0.0], np.cumsum(lengths)]) * (duration / np.sum(lengths))


def initial_guess(progress: Callable[[np.ndarray], np.ndarray], times: np.ndarray) -> tuple[InitialGuess, np.ndarray]:
    """Make an initial guess from a timing.

    Args:
        progress: Times in [s] of shape (k,) to progress of shape (k,), from rest to rest.
        times: Between rest and rest in [s], increasing, shape (c + 1,), c >= 2. Cells are even, so where these lie
            closer together the initial guess is slower than the timing.

    Returns:
        The initial guess, and coefficients of the squared parameter speed (see `control.retiming.constraints`) at which
        it is about as fast as the timing, shape (cells + 2,).
    """
    s = progress(times)
    padded = np.pad(s, 3, mode="edge")
    # Less a sixth of the second difference, cubics are reproduced: so a start at full jerk stays one.
    coefficients = padded.copy()
    coefficients[1:-1] -= np.diff(padded, n=2) / 6.0
    coefficients = np.maximum.accumulate(np.clip(coefficients, s[0], s[-1]))
    even = float(times[-1]) / (len(times) - 1)
    squared_speed = np.pad(
        (even / np.diff(times)) ** 2, 3, mode="edge"
    )  # of the cell after each coefficient, the first left out
    first, last = _moving(coefficients), len(coefficients) - 1 - _moving(s[-1] + s[0] - coefficients[::-1])
    kept = np.concatenate([[s[0]] * 3, coefficients[first : last + 1], [s[-1]] * 3])
    return InitialGuess(kept, even), squared_speed[first - 3 : last + 3]


def _moving(coefficients: np.ndarray) -> int:
    """Index of the first coefficient that is not at the start any more, as good as."""
    gone = coefficients - coefficients[0]
    return int(np.argmax(gone[:-1] > NEGLIGIBLE * gone[1:]))
