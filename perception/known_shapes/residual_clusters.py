"""What depth shows beyond the support and the known furniture: points, and their clusters."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from perception.geometry.depth_rays import DepthRays
from perception.geometry.support import SupportPlane
from perception.known_shapes.articulated_fit import KnownFit
from perception.known_shapes.ray_casting import cast
from perception.known_shapes.ray_costs import distance_to_support

CLEARANCE = 0.008  # points lower than this above the support, and the noise, are the support's, in [m]
MARGIN = 0.012  # the same of known furniture: handles are rounder than their boxes, in [m]


@dataclass(frozen=True)
class ResidualCluster:
    """A cluster of neighbouring points.

    Attributes:
        which: Indices of its rays.
        low, high: Corners of the box around it in the world in [m], shape (3,).
    """

    which: NDArray[np.int64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]


def distance_to_known(rays: DepthRays, table: SupportPlane, standing: Sequence[KnownFit]) -> np.ndarray:
    """How far rays see until they meet the support or known furniture, in [m], infinite where neither; shape (n,)."""
    nearest = distance_to_support(table, rays)
    for fit in standing:
        for frame, boxes in fit.model.groups(fit.fractions):
            nearest = np.minimum(nearest, cast(rays, fit.world_T_model @ frame, boxes).distance)
    return nearest


def residual_rays(rays: DepthRays, table: SupportPlane, known: np.ndarray) -> np.ndarray:
    """Which rays end before all that is known, bool, shape (n,).

    Args:
        rays: Of pictures of one moment.
        table: What things stand on.
        known: As `distance_to_known` gives it, shape (n,).
    """
    points = rays.points
    height = points[:, 2] - table.at(points[:, 0], points[:, 1])
    # Along the ray a height counts more, the flatter the ray.
    noise = rays.std * np.abs(rays.direction[:, 2])
    return (rays.distance < known - MARGIN - 3.0 * rays.std) & (height > CLEARANCE + 2.0 * noise)


def pieces(rays: DepthRays, which: np.ndarray, cell: float = 0.015, least: int = 40) -> list[ResidualCluster]:
    """Clusters of points, largest first.

    Two points hang together when their cells of a cubic grid touch (26 neighbours).

    Args:
        rays: Of pictures of one moment.
        which: Rays whose ends count, bool, shape (n,).
        cell: Side of the grid's cells in [m].
        least: Fewest points of a cluster.
    """
    index = np.flatnonzero(which)
    if not len(index):
        return []
    points = rays.points[index]
    # Far outliers would make the grid too large to hold.
    near = np.all(np.abs(points - np.median(points, axis=0)) < 1.5, axis=1)
    index, points = index[near], points[near]
    place = np.floor((points - points.min(0)) / cell).astype(int)
    grid = np.zeros(place.max(0) + 1, bool)
    grid[tuple(place.T)] = True
    labels, count = ndimage.label(grid, np.ones((3, 3, 3)))  # type: ignore
    of_point = labels[tuple(place.T)]
    found = []
    for label in range(1, count + 1):
        own = of_point == label
        if own.sum() >= least:
            low, high = np.quantile(points[own], (0.01, 0.99), axis=0)
            found.append(ResidualCluster(index[own], low, high))
    return sorted(found, key=lambda piece: -len(piece.which))
