"""How far depth rays would see if something stood there."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.geometry.depth_rays import DepthRays
from perception.known_shapes.models import KnownBox


@dataclass(frozen=True)
class Hits:
    """Where rays meet boxes and bars.

    Attributes:
        distance: Along the ray in [m], infinite where nothing is met, shape (n,).
        normal: Of the surface that is met, outwards, unit, in the frame of the boxes; 0 where nothing is, shape (n, 3).
    """

    distance: NDArray[np.float64]
    normal: NDArray[np.float64]


def cast(rays: DepthRays, world_T_frame: np.ndarray, boxes: Iterable[KnownBox]) -> Hits:
    """The first surface that each ray meets among boxes and bars along the axes of one frame.

    A ray o + t d is within the slab low <= x <= high of one axis for t between (low - o) / d and (high - o) / d, and
    within a box where it is within all three slabs.

    Args:
        rays: In the world.
        world_T_frame: Frame of the boxes, shape (4, 4).
        boxes: In that frame.
    """
    # One row an axis: rows are worked through much faster than columns.
    origin = ((rays.origin - world_T_frame[:3, 3]) @ world_T_frame[:3, :3]).T.copy()
    direction = (rays.direction @ world_T_frame[:3, :3]).T.copy()
    inverse = 1.0 / np.where(np.abs(direction) < 1e-9, 1e-9, direction)
    start = origin * inverse
    best = np.full(len(rays), np.inf)
    normal = np.zeros((3, len(rays)))
    for box in boxes:
        one, other = box.low[:, None] * inverse - start, box.high[:, None] * inverse - start
        enter, leave = np.minimum(one, other), np.maximum(one, other)
        near = np.maximum(np.maximum(enter[0], enter[1]), enter[2])
        far = np.minimum(np.minimum(leave[0], leave[1]), leave[2])
        closer = np.flatnonzero((near < far) & (near > 0.0) & (near < best))
        if box.rounded:
            distance, outwards = _meet_capsule(origin[:, closer], direction[:, closer], box)
            met = distance < best[closer]
            closer = closer[met]
            best[closer], normal[:, closer] = distance[met], outwards[:, met]
            continue
        best[closer] = near[closer]
        axis = enter[:, closer].argmax(0)
        normal[:, closer] = 0.0
        normal[axis, closer] = -np.sign(direction[axis, closer])
    return Hits(best, normal.T)


def _meet_capsule(origin: np.ndarray, direction: np.ndarray, box: KnownBox) -> tuple[np.ndarray, np.ndarray]:
    """Where rays meet the capsule that fills a box along its longest side: (distance, normal of shape (3, n)).

    With the parts of o and d across the axis (o', d') the round side is met at the smaller t of |o' + t d'|^2 = r^2.
    What meets it beyond an end of the axis can meet the ball about that end only.

    Args:
        origin, direction: Of the rays in the box's frame, shape (3, n).
        box: A rounded one.
    """
    size = box.high - box.low
    along = int(size.argmax())
    across = [i for i in range(3) if i != along]
    radius = float(size[across].min()) / 2.0
    middle = (box.low + box.high) / 2.0
    half = float(size[along]) / 2.0 - radius
    o = origin - middle[:, None]
    a = np.maximum((direction[across] ** 2).sum(0), 1e-12)
    b = (o[across] * direction[across]).sum(0)
    inside = b**2 - a * ((o[across] ** 2).sum(0) - radius**2)
    distance = np.where(inside > 0.0, (-b - np.sqrt(np.maximum(inside, 0.0))) / a, np.inf)
    met = np.isfinite(distance)
    place = np.where(met, o[along] + np.where(met, distance, 0.0) * direction[along], 0.0)
    centre = np.zeros_like(o)
    centre[along] = np.clip(place, -half, half)
    beyond = met & (np.abs(place) > half)
    away = o[:, beyond] - centre[:, beyond]
    b = (away * direction[:, beyond]).sum(0)
    inside = b**2 - ((away**2).sum(0) - radius**2)
    distance[beyond] = np.where(inside > 0.0, -b - np.sqrt(np.maximum(inside, 0.0)), np.inf)
    distance[distance <= 0.0] = np.inf
    reached = np.where(np.isfinite(distance), distance, 0.0)
    return distance, (o + reached * direction - centre) / radius
