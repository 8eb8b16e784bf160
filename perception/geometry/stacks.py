"""Things of one appearance that stand on each other, told apart by depth where colour tells nothing.

What stands on a thing leaves part of that thing's level top in sight around it. In the heights of the pixels such a top
is a narrow peak far below the highest pixels, and over the ground (x, y) what lies above it covers clearly less than
both together do. The sides of one box, can or ball have no such peak, and what lies above any height of a box or can
covers as much ground as the rest of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.geometry.prepared_frame import PreparedFrame
from perception.geometry.solids import fit_box
from perception.interfaces import Detection

LEAST_TALL = 0.015  # what stands on something is at least so tall in [m]
LEAST_WIDE = 0.015  # and so wide: a knob or a bar on a lid is part of the lid
LEAST_FULL = 0.75  # and covers at least this share of its own hull in the picture: a handle over a pot does not
WIDER = 1.4  # a top with something on it covers at least so many times the ground of what stands on it
PEAK = 2.0  # at a level top so many times the pixels per height of what stands on it
LEAST_PIXELS = 60  # of either part in [px]
BIN = 0.002  # of heights in [m]
FOOT = 0.003  # pixels at most this high above a level and its noise may be the level's, in [m]
MOST_POINTS = 1000  # that a box is put around
STRAYS = 0.02  # share of them beyond each of its sides
CELL = 0.005  # of the grid on the ground in which single points that stray count for nothing, in [m]


@dataclass(frozen=True)
class StackPart:
    """One of several things that stand on each other.

    Attributes:
        pixels: Where it is seen, bool, shape (height, width).
        rest: Where the others are seen, bool, same shape.
        sizes: Of the upright box around it, sides of the ground that it covers and height, in [m], shape (3,).
    """

    pixels: NDArray[np.bool_]
    rest: NDArray[np.bool_]
    sizes: NDArray[np.float64]

    @property
    def covered(self) -> np.ndarray:
        """Where it is seen, and what of the others lies within its hull in the picture and hides it."""
        return self.pixels | (_hull(self.pixels) & self.rest)


@dataclass(frozen=True)
class Ground:
    """Where the pixels of a picture are in the world.

    Attributes:
        frame: The picture.
    """

    frame: PreparedFrame

    @property
    def heights(self) -> np.ndarray:
        """Above the support in [m], NaN where unknown, shape (height, width)."""
        return self.frame.rises

    def places(self, pixels: np.ndarray) -> np.ndarray:
        """(x, y) in the world and height above the support of pixels with known depth, in [m], shape (n, 3)."""
        known = pixels & self.frame.valid_depth
        return np.c_[self.frame.cloud[known][:, :2], self.heights[known]]

    def height_std(self, pixels: np.ndarray) -> float:
        """Spread of one pixel's height in [m]: of its depth, by how steeply one looks down on it."""
        depth = self.frame.depth[pixels & self.frame.valid_depth]
        lens, pose = self.frame.intrinsics, self.frame.world_T_camera
        v, u = (float(np.mean(index)) for index in np.nonzero(pixels))
        rise = pose[2, :3] @ np.array([(u - lens.cx) / lens.fx, (v - lens.cy) / lens.fy, 1.0])
        return abs(float(rise)) * self.frame.depth_std(float(np.median(depth)))

    def box_sizes(self, pixels: np.ndarray, bottom: float) -> np.ndarray:
        """Sizes of the upright box from a height [m] up around what pixels show, in [m], shape (3,)."""
        places = self.places(pixels)
        thinned = places[:: len(places) // MOST_POINTS + 1]
        return fit_box(thinned, bottom, self.height_std(pixels), STRAYS).extents

    def seen_height(self, pixels: np.ndarray) -> float:
        """From the lowest to the highest of what pixels show, but for strays, in [m]."""
        return float(np.ptp(np.quantile(self.places(pixels)[:, 2], (STRAYS, 1.0 - STRAYS))))

    def moved_down(self, pixels: np.ndarray, level: float) -> np.ndarray:
        """Pixels between others and the points straight below them at a level [m], bool, shape (height, width)."""
        points = self.places(pixels)
        lens, pose = self.frame.intrinsics, self.frame.world_T_camera
        lines = []
        for height in (points[:, 2], np.full(len(points), level)):
            local = (np.c_[points[:, :2], height + self.frame.support.height] - pose[:3, 3]) @ pose[:3, :3]
            scale = np.maximum(local[:, 2:], 0.02)
            lines.append(np.round(local[:, :2] / scale * [lens.fx, lens.fy] + [lens.cx, lens.cy]).astype(np.int32))
        drawn = np.zeros(pixels.shape, np.uint8)
        cv2.polylines(drawn, list(np.stack(lines, 1)), False, 1)
        return drawn > 0


def split_stack(blob: np.ndarray, ground: Ground) -> list[StackPart]:
    """What stands on each other in one blob, upper things first; empty for a single thing.

    Args:
        blob: Connected pixels of one appearance, bool, shape (height, width).
        ground: Where they are.
    """
    uppers: list[tuple[np.ndarray, float]] = []  # with the height of what they stand on
    rest = blob
    found = _split_once(rest, blob & ~rest, ground)
    while found is not None:
        level, above, rest = found
        uppers += [(pixels, level) for pixels in above]
        found = _split_once(rest, blob & ~rest, ground)
    if not uppers:
        return []
    parts = []
    for pixels, bottom in [*uppers, (rest, 0.0)]:
        parts.append(StackPart(pixels, blob & ~pixels, ground.box_sizes(pixels, bottom)))
    return parts


def whole_stack(part: Detection) -> Detection:
    """A part with all that it stands on or carries: what a segmenter can cut out by its appearance."""
    if part.seed is None or part.rest is None:
        return part
    seed = part.seed | part.rest
    return replace(part, box_px=box_of(seed), seed=seed, rest=None)


def box_of(pixels: np.ndarray) -> np.ndarray:
    """(x0, y0, x1, y1) around pixels in [px], float, shape (4,); x1 and y1 are just outside of the last."""
    y, x = np.nonzero(pixels)
    return np.array([x.min(), y.min(), x.max() + 1, y.max() + 1], float)


def own_pixels(mask: np.ndarray, own: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """The pixels of a stack's mask that lie nearer to one part than to the others, bool, shape (height, width).

    Args:
        mask: Of the whole stack, bool, shape (height, width).
        own: Pixels of the part, bool, same shape.
        rest: Pixels of the others, bool, same shape.
    """
    to_own, to_rest = (cv2.distanceTransform((~p).astype(np.uint8), cv2.DIST_L2, 3) for p in (own, rest))
    return mask & (to_own <= to_rest)


def filled_share(parts: Sequence[StackPart]) -> float:
    """How much of the prism around all parts they fill, 0..1: the less, the less they look like one box or can."""
    filled = sum(float(np.prod(part.sizes)) for part in parts)
    prism = max(float(np.prod(part.sizes[:2])) for part in parts) * sum(float(part.sizes[2]) for part in parts)
    return min(1.0, filled / max(prism, 1e-9))


def _split_once(
    blob: np.ndarray, gone: np.ndarray, ground: Ground
) -> tuple[float, list[np.ndarray], np.ndarray] | None:
    """Height of the highest level that carries something, what stands on it, and the rest; None if nothing does.

    Args:
        blob: bool, shape (height, width).
        gone: What stood on it and was cut off before, bool, same shape.
        ground: Where its pixels are.
    """
    known = blob & np.isfinite(ground.heights)
    if known.sum() < 2 * LEAST_PIXELS:
        return None
    std = ground.height_std(known)
    heights = ground.heights[known]
    for level in _levels(heights, std):
        above = _standing_on(blob, gone, ground, level, FOOT + 2.0 * std)
        beside = known & ~np.any(above, axis=0) if above else known
        at_level = beside & (np.abs(ground.heights - level) < FOOT + 2.0 * std)
        carried = []
        for piece in above:
            own = ground.places(piece)
            both = np.concatenate([own, ground.places(at_level)])
            if _ground_area(both) >= WIDER * _ground_area(own) and _ground_sides(own)[1] >= LEAST_WIDE:
                carried.append(piece)
        if carried:
            rest = _opened(blob & ~np.any(carried, axis=0))
            if (rest & known).sum() >= LEAST_PIXELS:
                return level, carried, rest
    return None


def _levels(heights: np.ndarray, std: float) -> list[float]:
    """Heights of peaks that stand out of all that is above them, highest first, in [m].

    Args:
        heights: In [m], shape (n,).
        std: Spread of one height in [m].
    """
    low, top = np.quantile(heights, (0.01, 0.98))
    edges = np.arange(low - 0.02, top + 0.02, BIN)
    counts = np.histogram(heights, edges)[0].astype(np.float32)
    if len(counts) < 3:
        return []
    width = max(0.002, 0.7 * std) / BIN
    smooth = cv2.GaussianBlur(counts[None], (0, 0), width)[0]
    reach = FOOT + 2.0 * std
    found = []
    for i in range(len(smooth) - 2, 0, -1):
        level = float(edges[i] + BIN / 2)
        if top - level < max(LEAST_TALL, 2.0 * reach) or smooth[i] < smooth[i - 1] or smooth[i] <= smooth[i + 1]:
            continue
        above = float((heights > level + reach).sum()) / (top - level - reach) * BIN
        if smooth[i] >= PEAK * above:
            found.append(level)
    return found


def _standing_on(blob: np.ndarray, gone: np.ndarray, ground: Ground, level: float, reach: float) -> list[np.ndarray]:
    """Pieces of a blob that rise over a level, each down to its foot, bool, shape (height, width).

    Args:
        blob: bool, shape (height, width).
        gone: What stood on it and hides part of it, bool, same shape.
        ground: Where its pixels are.
        level: In [m].
        reach: Pixels less than this above the level may be the level's, in [m].
    """
    over = cv2.medianBlur((blob & (ground.heights > level + reach)).astype(np.uint8), 5)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(over, connectivity=4)
    pieces = []
    for i in range(1, count):
        piece = labels == i
        hull = _hull(piece)
        if stats[i, cv2.CC_STAT_AREA] < LEAST_PIXELS or (piece | (hull & gone)).sum() < LEAST_FULL * hull.sum():
            continue
        heights = ground.heights[piece]
        if np.nanquantile(heights, 0.9) < level + max(LEAST_TALL, 2.0 * reach):
            continue
        foot = piece & (ground.heights < level + 2.0 * reach)
        down = ground.moved_down(foot, level) if foot.any() else foot
        full = cv2.morphologyEx((piece | down).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)) > 0
        whole = _opened(full & blob)
        if (whole & np.isfinite(ground.heights)).sum() >= LEAST_PIXELS:
            pieces.append(whole)
    return pieces


def _ground_cells(places: np.ndarray) -> np.ndarray:
    """Middles of the cells of the ground that hold at least two points, in [m], float32, shape (k, 2)."""
    cells, counts = np.unique(np.floor(places[:, :2] / CELL).astype(int), axis=0, return_counts=True)
    return ((cells[counts > 1] + 0.5) * CELL).astype(np.float32)


def _ground_area(places: np.ndarray) -> float:
    """Of the hull of what points cover on the ground, in [m^2]."""
    cells = _ground_cells(places)
    return float(cv2.contourArea(cv2.convexHull(cells.reshape(-1, 1, 2)))) if len(cells) > 2 else 0.0


def _ground_sides(places: np.ndarray) -> np.ndarray:
    """Of the smallest rectangle around what points cover on the ground, in [m], longer first, shape (2,)."""
    cells = _ground_cells(places)
    if len(cells) < 3:
        return np.zeros(2)
    return np.sort(np.array(cv2.minAreaRect(cells.reshape(-1, 1, 2))[1]))[::-1]


def _opened(pixels: np.ndarray) -> np.ndarray:
    return cv2.morphologyEx(pixels.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0


def _hull(pixels: np.ndarray) -> np.ndarray:
    filled = np.zeros(pixels.shape, np.uint8)
    points = np.stack(np.nonzero(pixels)[::-1], -1).astype(np.int32)
    if len(points):
        cv2.fillConvexPoly(filled, cv2.convexHull(points.reshape(-1, 1, 2)), 1)
    return filled > 0
