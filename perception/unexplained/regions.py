"""Space that something known fills, as distances: what a point of a depth picture is measured against.

Distances are signed and Euclidean outside of a solid; inside they are negative. With p the point in the solid's frame
and h its half sizes:

    box        q = |p| - h,                      d = |max(q, 0)| + min(max(q_x, q_y, q_z), 0)
    cylinder   q = (|p_xy| - h_x, |p_z| - h_z),  d = |max(q, 0)| + min(max(q_1, q_2), 0)
    capsule    d = |p - (0, 0, clip(p_z, -h_z, h_z))| - h_x
    sphere     d = |p| - h_x
    ellipsoid  d = k (k - 1) / g,  k = |p / h|,  g = |p / h^2|   outside (first order, exact on the surface)
               d = (k - 1) min(h_x, h_y, h_z)                   inside

Source of the box and the ellipsoid: I. Quilez, "distance functions", https://iquilezles.org/articles/distfunctions.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

SolidKind = Literal["box", "cylinder", "capsule", "sphere", "ellipsoid"]
EMPTY = np.inf  # distance in [m] to a region that holds nothing


class Region(Protocol):
    """Space that something known fills."""

    def distance(self, points: np.ndarray) -> NDArray[np.float32]:
        """Signed distance in [m] of points in the world to the region, negative inside; shape (n,).

        Args:
            points: In [m], shape (n, 3).
        """
        ...


@dataclass(frozen=True)
class PlacedSolid:
    """One convex solid at its place in the world.

    Attributes:
        kind: Which; a cylinder's and a capsule's axis is its z.
        half: Half sizes in [m], shape (3,); a cylinder is (radius, radius, half height), a capsule (radius,
            radius, half of its straight part).
        pose: world_T_solid, shape (4, 4).
    """

    kind: SolidKind
    half: NDArray[np.float64]
    pose: NDArray[np.float64]

    def distance(self, points: np.ndarray) -> NDArray[np.float32]:
        """As `Region.distance` says."""
        turn, centre = self.pose[:3, :3].astype(np.float32), self.pose[:3, 3].astype(np.float32)
        local = (np.asarray(points, np.float32) - centre) @ turn
        half = np.asarray(self.half, np.float32)
        if self.kind == "box":
            return _outside(np.abs(local) - half)
        if self.kind == "cylinder":
            away = np.hypot(local[:, 0], local[:, 1])
            return _outside(np.stack([away - half[0], np.abs(local[:, 2]) - half[2]], 1))
        if self.kind == "capsule":
            local[:, 2] -= np.clip(local[:, 2], -half[2], half[2])
            return _length(local) - half[0]
        if self.kind == "sphere":
            return _length(local) - half[0]
        scaled = _length(local / half)
        outside = scaled * (scaled - 1.0) / np.maximum(_length(local / half**2), np.float32(1e-9))
        return np.where(scaled < 1.0, (scaled - 1.0) * half.min(), outside)


@dataclass(frozen=True)
class SolidsRegion:
    """The union of solids.

    Attributes:
        solids: At their places.
    """

    solids: tuple[PlacedSolid, ...]

    def distance(self, points: np.ndarray) -> NDArray[np.float32]:
        """As `Region.distance` says."""
        points = np.asarray(points, np.float32)
        return least_distance(self.solids, points)


def least_distance(regions: Sequence[Region], points: np.ndarray) -> NDArray[np.float32]:
    """Distance in [m] of points in the world, shape (n, 3), to the nearest of several regions; shape (n,)."""
    least = np.full(len(points), EMPTY, np.float32)
    for region in regions:
        np.minimum(least, region.distance(points), out=least)
    return least


def _length(vectors: np.ndarray) -> NDArray[np.float32]:
    return np.sqrt(np.einsum("ij,ij->i", vectors, vectors))


def _outside(beyond: np.ndarray) -> NDArray[np.float32]:
    """Distance from how far a point is beyond each pair of faces, shape (n, k)."""
    return _length(np.maximum(beyond, 0.0)) + np.minimum(beyond.max(axis=1), 0.0)
