"""What a ray costs that sees farther, or less far, than something expected; and how far it is to the support.

With the measured distance r, the expected one m and their spread s, a ray costs

    min((r - m)^2 / s^2, 16)  where it sees through what is expected (r > m)
    min((r - m)^2 / s^2,  9)  where something stands before it (r < m): an arm, a thing that nobody named
"""

import numpy as np

from perception.geometry.depth_rays import DepthRays
from perception.geometry.support import SupportPlane

THROUGH, BEFORE = 16.0, 9.0  # highest costs of a ray


def ray_costs(measured: np.ndarray, expected: np.ndarray, std: np.ndarray) -> np.ndarray:
    """Cost of each ray, shape (n,).

    Args:
        measured, expected: Distances along the rays in [m], shape (n,); expected ones may be infinite.
        std: Their spread in [m], shape (n,).
    """
    off = np.clip((measured - expected) / std, -100.0, 100.0)
    return np.minimum(off**2, np.where(off > 0.0, THROUGH, BEFORE))


def distance_to_support(table: SupportPlane, rays: DepthRays) -> np.ndarray:
    """How far the rays see until they meet the support, in [m], infinite where they do not; shape (n,)."""
    a, b = table.slope
    rise = rays.direction[:, 2] - a * rays.direction[:, 0] - b * rays.direction[:, 1]
    height = rays.origin[:, 2] - table.height - a * rays.origin[:, 0] - b * rays.origin[:, 1]
    return np.where(rise < -1e-6, height / np.maximum(-rise, 1e-6), np.inf)
