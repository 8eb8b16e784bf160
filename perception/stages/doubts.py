"""Estimates that cannot be right, or say too little to take hold of the thing: which, and why.

A doubted thing stays in the scene, so that nothing is driven through it; it is not offered for grasping.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace
from itertools import combinations

import cv2
import numpy as np

from perception.catalogue.catalogue import Catalogue
from perception.catalogue.phrases import appearance_of
from perception.estimates import ObjectEstimate
from perception.geometry.prepared_frame import THINNING, PreparedFrame

MOST_PLACE_STD = 0.015  # level spread of a thing that can be taken hold of, in [m]
TABLE_OFF = 0.008  # a table that seems to lie so far off the world's z = 0 is named as the reason, in [m]
UNSEEN_SIZE = 0.4  # a size is not seen if its spread is more than this share of it, and more than the next [m]
UNSEEN_SIZE_STD = 0.015
ALOFT = 0.025  # what stands higher above all that may carry it, and its spreads, floats, in [m]
BESIDE = 0.03  # how near to a thing the points are that may carry or hold it, in [m]
HOLDING = 0.08  # a hand that holds it is seen up to here above it, in [m]
LEAST_POINTS = 6  # of the thinned cloud that say that something is there
SHARED = 0.3  # share of the smaller of two volumes that both may have in common
LEAST_SHARED = 0.008  # things that touch, and their spreads, go no deeper into each other, in [m]


def with_doubts(
    objects: Sequence[ObjectEstimate],
    frames: Sequence[PreparedFrame],
    fixed: Collection[str] = (),
    catalogue: Catalogue | None = None,
) -> list[ObjectEstimate]:
    """The same estimates, each with what speaks against it.

    Args:
        objects: Everything that was perceived.
        frames: In which it was.
        fixed: Names of furniture of known shape; it is not doubted, and what stands in it shares its volume.
        catalogue: What nouns look like; the built-in one if None.
    """
    doubts: dict[str, list[str]] = {o.name: [] for o in objects}
    loose = [o for o in objects if o.name not in fixed]
    for thing in loose:
        for doubt in (_unseen_sizes(thing), _vague_place(thing, frames), _floats(thing, objects, frames)):
            doubts[thing.name] += [doubt] if doubt else []
    solid = [o for o in loose if not appearance_of(o.phrase, catalogue).hollow]
    for one, other in combinations(solid, 2):
        if _in_one_volume(one, other):
            doubts[one.name].append(f"it fills the same place as '{other.name}'")
            doubts[other.name].append(f"it fills the same place as '{one.name}'")
    return [replace(o, doubts=tuple(doubts[o.name])) if doubts[o.name] else o for o in objects]


def _unseen_sizes(thing: ObjectEstimate) -> str | None:
    if thing.extents_std is None:
        return None
    least = np.maximum(UNSEEN_SIZE_STD, UNSEEN_SIZE * np.asarray(thing.extents))
    unseen = np.flatnonzero(np.asarray(thing.extents_std) > least)
    if len(unseen) < 2:
        return None
    spreads = " and ".join(f"{1e3 * thing.extents[i]:.0f} ± {1e3 * thing.extents_std[i]:.0f} mm" for i in unseen[:2])
    return f"its sizes are not seen on two sides ({spreads})"


def _vague_place(thing: ObjectEstimate, frames: Sequence[PreparedFrame]) -> str | None:
    worst = float(np.max(thing.position_std[:2]))
    if worst <= MOST_PLACE_STD:
        return None
    off = max((float(f.support.at(*thing.position[:2])) for f in frames if f.support.seen), key=abs, default=0.0)
    why = ""
    if abs(off) > TABLE_OFF:
        where = "above" if off > 0.0 else "below"
        why = f": depth shows the table {1e3 * abs(off):.0f} mm {where} its height (depth scale, camera pose or table)"
    return f"its place is known to ± {1e3 * worst:.0f} mm only{why}"


def _floats(thing: ObjectEstimate, objects: Sequence[ObjectEstimate], frames: Sequence[PreparedFrame]) -> str | None:
    """That nothing carries or holds it, as far as anything is known of what is near it."""
    x, y, z = thing.position
    bottom = z - thing.extents[2] / 2
    std = 0.0 if thing.extents_std is None else float(thing.extents_std[2]) / 2
    reach = ALOFT + 2.0 * float(np.hypot(thing.position_std[2], std))
    table = max(float(frame.support.at(x, y)) for frame in frames)
    if bottom - table < reach:
        return None
    for other in objects:
        if other is thing or bottom - other.top > reach or thing.top < other.position[2] - other.extents[2] / 2:
            continue
        if np.hypot(*(other.position[:2] - (x, y))) < np.hypot(*other.extents[:2]) / 2 + BESIDE:
            return None
    radius = float(np.hypot(*thing.extents[:2])) / 2 + BESIDE
    for frame in frames:
        own = np.zeros(frame.depth.shape, bool)
        for item in thing.evidence:
            if item.camera == frame.camera:
                own |= item.mask
        own = cv2.dilate(own.astype(np.uint8), np.ones((2 * THINNING + 1, 2 * THINNING + 1), np.uint8)) > 0
        points = frame.thinned_points(without=own)
        near = np.hypot(points[:, 0] - x, points[:, 1] - y) < radius
        near &= (points[:, 2] > bottom - reach) & (points[:, 2] < thing.top + HOLDING)
        if near.sum() >= LEAST_POINTS:
            return None
    return f"nothing carries it: it would float {1e3 * (bottom - table):.0f} mm above the table"


def _in_one_volume(one: ObjectEstimate, other: ObjectEstimate) -> bool:
    """Whether two things have more volume in common than spreads of their places and sizes may cause."""
    a, b = _surely_filled(one), _surely_filled(other)
    if a is None or b is None:
        return False
    (corners_a, low_a, high_a), (corners_b, low_b, high_b) = a, b
    tall = min(high_a, high_b) - max(low_a, low_b)
    if tall <= 0.0:
        return False
    # In millimetres, because OpenCV takes polygons of less than some 1e-6 for empty.
    common = cv2.intersectConvexConvex(1e3 * corners_a, 1e3 * corners_b)[0] * 1e-6
    areas = [cv2.contourArea(1e3 * corners) * 1e-6 for corners in (corners_a, corners_b)]
    smaller = min(areas[0] * (high_a - low_a), areas[1] * (high_b - low_b))
    return bool(common * tall > SHARED * smaller)


def _surely_filled(thing: ObjectEstimate) -> tuple[np.ndarray, float, float] | None:
    """Footprint, float32, shape (4, 2), and lowest and highest height in [m] of what a thing fills for all its spreads.

    None where that is nothing.
    """
    sizes = np.zeros(3) if thing.extents_std is None else np.asarray(thing.extents_std)
    less = 2.0 * np.asarray(thing.position_std) + sizes + LEAST_SHARED
    left = np.asarray(thing.extents) - [less[:2].max(), less[:2].max(), less[2]]
    if left.min() <= 0.0:
        return None
    if thing.shape != "box":
        left[:2] *= np.sqrt(np.pi) / 2  # the square of the same area as the circle
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * left[:2] / 2
    pose = thing.world_T_object
    level = (corners @ pose[:2, :2].T + pose[:2, 3]).astype(np.float32)
    z = float(pose[2, 3])
    return level, z - left[2] / 2, z + left[2] / 2
