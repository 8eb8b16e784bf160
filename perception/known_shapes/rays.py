"""Depth pictures as rays: how far each pixel sees, and how far it would see if something stood there."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields

import numpy as np

from perception.frames import RgbdFrame
from perception.geometry.cloud import StereoNoise
from perception.geometry.depth_cleaning import depth_steps
from perception.known_shapes.models import KnownBox


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

    origin: np.ndarray
    direction: np.ndarray
    distance: np.ndarray
    std: np.ndarray
    frame: np.ndarray
    pixel: np.ndarray

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


def depth_rays(
    frames: Sequence[RgbdFrame], noise: StereoNoise, stride: int = 4, step: float = 0.03, farthest: float = 2.5
) -> DepthRays:
    """Rays of pictures taken at one moment.

    Args:
        frames: One a camera.
        noise: Of their depth.
        stride: Every n-th row and column.
        step: Pixels beside a depth step larger than this in [m] are left out.
        farthest: Depths beyond this in [m] are left out: they say too little.
    """
    parts = []
    for i, frame in enumerate(frames):
        k, pose = frame.intrinsics, frame.world_T_camera
        keep = np.zeros(frame.depth.shape, bool)
        keep[stride // 2 :: stride, stride // 2 :: stride] = True
        keep &= frame.valid_depth & ~depth_steps(frame.depth, frame.valid_depth, step)
        v, u = np.nonzero(keep)
        depth = frame.depth[v, u].astype(float)
        near = depth < farthest
        v, u, depth = v[near], u[near], depth[near]
        local = np.stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones(len(u))], -1)
        slant = np.linalg.norm(local, axis=1)
        std = noise.depth_std(1.0, k.fx) * depth**2 * slant
        direction = (local / slant[:, None]) @ pose[:3, :3].T
        origin = np.broadcast_to(pose[:3, 3], direction.shape)
        parts.append((origin, direction, depth * slant, std, np.full(len(u), i), np.stack([v, u], -1)))
    return DepthRays(*(np.concatenate(column) for column in zip(*parts, strict=True)))


@dataclass(frozen=True)
class Hits:
    """Where rays meet boxes and bars.

    Attributes:
        distance: Along the ray in [m], infinite where nothing is met, shape (n,).
        normal: Of the surface that is met, outwards, unit, in the frame of the boxes; 0 where nothing is, shape (n, 3).
    """

    distance: np.ndarray
    normal: np.ndarray


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
