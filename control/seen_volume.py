"""Space that cameras have looked into, as motion search and verdict read it. Needs numpy only."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

UnseenPolicy = Literal["allow", "avoid", "refuse"]

# States of a voxel. Things stand on something: where space is seen to be free, nothing that stands can be above it.
CLEAR, OVERHEAD, HIDDEN, FILLED = 0, 1, 2, 3


@dataclass(frozen=True)
class SeenVolume:
    """A box of the world in voxels. Space outside of it is hidden at its sides, and overhead above it.

    Attributes:
        low: Lowest corner of the box in the world in [m], shape (3,).
        step: Side of a voxel in [m].
        state: int8, shape (nx, ny, nz), index along the world's x, y and z. `CLEAR`: seen to be free. `FILLED`: a
            surface was seen there, or something is known to stand there. `OVERHEAD`: not seen, above space that was
            seen to be free, so that only what hangs or floats can be there. `HIDDEN`: not seen, and something that
            stands could be there.
    """

    low: NDArray[np.float64]
    step: float
    state: NDArray[np.int8]

    @cached_property
    def _around(self) -> NDArray[np.int8]:
        """The states with one voxel more on every side, in one row."""
        around = np.pad(self.state, 1, constant_values=HIDDEN)
        around[:, :, -1] = OVERHEAD
        around[:, :, 0] = FILLED  # below the box is what carries everything
        return np.ascontiguousarray(around).reshape(-1)

    @property
    def _counts(self) -> tuple[int, int, int]:
        nx, ny, nz = self.state.shape
        return nx + 2, ny + 2, nz + 2

    @property
    def voxels(self) -> int:
        """How many there are, those around the box included."""
        return len(self._around)

    def index(self, points: np.ndarray) -> NDArray[np.int32]:
        """Number of the voxel that each point lies in, or of the nearest one around the box; shape (n,).

        Args:
            points: In the world in [m], shape (3, n).
        """
        out = np.zeros(points.shape[1], np.int32)
        for axis, count in enumerate(self._counts):
            row = (points[axis] - self.low[axis]) * (1.0 / self.step) + 1.0
            out *= count
            out += np.clip(row, 0, count - 1).astype(np.int32)
        return out

    def states(self, index: np.ndarray) -> NDArray[np.int8]:
        """States of voxels by their numbers, shape (n,)."""
        return self._around[index]

    def grid(self, index: np.ndarray) -> NDArray[np.bool_]:
        """Which voxels are among some numbers, one more on each side of the box.

        Returns:
            bool, shape (nx + 2, ny + 2, nz + 2).
        """
        out = np.zeros(self.voxels, bool)
        out[index] = True
        return out.reshape(self._counts)

    def middles(self, index: np.ndarray) -> NDArray[np.float64]:
        """Middles of voxels in the world in [m] by their numbers, shape (n, 3)."""
        cells = np.stack(np.unravel_index(index, self._counts), axis=-1)
        return self.corner(cells) + self.step / 2

    def corner(self, cell: np.ndarray) -> NDArray[np.float64]:
        """Lowest corner in the world in [m] of voxels of `grid`, (..., 3), shape (..., 3)."""
        return self.low + self.step * (np.asarray(cell, float) - 1.0)
