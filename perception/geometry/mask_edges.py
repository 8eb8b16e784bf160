"""What lies beyond a mask's edge: whether the thing ends there, or only what is seen of it.

A thing ends where depth falls away beyond its edge, and at its foot, where the surface goes on that carries it. It does
not where something nearer begins, where the picture ends, or where nothing is known: there the edge is a lower bound.
Where depth goes on as it was, something touches it, and only colour says where one ends and the other begins.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from perception.geometry.outline import outward_normals
from perception.geometry.prepared_frame import PreparedFrame

REACHES_PX = (3.0, 5.0, 8.0)  # how far beyond an edge the first known depth is looked for
INSIDE_PX = 3.0  # depth of the thing is taken so far within its edge
FAR_INSIDE_PX = (
    8.0  # where even this far within its edge a mask is no higher than its foot, it is spilt over the carrier
)
UNKNOWN_WEIGHT = 0.3  # of a contour point beyond which depth is unknown, where one that is no end counts 1
FAR_BEYOND_PX = 10.0  # what carries a thing is level up to here beyond its foot
STEP = 0.015  # by how much depth must change to count in [m]
CLEARANCE = 0.006  # what is at most so far from the level of a foot, and the noise, may be what carries it, in [m]


@dataclass(frozen=True)
class MaskEdges:
    """Every point of a mask's contour by what lies beyond it; each bool, shape (n,).

    Attributes:
        ends: Depth falls away, or what carries the thing begins: the thing's own end.
        hidden: Something nearer begins, or what stands on the thing.
        cut: The picture ends.
        unknown: Depth is unknown for some pixels beyond.
        touching: Depth goes on and is not the carrier's: something touches the thing, or the mask ends too early.
        spilt: The carrier goes on from within the mask: the mask ends too late.
    """

    ends: NDArray[np.bool_]
    hidden: NDArray[np.bool_]
    cut: NDArray[np.bool_]
    unknown: NDArray[np.bool_]
    touching: NDArray[np.bool_]
    spilt: NDArray[np.bool_]

    @property
    def unseen_share(self) -> float:
        """Share of the contour where nothing shows that the thing ends there, 0..1.

        Depth is often unknown beside a true end, where one eye of the camera sees what the other does not: such a
        point counts less.
        """
        if not len(self.ends):
            return 1.0
        return float(np.mean(~self.ends) - (1.0 - UNKNOWN_WEIGHT) * np.mean(self.unknown))


def mask_edges(
    frame: PreparedFrame, contour: np.ndarray, mask: np.ndarray, foot: float, covering: np.ndarray | None = None
) -> MaskEdges:
    """Look across the edge of a mask.

    Args:
        frame: The picture.
        contour: Border pixels (x, y) of the mask, in order, int, shape (n, 2).
        mask: bool, shape (height, width).
        foot: Height of what carries the thing in the world in [m].
        covering: Pixels of things that stand on or in the thing, bool, same shape, or None.
    """
    width, height = frame.intrinsics.width, frame.intrinsics.height
    limits = np.array([width - 1, height - 1])
    normals = outward_normals(contour)
    x, y = contour[:, 0], contour[:, 1]
    cut = (x <= 1) | (y <= 1) | (x >= width - 2) | (y >= height - 2)
    within = np.clip(np.round(contour - INSIDE_PX * normals).astype(int), 0, limits)
    inner = frame.known_depth[within[:, 1], within[:, 0]]
    beside = frame.known_depth[y, x]
    inner = np.where(np.isfinite(inner), inner, beside)
    outer, rise = np.full(len(contour), np.nan), np.full(len(contour), np.nan)
    covered = np.zeros(len(contour), bool)
    for reach in REACHES_PX:
        beyond = np.clip(np.round(contour + reach * normals).astype(int), 0, limits)
        depth = frame.known_depth[beyond[:, 1], beyond[:, 0]]
        fresh = ~np.isfinite(outer) & np.isfinite(depth) & ~mask[beyond[:, 1], beyond[:, 0]]
        outer[fresh] = depth[fresh]
        rise[fresh] = frame.heights[beyond[:, 1], beyond[:, 0]][fresh] - foot
        if covering is not None and reach == REACHES_PX[0]:
            covered = covering[beyond[:, 1], beyond[:, 0]]
    gap = inner - outer
    noise = frame.depth_std(float(np.nanmedian(inner))) if np.isfinite(inner).any() else 0.0
    step = STEP + 2.0 * noise
    known = np.isfinite(gap) & ~cut
    # What carries a thing goes on level beyond its foot; the thing's own side, where a mask ends too early, goes down.
    tolerance = CLEARANCE + noise
    farther = np.clip(np.round(contour + FAR_BEYOND_PX * normals).astype(int), 0, limits)
    far_rise = frame.heights[farther[:, 1], farther[:, 0]] - foot
    carried = known & (np.abs(rise) < tolerance) & ~(np.abs(far_rise) > tolerance)
    far_inside = np.clip(np.round(contour - FAR_INSIDE_PX * normals).astype(int), 0, limits)
    low = frame.heights[far_inside[:, 1], far_inside[:, 0]] - foot < CLEARANCE
    spilt = carried & (np.abs(gap) <= step) & low & mask[far_inside[:, 1], far_inside[:, 0]]
    ends = known & ~spilt & ((gap < -step) | (carried & (gap <= step))) & ~(covered & (gap > -step))
    hidden = known & ((gap > step) | covered) & ~ends & ~spilt
    unknown = ~np.isfinite(gap) & ~cut
    return MaskEdges(ends, hidden, cut, unknown, known & ~ends & ~hidden & ~spilt, spilt)
