"""How far points are from the surface of an upright solid, negative inside."""

import numpy as np

from perception.catalogue.appearance import Kind
from perception.geometry.solids import Solid


def surface_distance(kind: Kind, solid: Solid, points: np.ndarray) -> np.ndarray:
    """Signed distance of points to a solid's surface in [m], negative inside, shape (n,).

    Args:
        kind: What the solid is; a lying cylinder is told by the box around it.
        solid: In the world.
        points: In the world in [m], shape (n, 3).
    """
    if kind == "box":
        return box_distance(solid, points)
    local = (points - solid.centre) @ solid.pose[:3, :3]
    if kind in ("sphere", "ellipsoid"):
        return np.linalg.norm(local, axis=1) - solid.extents[0] / 2
    along, across = (0, (1, 2)) if kind == "lying cylinder" else (2, (0, 1))
    ends = np.abs(local[:, along]) - solid.extents[along] / 2
    side = np.linalg.norm(local[:, across], axis=1) - solid.extents[across[0]] / 2
    return _outside_and_inside(np.stack([ends, side], -1))


def box_distance(solid: Solid, points: np.ndarray) -> np.ndarray:
    """Signed distance of points to a box's surface in [m], negative inside, shape (n,)."""
    local = (points - solid.centre) @ solid.pose[:3, :3]
    return _outside_and_inside(np.abs(local) - solid.extents / 2)


def ellipsoid_distance(solid: Solid, points: np.ndarray) -> np.ndarray:
    """Signed distance of points to an ellipsoid's surface in [m] to first order, negative inside, shape (n,)."""
    half = solid.extents / 2
    q = (points - solid.centre) @ solid.pose[:3, :3] / half
    away = np.linalg.norm(q, axis=1)
    return (away - 1.0) * away / np.maximum(np.linalg.norm(q / half, axis=1), 1e-9)


def _outside_and_inside(beyond: np.ndarray) -> np.ndarray:
    """Distance to a surface from how far points lie beyond each pair of its faces in [m], shape (n, pairs) to (n,)."""
    return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(1), 0.0)
