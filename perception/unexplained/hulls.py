"""Upright boxes around a cluster of points: on the safe side, but not around space that was seen to be free.

A box of least footprint is put around the points. Where much of it was seen to be free it is cut in two, in the
direction and at the place at which both boxes together are smallest, and so on. A box goes down to what carries it,
unless the space beneath was seen to be free: then it floats. A side behind which nobody could see is moved back until
the box is as thick as it is wide, or `GUESSED_DEPTH`; its size is said to be unsure by as much.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from perception.geometry.prepared_frame import PreparedFrame
from perception.geometry.solids import Solid, fit_box
from perception.unexplained.seen_free import seen_free

FREE_SHARE = 0.4  # of a box's volume seen to be free, above which it is cut
CUT_TURN = 15.0  # [degrees] between the directions of cuts that are tried
LEAST_GAIN = 0.25  # share of the volume that a cut must save
MOST_CUTS = 3  # one after another, so at most eight boxes a cluster
LEAST_POINTS = 8  # in a part
GRID = 6  # sample points along each axis of a box
GAP = 0.04  # [m] beneath the lowest point from which on a thing may float
STANDS_WITHIN = 0.03  # [m] that a carrier's top may be above the lowest point
GUESSED_DEPTH = 0.06  # [m]
BEHIND = 0.02  # [m] behind a side at which it is asked whether anybody saw free space
UNSURE = 0.03  # [m]: spread of a size one of whose sides nobody saw
ROUNDING = 0.003  # [m] added at each side: cells and calibration


@dataclass(frozen=True)
class Hull:
    """A box around unexplained points.

    Attributes:
        solid: The box.
        floats: Whether the space beneath was seen to be free.
        size_std: Spread of its sizes along its own axes in [m], shape (3,).
        points: Inside of it, in the world in [m], shape (n, 3).
    """

    solid: Solid
    floats: bool
    size_std: NDArray[np.float64]
    points: NDArray[np.float64]


def hulls_of(
    points: np.ndarray, std: float, frames: Sequence[PreparedFrame], carriers: Sequence[Solid], table: float
) -> list[Hull]:
    """Boxes around a cluster.

    Args:
        points: In the world in [m], shape (n, 3).
        std: Their depth noise in [m].
        frames: Of the same moment.
        carriers: Known things that may carry it.
        table: Height of the support in [m].
    """
    return [_hull(part, std, frames, carriers, table) for part in _parts(points, std, frames, MOST_CUTS)]


def _parts(points: np.ndarray, std: float, frames: Sequence[PreparedFrame], cuts: int) -> list[np.ndarray]:
    """Points, cut where one box would fill much space that was seen to be free."""
    box = fit_box(points, float(points[:, 2].min()), std)
    inside = _samples(box)
    if cuts == 0 or len(points) < 2 * LEAST_POINTS or seen_free(frames, inside).mean() < FREE_SHARE:
        return [points]
    best, least = None, (1.0 - LEAST_GAIN) * float(np.prod(box.extents))
    for yaw in box.yaw + np.radians(np.arange(0.0, 90.0, CUT_TURN)):
        c, s = np.cos(yaw), np.sin(yaw)
        local = (points - box.centre) @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        low, high = local.min(0), local.max(0)
        for axis in range(3):
            for share in np.linspace(0.1, 0.9, 9):
                below = local[:, axis] < low[axis] + share * (high - low)[axis]
                if min(below.sum(), (~below).sum()) < LEAST_POINTS:
                    continue
                volume = sum(_volume(local[side]) for side in (below, ~below))
                if volume < least:
                    best, least = below, volume
    if best is None:
        return [points]
    return [p for side in (best, ~best) for p in _parts(points[side], std, frames, cuts - 1)]


def _volume(local: np.ndarray) -> float:
    return float(np.prod(np.maximum(np.ptp(local, axis=0), 0.01)))


def _hull(
    points: np.ndarray, std: float, frames: Sequence[PreparedFrame], carriers: Sequence[Solid], table: float
) -> Hull:
    lowest = float(np.quantile(points[:, 2], 0.02))
    box = _rounded(fit_box(points, lowest, std))
    bottom = _carried_at(box, lowest, carriers, table)
    floats = False
    if lowest - bottom > GAP:
        beneath = _upright(box, bottom + 0.3 * (lowest - bottom), lowest - 0.3 * (lowest - bottom))
        floats = bool(seen_free(frames, _samples(beneath)).mean() > 0.5)
    box = _upright(box, lowest - ROUNDING if floats else bottom, box.top)
    box, size_std = _with_hidden_sides(box, frames)
    return Hull(box, floats, np.hypot(size_std, [std, std, std]), points)


def _with_hidden_sides(box: Solid, frames: Sequence[PreparedFrame]) -> tuple[Solid, np.ndarray]:
    """The box with sides that nobody saw moved back, and the spread of its sizes in [m], shape (3,)."""
    size_std = np.zeros(3)
    for axis in (0, 1):
        wanted = min(float(box.extents[1 - axis]), GUESSED_DEPTH)
        for sign in (-1.0, 1.0):
            if seen_free(frames, _face(box, axis, sign, BEHIND)).mean() > 0.3:
                continue
            size_std[axis] = UNSURE
            more = max(0.0, wanted - float(box.extents[axis]))
            centre = np.array(box.centre) + sign * more / 2 * box.pose[:3, axis]
            extents = box.extents + more * np.eye(3)[axis]
            box = replace(box, centre=centre, extents=extents)
    return box, size_std


def _carried_at(box: Solid, lowest: float, carriers: Sequence[Solid], table: float) -> float:
    """Height in [m] of the highest surface below a box."""
    tops = [
        c.top
        for c in carriers
        if c.top < lowest + STANDS_WITHIN and c.covers(float(box.centre[0]), float(box.centre[1]), 0.01)
    ]
    return max([table, *tops])


def _rounded(box: Solid) -> Solid:
    return replace(box, extents=box.extents + np.array([2 * ROUNDING, 2 * ROUNDING, 0.0]))


def _upright(box: Solid, bottom: float, top: float) -> Solid:
    """The box between other heights in [m]."""
    tall = max(top - bottom, 0.01)
    centre = np.array([box.centre[0], box.centre[1], top - tall / 2])
    return replace(box, centre=centre, extents=np.array([box.extents[0], box.extents[1], tall]))


def _samples(box: Solid) -> np.ndarray:
    """Points all over the inside of a box in the world in [m], shape (GRID^3, 3)."""
    along = (np.arange(GRID) + 0.5) / GRID - 0.5
    grid = np.stack(np.meshgrid(along, along, along, indexing="ij"), -1).reshape(-1, 3)
    return (grid * box.extents) @ box.pose[:3, :3].T + box.centre


def _face(box: Solid, axis: int, sign: float, away: float) -> np.ndarray:
    """Points at a distance in [m] before a side of a box, in the world in [m], shape (GRID^2, 3)."""
    along = (np.arange(GRID) + 0.5) / GRID - 0.5
    a, b = np.meshgrid(along, along, indexing="ij")
    grid = np.zeros((GRID, GRID, 3))
    grid[..., 1 - axis], grid[..., 2] = a * box.extents[1 - axis], b * box.extents[2]
    grid[..., axis] = sign * (box.extents[axis] / 2 + away)
    return grid.reshape(-1, 3) @ box.pose[:3, :3].T + box.centre
