"""What a thing rests on: the table, the top of another thing, or something that nobody named."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from perception.solids import Solid
from perception.support import SupportPlane

FAR_BELOW = 0.10  # a hidden lower end longer than this in [m] more likely rests on something that nobody named


@dataclass(frozen=True)
class LowerEnd:
    """What the picture says about the lower end of a thing.

    Attributes:
        hidden: Something nearer covers it, or the picture ends there.
        drops: Beyond it depth falls away: the thing hangs in the air, or its own top hides what is beneath.
    """

    hidden: bool
    drops: bool


def lower_end(mask: np.ndarray, depth: np.ndarray, below_px: int = 5, step: float = 0.02) -> LowerEnd:
    """Look across the lower edge of a mask.

    Args:
        mask: Pixels of the thing, bool, shape (height, width).
        depth: In [m], NaN where unknown, same shape.
        below_px: How far below the mask's lower edge to look in [px].
        step: By how much depth must change to count in [m].
    """
    columns = np.nonzero(mask.any(0))[0]
    if len(columns) == 0:
        return LowerEnd(True, False)
    height = mask.shape[0]
    columns = columns[len(columns) // 5 : max(len(columns) // 5 + 1, 4 * len(columns) // 5)]
    lowest = height - 1 - np.argmax(mask[::-1, columns], axis=0)
    if np.mean(lowest >= height - 2) > 0.5:
        return LowerEnd(True, False)
    outside = depth[np.clip(lowest + below_px, None, height - 1), columns]
    inside = depth[np.clip(lowest - 2, 0, None), columns]
    gap = (inside - outside)[np.isfinite(inside - outside)]
    if len(gap) == 0:
        return LowerEnd(False, False)
    return LowerEnd(bool(np.mean(gap > step) > 0.4), bool(np.mean(gap < -step) > 0.4))


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
    lowest = float(np.quantile(points[:, 2], 0.02))
    surfaces = [float(table.at(x, y)), *(s.top for s in others if s.shape != "sphere" and s.covers(x, y, 0.01))]
    tolerance = 0.015 + 2.0 * depth_std
    below = [s for s in surfaces if s <= lowest + tolerance]
    nearest = max(below) if below else min(surfaces)
    if around is not None and lowest - nearest > FAR_BELOW:
        nearest = max([nearest, *(s for s in levels(around) if nearest < s <= lowest + tolerance)])
    top_only = end.drops and float(np.quantile(points[:, 2], 0.95)) - lowest < 0.012 + 2.5 * depth_std
    unseen = end.hidden or top_only
    if not unseen and lowest - nearest > tolerance:
        return lowest, 0.005 + depth_std
    # A guess beneath a hidden end may be wrong by all that is hidden.
    return nearest, 0.0015 + (0.3 * max(0.0, lowest - nearest - tolerance) if unseen else 0.0)


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
