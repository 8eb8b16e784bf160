"""What a thing rests on: the table, the top of another thing, or something that nobody named."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from perception.frames import RgbdFrame
from perception.geometry.outline import outward_normals
from perception.geometry.prepared_frame import PreparedFrame
from perception.geometry.solids import Solid
from perception.geometry.support import SupportPlane

FOOT_STD = 0.0015  # how well the height of a carrier in sight is known, in [m]
HIDDEN_FOOT_STD = 0.004  # the same where the foot itself is not in sight
FAR_BELOW = 0.10  # a hidden lower end longer than this in [m] more likely rests on something that nobody named

# Of a side seen so steeply that its missing foot would be fewer pixels than this nobody can tell whether it is there.
FORESHORTENED_PX = 10.0
# A side that would be longer than this cannot lie unseen beneath a thing's own top.
HIDDEN_SIDE_PX = 40.0
# So far beyond the edge of a mask that ends too early the thing's own surface is lower by this in [m], and the noise.
GOES_ON_PX, GOES_ON_FALL = 12.0, 0.006


@dataclass(frozen=True)
class LowerEnd:
    """What the picture says about the lower end of a thing.

    Attributes:
        hidden: Something nearer covers it, or the picture ends there.
        drops: Beyond it depth falls away: the thing hangs in the air, or its own top hides what is beneath.
        height: Of the points just inside of it in [m]; NaN where unknown.
        px_per_metre: How many pixels a vertical metre takes there.
        goes_on: Beyond it the surface goes on downwards without a step: the mask ends before the thing does.
    """

    hidden: bool
    drops: bool
    height: float
    px_per_metre: float
    goes_on: bool = False


def lower_end(
    frame: PreparedFrame, contour: np.ndarray, centre: np.ndarray, reach: int = 5, step: float = 0.02
) -> LowerEnd:
    """Look across the edge of a mask that gravity points to.

    Args:
        frame: The picture.
        contour: Border pixels (x, y) of its mask, in order, int, shape (n, 2).
        centre: Some point of the thing in the world in [m], shape (3,).
        reach: How far beyond the edge to look in [px].
        step: By how much depth must change to count in [m].
    """
    if len(contour) < 12:
        return LowerEnd(True, False, float("nan"), 0.0)
    normals = outward_normals(contour)
    down = _down_in_picture(frame, centre)
    scale = float(np.linalg.norm(down))
    facing = normals @ (down / scale if scale > 1.0 else np.array([0.0, 1.0])) > 0.6
    width, height = frame.intrinsics.width, frame.intrinsics.height
    edge, normals = contour[facing], normals[facing]
    if len(edge) < 3:
        return LowerEnd(True, False, float("nan"), scale)
    cut = (edge < 2).any(1) | (edge[:, 0] > width - 3) | (edge[:, 1] > height - 3)
    if cut.mean() > 0.5:
        return LowerEnd(True, False, float("nan"), scale)
    limits = np.array([width - 1, height - 1])
    beyond = np.clip(np.round(edge + reach * normals).astype(int), 0, limits)
    within = np.clip(np.round(edge - 2 * normals).astype(int), 0, limits)
    depth = frame.known_depth
    inside = depth[within[:, 1], within[:, 0]]
    gap = inside - depth[beyond[:, 1], beyond[:, 0]]
    gap = gap[np.isfinite(gap)]
    foot = np.zeros(depth.shape, bool)
    foot[within[:, 1], within[:, 0]] = True
    points = frame.points(foot)
    low = float(np.median(points[:, 2])) if len(points) >= 3 else float("nan")
    if len(gap) == 0:
        return LowerEnd(False, False, low, scale)
    farther = np.clip(np.round(edge + GOES_ON_PX * normals).astype(int), 0, limits)
    falls = frame.heights[within[:, 1], within[:, 0]] - frame.heights[farther[:, 1], farther[:, 0]]
    smooth = np.abs(inside - depth[farther[:, 1], farther[:, 0]]) < step
    known = np.isfinite(falls)
    fall = GOES_ON_FALL + 2.0 * frame.depth_std(float(np.nanmedian(inside)))
    goes_on = bool(known.sum() >= 3 and np.mean((falls > fall)[known] & smooth[known]) > 0.4)
    return LowerEnd(bool(np.mean(gap > step) > 0.4), bool(np.mean(gap < -step) > 0.4), low, scale, goes_on)


def _down_in_picture(frame: RgbdFrame, centre: np.ndarray) -> np.ndarray:
    """Where gravity points to in the picture at a point: (u, v) in [px] per metre, shape (2,)."""
    pose, k = frame.world_T_camera, frame.intrinsics
    ends = (np.stack([centre, centre - [0.0, 0.0, 0.01]]) - pose[:3, 3]) @ pose[:3, :3]
    pixels = ends[:, :2] / np.maximum(ends[:, 2:], 0.02) * [k.fx, k.fy]
    return (pixels[1] - pixels[0]) / 0.01


def find_bottom(
    points: np.ndarray,
    end: LowerEnd,
    table: SupportPlane,
    others: Sequence[Solid],
    depth_std: float,
    around: np.ndarray | None = None,
) -> tuple[float, float]:
    """Height of the surface that carries a thing and the spread of that height, both in [m].

    Surfaces that may carry it are the table and the tops of the solids below its middle. The one nearest to the lowest
    visible points is taken if it lies within their noise; otherwise the lowest visible points themselves count: the
    thing stands on something that nobody named, or hangs. Where its lower end is hidden by something nearer, or by its
    own top because the camera looks straight down on it, the highest surface below is the best guess.

    Args:
        points: Of the thing in the world in [m], shape (n, 3).
        end: What the picture says about its lower end.
        table: Where the table is.
        others: Solids already fitted.
        depth_std: Spread of one point in [m].
        around: Points of everything else near the thing, in the world in [m], shape (m, 3). A level among them is
            believed only where the known surfaces are too far below for a thing to reach down to them.
    """
    x, y = np.median(points[:, 0]), np.median(points[:, 1])
    # The foot of a thin visible side is a small share of all points: its edge says better where it ends.
    lowest = float(np.nanmin([np.quantile(points[:, 2], 0.02), end.height]))
    surfaces = [float(table.at(x, y)), *(s.top for s in others if s.shape != "sphere" and s.covers(x, y, 0.01))]
    tolerance = 0.015 + 2.0 * depth_std
    below = [s for s in surfaces if s <= lowest + tolerance]
    nearest = max(below) if below else min(surfaces)
    if around is not None and lowest - nearest > FAR_BELOW:
        nearest = max([nearest, *(s for s in levels(around) if nearest < s <= lowest + tolerance)])
    top_only = end.drops and float(np.quantile(points[:, 2], 0.95)) - lowest < 0.012 + 2.5 * depth_std
    # A side so large would show beneath the top, however steep the view: a bar that hangs on something is a bar.
    top_only &= (lowest - nearest) * end.px_per_metre < HIDDEN_SIDE_PX
    unseen = end.hidden or top_only or end.goes_on
    if not unseen and lowest - nearest > tolerance:
        if end.drops and (lowest - nearest) * end.px_per_metre < FORESHORTENED_PX:
            return nearest, 0.5 * (lowest - nearest)  # the outline decides
        return lowest, 0.005 + depth_std
    # A guess beneath a hidden end may be wrong by all that is hidden, and by what is thin and lies beneath.
    if unseen:
        return nearest, float(np.hypot(HIDDEN_FOOT_STD, 0.3 * max(0.0, lowest - nearest - tolerance)))
    return nearest, FOOT_STD


def levels(points: np.ndarray, thickness: float = 0.01, share: float = 0.15) -> list[float]:
    """Heights at which many points lie: level surfaces, in [m], lowest first.

    Args:
        points: In the world in [m], shape (n, 3).
        thickness: Of a layer in [m].
        share: Least share of the points within a layer and its two neighbours.
    """
    if len(points) < 50:
        return []
    z = points[:, 2]
    counts, edges = np.histogram(z, bins=np.arange(z.min() - thickness, z.max() + 2 * thickness, thickness))
    full = np.convolve(counts, np.ones(3), "same")
    peaks = [
        i
        for i in range(1, len(full) - 1)
        if full[i] >= share * len(z) and full[i] >= full[i - 1] and full[i] > full[i + 1]
    ]
    found = []
    for i in peaks:
        layer = z[(z >= edges[i - 1]) & (z < edges[i + 2])]
        found.append(float(np.median(layer)))
    return found
