"""An object at a place, with what of its shape decides where others can lie: on top, in it, or inside of it."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

VERTICAL_TOLERANCE = 0.015  # [m], of a contact between two perceived boxes: two heights with 5 mm error each, and slack
EDGE_MARGIN = 0.005  # [m] by which a centre must lie inside the footprint that carries it: nearer, it would tip


@dataclass(frozen=True)
class Inside:
    """The inside of furniture, in the furniture's frame.

    Attributes:
        low, high: Corners in [m], shape (3,): low's z is the shelf's surface.
        outward: Unit vector along x or y from the inside through the opening, shape (3,).
    """

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    outward: NDArray[np.float64]


@dataclass(frozen=True)
class PosedObject:
    """An object at a place.

    Attributes:
        name: Name in the scene.
        pose: Pose of its box centre in the world, shape (4, 4).
        extents: Full sizes along its own axes in [m], shape (3,).
        shape: Solid; a cylinder's axis is its z.
        container: Whether things are put into it instead of onto it.
        inner_floor: Height of a container's inner floor above its lowest point in [m].
        inner_radius: Radius of a container's opening in [m].
        inside: Furniture's inside, or None.
        tracked: Whether its pose is followed from the start, so that its faces can be told apart; else it was fitted
            anew to what is seen.
        handles: Middles of the handles of its joints in the world in [m], shape (k, 3): the palm at one of them is at
            the object.
    """

    name: str
    pose: NDArray[np.float64]
    extents: NDArray[np.float64]
    shape: Literal["box", "cylinder", "sphere"] = "box"
    container: bool = False
    inner_floor: float = 0.0
    inner_radius: float = 0.0
    inside: Inside | None = None
    tracked: bool = True
    handles: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def position(self) -> np.ndarray:
        """Centre in the world in [m], shape (3,)."""
        return self.pose[:3, 3]

    @property
    def half_height(self) -> float:
        """Half of its vertical size as it stands in [m]: the support function of its solid along the world's z."""
        half = np.asarray(self.extents) / 2
        up = self.pose[2, :3]  # the world's z in the object's axes
        if self.shape == "sphere":
            return float(half.max())
        if self.shape == "cylinder":
            radius = max(half[0], half[1])
            return float(abs(up[2]) * half[2] + np.sqrt(max(0.0, 1.0 - up[2] ** 2)) * radius)
        return float(np.abs(up) @ half)

    @property
    def top(self) -> float:
        """Height of its highest point in [m]."""
        return float(self.pose[2, 3]) + self.half_height

    @property
    def bottom(self) -> float:
        """Height of its lowest point in [m]."""
        return float(self.pose[2, 3]) - self.half_height

    def distance_to(self, point: np.ndarray) -> float:
        """Distance in [m] of a point in the world from the object's box or the nearest of its handles; 0 inside."""
        local = self.pose[:3, :3].T @ (np.asarray(point) - self.position)
        box = float(np.linalg.norm(np.maximum(np.abs(local) - np.asarray(self.extents) / 2, 0.0)))
        return min([box, *np.linalg.norm(self.handles - point, axis=1)])

    def beyond_footprint(self, point: np.ndarray, margin: float) -> float:
        """Horizontal distance in [m] of a point from the footprint shrunk by `margin`; 0 inside it."""
        offset = np.asarray(point)[:2] - self.position[:2]
        half = np.asarray(self.extents)[:2] / 2
        if self.shape != "box":
            return float(max(0.0, np.linalg.norm(offset) - max(half.max() - margin, 0.0)))
        yaw = np.arctan2(self.pose[1, 0], self.pose[0, 0])
        c, s = np.cos(yaw), np.sin(yaw)
        local = np.array([c * offset[0] + s * offset[1], -s * offset[0] + c * offset[1]])
        return float(np.linalg.norm(np.maximum(np.abs(local) - np.maximum(half - margin, 0.0), 0.0)))


def half_heights(thing: PosedObject, rotations: np.ndarray) -> np.ndarray:
    """`PosedObject.half_height` in [m] for many rotations of one object: (n, t, 3, 3) → (n, t)."""
    half, up = np.asarray(thing.extents) / 2, rotations[..., 2, :]
    if thing.shape == "sphere":
        return np.full(up.shape[:2], half.max())
    if thing.shape == "cylinder":
        flat = np.sqrt(np.maximum(0.0, 1.0 - up[..., 2] ** 2))
        return np.abs(up[..., 2]) * half[2] + flat * max(half[0], half[1])
    return np.abs(up) @ half
