"""First fit of an upright solid to the points of one side of a thing.

A camera sees one side only, so the smallest box around the points is too small and tilted. Three things that are known
mend it: gravity (solids stand upright), the surface that carries the thing (its hidden lower end) and, for round
things, their symmetry (their hidden back).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.estimates import Shape


@dataclass(frozen=True)
class Solid:
    """An upright solid in the world.

    Attributes:
        shape: Box, cylinder or sphere.
        centre: In the world in [m], shape (3,).
        yaw: Of its x axis about the world's z in [rad]; 0 where yaw has no meaning.
        extents: Full sizes along its own axes in [m], shape (3,); z is up.
    """

    shape: Shape
    centre: NDArray[np.floating]
    yaw: float
    extents: NDArray[np.float64]

    @property
    def pose(self) -> np.ndarray:
        """world_T_object, shape (4, 4)."""
        pose = np.eye(4)
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        pose[:2, :2] = [[c, -s], [s, c]]
        pose[:3, 3] = self.centre
        return pose

    @property
    def bottom(self) -> float:
        """Height of its lowest point in [m]."""
        return float(self.centre[2] - self.extents[2] / 2)

    @property
    def top(self) -> float:
        """Height of its highest point in [m]."""
        return float(self.centre[2] + self.extents[2] / 2)

    def covers(self, x: float, y: float, margin: float = 0.0) -> bool:
        """Whether (x, y) [m] lies over its footprint widened by `margin` [m]."""
        dx, dy = x - self.centre[0], y - self.centre[1]
        if self.shape != "box":
            return bool(np.hypot(dx, dy) <= self.extents[0] / 2 + margin)
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        along, across = c * dx + s * dy, -s * dx + c * dy
        return bool(abs(along) <= self.extents[0] / 2 + margin and abs(across) <= self.extents[1] / 2 + margin)


def top_height(points: np.ndarray, depth_std: float) -> float:
    """Height of the upper surface in [m]: the middle of the highest layer, not its noisiest point.

    Args:
        points: In the world in [m], shape (n, 3).
        depth_std: Spread of one point in [m]; sets the thickness of the layer.
    """
    z = points[:, 2]
    level = float(np.quantile(z, 0.97))
    layer = max(0.006, 1.5 * depth_std)
    for _ in range(3):
        chosen = z[np.abs(z - level) < layer]
        if len(chosen) < 10:
            break
        level = float(np.median(chosen))
    # On a slanted or round top the layer's middle sinks below the rim; never report less than the 90 % quantile.
    return max(level, float(np.quantile(z, 0.90)))


def fit_box(points: np.ndarray, bottom: float, depth_std: float = 0.003, trim: float = 0.01) -> Solid:
    """Upright box of smallest footprint around all but a share of the points, extended down to its support.

    The yaw is the angle in steps of half a degree at which the area between the `trim` and 1 - `trim` quantiles along
    both axes is smallest: single outliers do not turn it, as they turn the smallest rectangle around a hull.

    Args:
        points: In the world in [m], shape (n, 3).
        bottom: Height of the supporting surface in [m].
        depth_std: Spread of one point in [m].
        trim: Share of points left out at each end of each axis.
    """
    if len(points) > 4000:
        points = points[:: len(points) // 4000 + 1]
    angles = np.radians(np.arange(0.0, 90.0, 0.5))
    cos, sin = np.cos(angles)[:, None], np.sin(angles)[:, None]
    along = cos * points[:, 0] + sin * points[:, 1]
    across = -sin * points[:, 0] + cos * points[:, 1]
    low = int(trim * len(points))
    high = max(low, int((1.0 - trim) * len(points)) - 1)
    along, across = np.partition(along, (low, high), 1), np.partition(across, (low, high), 1)
    x0, x1, y0, y1 = along[:, low], along[:, high], across[:, low], across[:, high]
    best = int(np.argmin((x1 - x0) * (y1 - y0)))
    yaw = float(angles[best])
    middle = np.array([(x0[best] + x1[best]) / 2, (y0[best] + y1[best]) / 2])
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    top = top_height(points, depth_std)
    sides = np.array([x1[best] - x0[best], y1[best] - y0[best], max(top - bottom, 0.004)])
    centre = np.array([*(turn @ middle), top - sides[2] / 2])
    return Solid("box", centre, yaw, np.maximum(sides, 0.004))


def fit_sphere(points: np.ndarray) -> Solid:
    """Least-squares sphere, trimmed twice to the nine tenths that fit best.

    |p|^2 = 2 c · p + (r^2 - |c|^2) is linear in c and r^2 - |c|^2.

    Args:
        points: In the world in [m], shape (n, 3).
    """
    origin = points.mean(0)
    local = points - origin
    chosen = local
    centre, radius = np.zeros(3), 0.01
    for _ in range(3):
        design = np.c_[2.0 * chosen, np.ones(len(chosen))]
        answer = np.linalg.lstsq(design, (chosen**2).sum(1), rcond=None)[0]
        centre = answer[:3]
        radius = float(np.sqrt(max(answer[3] + centre @ centre, 1e-6)))
        off = np.abs(np.linalg.norm(local - centre, axis=1) - radius)
        chosen = local[off <= np.quantile(off, 0.9)]
    # Noise along the ray flattens a cap; a sphere is never much wider than the cap that shows.
    widest = float(np.ptp(local, axis=0).max())
    radius = float(np.clip(radius, 0.35 * widest, 0.75 * widest))
    return Solid("sphere", origin + centre, 0.0, np.full(3, 2.0 * radius))


def fit_cylinder(points: np.ndarray, bottom: float, depth_std: float = 0.003) -> Solid:
    """Upright cylinder: a circle around the upper rim of a can, cup or bowl, extended down to its support.

    The rim of an open vessel and the edge of a closed one are both the outer edge of the highest layer of points, and
    seen all around from above.

    Args:
        points: In the world in [m], shape (n, 3).
        bottom: Height of the supporting surface in [m].
        depth_std: Spread of one point in [m].
    """
    top = float(np.quantile(points[:, 2], 0.98)) - 0.5 * depth_std
    layer = points[points[:, 2] > top - max(0.015, 2.5 * depth_std), :2]
    if len(layer) < 30:
        layer = points[:, :2]
    centre = (np.quantile(layer, 0.01, axis=0) + np.quantile(layer, 0.99, axis=0)) / 2
    radius = 0.0
    for _ in range(4):
        away = layer - centre
        distance = np.linalg.norm(away, axis=1)
        sector = ((np.arctan2(away[:, 1], away[:, 0]) + np.pi) / (2 * np.pi) * 24).astype(int) % 24
        rim = [layer[sector == i][distance[sector == i].argsort()][-max(1, int(0.15 * (sector == i).sum())) :]
               for i in range(24) if (sector == i).sum() >= 3]  # fmt: skip
        edge = np.array([r.mean(0) for r in rim])
        if len(edge) < 5:
            break
        design = np.c_[2.0 * edge, np.ones(len(edge))]
        answer = np.linalg.lstsq(design, (edge**2).sum(1), rcond=None)[0]
        centre = answer[:2]
        radius = float(np.sqrt(max(answer[2] + centre @ centre, 1e-6)))
    widest = float(np.ptp(layer, axis=0).max())
    radius = float(np.clip(radius, 0.3 * widest, 0.75 * widest))
    tall = max(top - bottom, 0.004)
    return Solid("cylinder", np.array([*centre, top - tall / 2]), 0.0, np.array([2 * radius, 2 * radius, tall]))
