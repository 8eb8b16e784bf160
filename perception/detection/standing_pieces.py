"""Which pixels of a box depth alone gives to the thing in it, and which to what stands before or beside it.

Pieces stand above the level that surrounds the box and hang together without a depth step. Of several in one box the
thing is the one whose own box is most like the given one: what stands before a thing and hides its middle may have more
pixels, but it ends elsewhere.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.geometry.prepared_frame import PreparedFrame
from perception.geometry.resting import levels

LEAST_PIECE = 50  # smaller pieces in a box tell nothing, in [px]
GOOD_FIT, BETTER_FIT = 0.95, 0.02  # of a piece's own box and the given one: no other is looked for; what counts as more


@dataclass(frozen=True)
class PieceSettings:
    """How pieces are told apart.

    Attributes:
        standing: Pixels higher than this above the level around a box, and the noise, stand, in [m].
        depth_step: Pieces of standing pixels are cut where depth jumps by more, in [m].
        own_share: Share of such a piece that must lie within the box for all of it to be the thing.
        touching: Width of the rim of the box that is left to colour otherwise, as a share of its sides.
        rival_share: Of several pieces in a box those count that have this share of the largest one's pixels in it.
        filled: A piece whose own box overlaps the given one by this is the thing (intersection over union): what
            stands before it on its own foot is not.
        foot: How far the lowest pixels of what stands on its own foot lie above the level at most, in [m].
        mixed_px: Pixels this near to a piece that is not the thing are not it either, in [px].
    """

    standing: float = 0.006
    depth_step: float = 0.015
    own_share: float = 0.85
    touching: float = 0.2
    rival_share: float = 0.2
    filled: float = 0.75
    foot: float = 0.012
    mixed_px: int = 2


@dataclass(frozen=True)
class StandingPieces:
    """What depth alone says about the pixels around a box.

    Attributes:
        own: Pixels of the thing in the box, bool, shape of the crop.
        foreign: Pixels of other things, which a depth edge parts from it, bool, same shape.
    """

    own: NDArray[np.bool_]
    foreign: NDArray[np.bool_]


@dataclass(frozen=True)
class _LevelCut:
    """Pieces that stand above one level.

    Attributes:
        lowest: Height from which pixels stand in [m].
        labels: Number of each pixel's piece, 0 for none, shape of the crop.
        areas: Pixels of each piece.
        within: Those of them in the box.
        fit: Of the larger pieces in the box, how much their own boxes overlap it, 0..1.
        best: The one that fits best.
    """

    lowest: float
    labels: np.ndarray
    areas: np.ndarray
    within: np.ndarray
    fit: dict[int, float]
    best: int


def standing_pieces(
    frame: PreparedFrame, crop: tuple[slice, slice], box: tuple[slice, slice], settings: PieceSettings
) -> StandingPieces | None:
    """What depth alone gives to the thing in a box, and what to other things; None if depth cannot tell.

    Args:
        frame: The picture.
        crop: Rows and columns of the box and what surrounds it.
        box: Rows and columns of the box in the crop.
        settings: How pieces are told apart.
    """
    heights = frame.heights[crop].astype(np.float32)
    depth = frame.known_depth[crop]
    inside = np.zeros(heights.shape, bool)
    inside[box] = True
    cut = _best_cut(frame, crop, heights, inside, box, settings)
    if cut is None:
        return None
    own = cut.labels == cut.best
    foreign = np.zeros(own.shape, bool)
    for i in np.nonzero(cut.within >= LEAST_PIECE)[0]:
        if i == cut.best:
            continue
        piece = cut.labels == i
        other = cut.within[i] < settings.own_share * cut.areas[i]  # most of it lies elsewhere
        if not other and cut.fit[cut.best] > settings.filled and i in cut.fit:
            on_foot = float(np.quantile(heights[piece], 0.02)) < cut.lowest + settings.foot
            other = on_foot and bool(np.median(depth[piece]) < np.median(depth[own]))
        if other:
            foreign |= piece
    if foreign.any():
        size = 2 * settings.mixed_px + 1
        foreign = cv2.dilate(foreign.astype(np.uint8), np.ones((size, size), np.uint8)) > 0
    if cut.within[cut.best] < settings.own_share * cut.areas[cut.best]:
        # Something that touches the thing is in this piece as well: near the middle of the box it is the thing.
        rows, columns = (round(settings.touching * (part.stop - part.start)) for part in box)
        inside[:] = False
        inside[box[0].start + rows : box[0].stop - rows, box[1].start + columns : box[1].stop - columns] = True
    return StandingPieces(own & inside, foreign & ~own)


def _best_cut(
    frame: PreparedFrame,
    crop: tuple[slice, slice],
    heights: np.ndarray,
    inside: np.ndarray,
    box: tuple[slice, slice],
    settings: PieceSettings,
) -> _LevelCut | None:
    """Pieces above that level around a box which gives the piece that fits the box best; None without any."""
    known = np.isfinite(heights)
    middle = heights[inside & known]
    if len(middle) < LEAST_PIECE:
        return None
    around = levels(np.c_[np.zeros((int((known & ~inside).sum()), 2)), heights[known & ~inside]])
    # What stands behind the thing may show a level too, but a higher one.
    below = [z for z in around if z < np.median(middle)]
    noise = frame.depth_std(float(np.nanmedian(frame.known_depth[crop][inside])))
    whole = known & ~frame.depth_steps(settings.depth_step)[crop]
    best: _LevelCut | None = None
    for level in below[::-1]:
        cut = _cut_at(level + settings.standing + noise, heights, whole, inside, box, settings)
        # A level beside the box may be the top of another thing: what goes on beneath it and still fits is better.
        if cut is not None and (best is None or cut.fit[cut.best] > best.fit[best.best] + BETTER_FIT):
            best = cut
        if best is not None and best.fit[best.best] > GOOD_FIT:
            break
    return best


def _cut_at(
    lowest: float,
    heights: np.ndarray,
    whole: np.ndarray,
    inside: np.ndarray,
    box: tuple[slice, slice],
    settings: PieceSettings,
) -> _LevelCut | None:
    """Pieces of what stands higher than `lowest` [m]; None if no piece in the box is large enough.

    Args:
        lowest: In [m].
        heights: In [m], NaN where unknown, shape of the crop.
        whole: Pixels of known depth away from depth steps, bool, same shape.
        inside: Pixels of the box, bool, same shape.
        box: The same as rows and columns.
        settings: How pieces are told apart.
    """
    smooth = cv2.medianBlur(np.where(np.isfinite(heights), heights, lowest).astype(np.float32), 5)
    _, labels, stats, _ = cv2.connectedComponentsWithStats((whole & (smooth > lowest)).astype(np.uint8), connectivity=4)
    within = np.bincount(labels[inside], minlength=len(stats))
    within[0] = 0
    if within.max() < LEAST_PIECE:
        return None
    rivals = np.nonzero(within >= max(LEAST_PIECE, settings.rival_share * within.max()))[0]
    fit = {int(i): _box_overlap(stats[i], box) for i in rivals}
    return _LevelCut(lowest, labels, stats[:, cv2.CC_STAT_AREA], within, fit, max(fit, key=lambda i: fit[i]))


def _box_overlap(stats: np.ndarray, box: tuple[slice, slice]) -> float:
    """Overlap (intersection over union) of a piece's own box with a box, 0..1.

    Args:
        stats: Of the piece, a row of OpenCV's `connectedComponentsWithStats`.
        box: Rows and columns, in the same picture.
    """
    left, top, width, height, _ = (int(n) for n in stats)
    across = min(left + width, box[1].stop) - max(left, box[1].start)
    down = min(top + height, box[0].stop) - max(top, box[0].start)
    common = max(across, 0) * max(down, 0)
    given = (box[0].stop - box[0].start) * (box[1].stop - box[1].start)
    return common / max(width * height + given - common, 1)
