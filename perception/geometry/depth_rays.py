"""Depth pictures as rays: how far each pixel sees."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class DepthRays:
    """Every n-th trusted pixel of one or several pictures as a ray in the world.

    Attributes:
        origin: Where the camera was in [m], shape (n, 3).
        direction: Unit vectors, shape (n, 3).
        distance: Measured along the ray in [m], shape (n,).
        std: Spread of that distance in [m], shape (n,).
        frame: Which picture, int, shape (n,).
        pixel: Which pixel (row, column), int, shape (n, 2).
    """

    origin: NDArray[np.float64]
    direction: NDArray[np.float64]
    distance: NDArray[np.float64]
    std: NDArray[np.float64]
    frame: NDArray[np.int64]
    pixel: NDArray[np.int64]

    @property
    def points(self) -> np.ndarray:
        """Where the rays end in the world in [m], shape (n, 3)."""
        return self.origin + self.distance[:, None] * self.direction

    def __len__(self) -> int:
        return len(self.distance)

    def only(self, which: np.ndarray | slice) -> "DepthRays":
        """Some of the rays, by bool of shape (n,), by index or by slice."""
        return DepthRays(*(getattr(self, f.name)[which] for f in fields(self)))

    def near(self, centre: np.ndarray, radius: float) -> np.ndarray:
        """Which rays pass within `radius` [m] of a point, were they endless; bool, shape (n,)."""
        away = centre - self.origin
        along = np.maximum(np.einsum("ij,ij->i", away, self.direction), 0.0)
        off = away - along[:, None] * self.direction
        return np.einsum("ij,ij->i", off, off) < radius**2


def joined(rays: Sequence[DepthRays]) -> DepthRays:
    """Rays of several pictures as one set; `frame` counts the pictures in their order."""
    numbered = [replace(one, frame=np.full(len(one), i)) for i, one in enumerate(rays)]
    return DepthRays(*(np.concatenate([getattr(one, f.name) for one in numbered]) for f in fields(DepthRays)))
