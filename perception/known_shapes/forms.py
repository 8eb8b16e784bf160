"""Things whose form is known up to its sizes: a round body with a spout and a bar above it is a kettle of some size.

A form is built from three full sizes, in a frame at the centre of its box with z up. Lengths in [m].
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class FormSolid:
    """One convex piece.

    Attributes:
        kind: A cylinder's and a capsule's axis is its z.
        half: Half sizes in [m], shape (3,); a cylinder is (radius, radius, half height), a capsule (radius, radius,
            half of its straight part), an ellipsoid its three half axes.
        pose: Of its frame in the form's, shape (4, 4).
    """

    kind: Literal["box", "cylinder", "capsule", "ellipsoid"]
    half: NDArray[np.float64]
    pose: NDArray[np.float64]

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Signed distance of points in the form's frame to its surface in [m], negative inside, shape (n,).

        Exact, but for ellipsoids, where it is of first order: (|q| - 1) |q| / |q / h| with q = p / h.
        """
        local = (points - self.pose[:3, 3]) @ self.pose[:3, :3]
        half = self.half
        if self.kind == "ellipsoid":
            q = local / half
            away = np.linalg.norm(q, axis=1)
            return (away - 1.0) * away / np.maximum(np.linalg.norm(q / half, axis=1), 1e-9)
        if self.kind == "capsule":
            along = np.clip(local[:, 2], -half[2], half[2])
            return np.sqrt(local[:, 0] ** 2 + local[:, 1] ** 2 + (local[:, 2] - along) ** 2) - half[0]
        if self.kind == "cylinder":
            side = np.hypot(local[:, 0], local[:, 1]) - half[0]
            end = np.abs(local[:, 2]) - half[2]
            outside = np.hypot(np.maximum(side, 0.0), np.maximum(end, 0.0))
            return outside + np.minimum(np.maximum(side, end), 0.0)
        beyond = np.abs(local) - half
        return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(1), 0.0)


@dataclass(frozen=True)
class KnownForm:
    """A form that a noun means.

    Attributes:
        noun: The noun, for instance "kettle".
        extents: Usual full sizes of its box in [m], shape (3,).
        build: Its solids from the full sizes of its box, shape (3,).
    """

    noun: str
    extents: NDArray[np.float64]
    build: Callable[[np.ndarray], Sequence[FormSolid]]
