"""Points that nothing explains, of all cameras together, as clusters that are more than noise.

Depth errs by patches of pixels that share one error (`perception.geometry.cloud.StereoNoise`), so the evidence for a
cluster is counted in patches, not in pixels. With z as in `perception.unexplained.explanations`, a stride s and
patches of a pixels, the strength of a cluster is

    S = sum over its points of min(z, 6)^2 s^2 / a.

Noise alone rarely makes one patch of z > 5, nor several neighbours of z > 3: S > 30 is one false cluster in some
thousand pictures of a table of 3,000 patches. A real face counts as soon as it fills about 85 pixels.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from perception.geometry.prepared_frame import PreparedFrame
from perception.geometry.support import SupportPlane
from perception.unexplained.explanations import Explanation, unexplained_by

STRIDE = 2  # every how many rows and columns; a thing of 85 pixels still has 20 points
CELL = 0.015  # side of the grid's cells in [m]
LEAST_Z = 2.5  # from here on a point is a candidate
MOST_Z = 6.0  # a single point proves no more than this
LEAST_STRENGTH = 30.0
LEAST_POINTS_A_CELL = 2  # cells with fewer hang between things: flying pixels


@dataclass(frozen=True)
class Unexplained:
    """Points that nothing explains.

    Attributes:
        points: In the world in [m], shape (n, 3).
        z: As the module's text says, shape (n,).
        weight: Patches that one point stands for, shape (n,).
        std: Depth noise along the ray in [m], shape (n,).
    """

    points: NDArray[np.float64]
    z: NDArray[np.float32]
    weight: NDArray[np.float32]
    std: NDArray[np.float32]

    def only(self, which: np.ndarray) -> "Unexplained":
        """Some of the points, by bool of shape (n,)."""
        return Unexplained(self.points[which], self.z[which], self.weight[which], self.std[which])

    @property
    def strength(self) -> float:
        """S of all points together."""
        return float(np.sum(np.minimum(self.z, MOST_Z) ** 2 * self.weight))


def unexplained_points(
    frames: Sequence[PreparedFrame],
    table: float,
    known: Sequence[Explanation],
    low: np.ndarray,
    high: np.ndarray,
) -> Unexplained:
    """Points of all frames within a box that nothing explains.

    Args:
        frames: Of one moment.
        table: Height of the support in [m], for frames that do not show it.
        known: What explains depth besides the support.
        low, high: Corners of the box in the world in [m], shape (3,).
    """
    found = [_of_frame(frame, table, known, low, high) for frame in frames]
    return Unexplained(
        np.concatenate([f.points for f in found]),
        np.concatenate([f.z for f in found]),
        np.concatenate([f.weight for f in found]),
        np.concatenate([f.std for f in found]),
    )


def clusters(unexplained: Unexplained) -> list[Unexplained]:
    """Clusters that are more than noise, strongest first.

    Two points hang together when their cells of a cubic grid touch (26 neighbours).
    """
    points = unexplained.points
    if not len(points):
        return []
    place = np.floor((points - points.min(0)) / CELL).astype(int)
    size = place.max(0) + 1
    flat = np.ravel_multi_index(tuple(place.T), tuple(size))
    count = np.bincount(flat, minlength=int(np.prod(size))).reshape(size)
    labels, number = ndimage.label(count >= LEAST_POINTS_A_CELL, np.ones((3, 3, 3)))  # type: ignore[misc]
    of_point = labels.ravel()[flat]
    strength = np.bincount(
        of_point, weights=np.minimum(unexplained.z, MOST_Z) ** 2 * unexplained.weight, minlength=number + 1
    )
    strong = [label for label in np.argsort(-strength) if label > 0 and strength[label] > LEAST_STRENGTH]
    return [unexplained.only(of_point == label) for label in strong]


def _of_frame(
    frame: PreparedFrame, table: float, known: Sequence[Explanation], low: np.ndarray, high: np.ndarray
) -> Unexplained:
    every = np.s_[STRIDE // 2 :: STRIDE, STRIDE // 2 :: STRIDE]
    points, trusted = frame.cloud[every], frame.trusted_depth[every]
    inside = trusted & np.all((points > low) & (points < high), axis=-1)
    points = points[inside]
    depth = frame.depth[every][inside].astype(float)
    away = points - frame.world_T_camera[:3, 3]
    length = np.linalg.norm(away, axis=1)
    std = frame.depth_std(1.0) * depth * length  # along the ray: sigma_z * |ray| / z
    plane = frame.support if frame.support.seen else SupportPlane(table, (0.0, 0.0), False)
    z = unexplained_by(points, std, np.abs(away[:, 2]) / length, plane, known)
    open_ = z > LEAST_Z
    weight = np.full(int(open_.sum()), STRIDE**2 / frame.noise.patch_px, np.float32)
    return Unexplained(points[open_], z[open_], weight, std[open_].astype(np.float32))
