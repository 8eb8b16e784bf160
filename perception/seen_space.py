"""Which space the cameras have seen to be free, and which nobody has seen: a grid of voxels. Needs numpy only."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from perception.errors import FrameError

UNSEEN, FREE, OCCUPIED = 0, 1, 2  # states of a voxel
STEP = 0.02  # [m]: a side of a voxel


@dataclass(frozen=True)
class SeenSpace:
    """A box of the world in voxels, each of them not seen, seen to be free, or filled.

    Attributes:
        low: Lowest corner of the box in the world in [m], shape (3,).
        step: Side of a voxel in [m].
        state: `UNSEEN`, `FREE` or `OCCUPIED`, int8, shape (nx, ny, nz): index along the world's x, y and z.
    """

    low: NDArray[np.float64]
    step: float
    state: NDArray[np.int8]

    @classmethod
    def unseen(cls, low: np.ndarray, high: np.ndarray, step: float = STEP) -> "SeenSpace":
        """A box that nobody has looked into yet.

        Args:
            low, high: Its corners in the world in [m], shape (3,).
            step: Side of a voxel in [m].
        """
        low = np.asarray(low, float)
        count = np.maximum(1, np.ceil((np.asarray(high, float) - low) / step - 1e-9).astype(int))
        return cls(low, float(step), np.zeros(tuple(count), np.int8))

    @property
    def share_seen(self) -> float:
        """Share of the box that was seen or is known to be filled, 0..1."""
        return float(np.count_nonzero(self.state) / self.state.size)

    def centres(self) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        """Coordinates of the voxels' centres along x, y and z in [m], shapes (nx,), (ny,) and (nz,)."""
        x, y, z = (
            (low + self.step * (np.arange(n) + 0.5)).astype(np.float32)
            for low, n in zip(self.low, self.state.shape, strict=True)
        )
        return x, y, z

    def united(self, other: "SeenSpace") -> "SeenSpace":
        """What both looks together have seen of a world that did not change between them; filled counts before free.

        Raises:
            FrameError: The two are of different boxes.
        """
        same = self.state.shape == other.state.shape and self.step == other.step
        if not same or not np.allclose(self.low, other.low):
            raise FrameError(
                f"two looks can be united only over one box: {self.state.shape} voxels of {self.step} m from "
                f"{self.low.tolist()} against {other.state.shape} of {other.step} m from {other.low.tolist()}"
            )
        return replace(self, state=np.maximum(self.state, other.state))
