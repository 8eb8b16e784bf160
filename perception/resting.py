"""What a thing rests on: the table, the top of another thing, or something that nobody named."""

from collections.abc import Sequence

import numpy as np

from perception.solids import Solid
from perception.support import SupportPlane


def lower_end_is_hidden(mask: np.ndarray, depth: np.ndarray, below_px: int = 5, nearer: float = 0.02) -> bool:
    """Whether something nearer covers the lower end of a mask, or the picture ends there.

    Args:
        mask: Pixels of the thing, bool, shape (height, width).
        depth: In [m], NaN where unknown, same shape.
        below_px: How far below the mask's lower edge to look in [px].
        nearer: By how much the cover is nearer than the thing in [m].
    """
    columns = np.nonzero(mask.any(0))[0]
    if len(columns) == 0:
        return True
    height = mask.shape[0]
    columns = columns[len(columns) // 5 : max(len(columns) // 5 + 1, 4 * len(columns) // 5)]
    lowest = height - 1 - np.argmax(mask[::-1, columns], axis=0)
    if np.mean(lowest >= height - 2) > 0.5:
        return True
    outside = depth[np.clip(lowest + below_px, None, height - 1), columns]
    inside = depth[np.clip(lowest - 2, 0, None), columns]
    gap = (inside - outside)[np.isfinite(inside - outside)]
    return bool(len(gap) > 0 and np.mean(gap > nearer) > 0.4)


def find_bottom(
    points: np.ndarray,
    hidden: bool,
    table: SupportPlane,
    others: Sequence[Solid],
    depth_std: float,
) -> tuple[float, float]:
    """Height of the surface that carries a thing and the spread of that height, both in [m].

    Surfaces that may carry it are the table and the tops of the solids below its middle. The one nearest to the lowest
    visible points is taken if it lies within their noise; otherwise the lowest visible points themselves count,
    unless something hides them: then the highest surface below them is the best guess.

    Args:
        points: Of the thing in the world in [m], shape (n, 3).
        hidden: Whether its lower end is hidden (`lower_end_is_hidden`).
        table: Where the table is.
        others: Solids already fitted.
        depth_std: Spread of one point in [m].
    """
    x, y = np.median(points[:, 0]), np.median(points[:, 1])
    lowest = float(np.quantile(points[:, 2], 0.02))
    surfaces = [float(table.at(x, y)), *(s.top for s in others if s.shape != "sphere" and s.covers(x, y, 0.01))]
    tolerance = 0.015 + 2.0 * depth_std
    below = [s for s in surfaces if s <= lowest + tolerance]
    nearest = max(below) if below else min(surfaces)
    if not hidden and lowest - nearest > tolerance:
        return lowest, 0.005 + depth_std
    # A guess beneath a hidden end may be wrong by all that is hidden.
    return nearest, 0.0015 + (0.3 * max(0.0, lowest - nearest - tolerance) if hidden else 0.0)
