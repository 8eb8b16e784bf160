"""One thing in several pieces: what stands before it hides its middle.

The outline of a convex thing is convex. Two pieces may be of one thing if all that their common hull holds beyond them
is hidden by something nearer than they are: a bar behind two door handles shows as three pieces.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

NEARER = 0.006  # what hides a thing is nearer by this in [m] at least: by more than the noise of some hundred pixels
LARGEST_GAP = 0.5  # what is hidden between two pieces is at most this share of them: more is a guess
LEAST_GAP_PX = 12  # smaller holes between pieces are the detector's own
MOST_PIECES = 12  # of one colour, the largest, that are held against each other


@dataclass(frozen=True)
class CutBlob:
    """Pixels of one thing.

    Attributes:
        pixels: Where it is seen, bool, shape (height, width).
        behind: Where it goes on behind something nearer, bool, same shape; None if nothing cuts it.
    """

    pixels: NDArray[np.bool_]
    behind: NDArray[np.bool_] | None = None

    @property
    def whole(self) -> np.ndarray:
        """Both."""
        return self.pixels if self.behind is None else self.pixels | self.behind


def join_cut(blobs: Sequence[np.ndarray], depth: np.ndarray) -> list[CutBlob]:
    """Pieces of one appearance, and besides them what two or more of them may be together.

    Args:
        blobs: Pieces, each bool, shape (height, width).
        depth: In [m], NaN where unknown, same shape.

    Returns:
        Every piece by itself, then what was joined, each with all pieces that belong together.
    """
    single = [CutBlob(blob) for blob in blobs]
    groups = sorted(single, key=lambda b: -int(b.pixels.sum()))[:MOST_PIECES]
    joined: list[CutBlob] = []
    again = len(groups) > 1
    while again:
        again = False
        pairs = [(i, j) for i in range(len(groups)) for j in range(i)]
        for i, j in sorted(pairs, key=lambda p: _apart(groups[p[0]].pixels, groups[p[1]].pixels)):
            behind = _hidden_between(groups[i], groups[j], depth)
            if behind is not None:
                both = CutBlob(groups[i].pixels | groups[j].pixels, behind)
                joined = [b for b in joined if b is not groups[i] and b is not groups[j]] + [both]
                groups = [b for k, b in enumerate(groups) if k not in (i, j)] + [both]
                again = len(groups) > 1
                break
    return [*single, *joined]


def _apart(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm(np.mean(np.nonzero(a), axis=1) - np.mean(np.nonzero(b), axis=1)))


def _hull(pixels: np.ndarray) -> np.ndarray:
    filled = np.zeros(pixels.shape, np.uint8)
    points = np.stack(np.nonzero(pixels)[::-1], -1).astype(np.int32)
    cv2.fillConvexPoly(filled, cv2.convexHull(points.reshape(-1, 1, 2)), 1)
    return filled > 0


def _hidden_between(a: CutBlob, b: CutBlob, depth: np.ndarray) -> np.ndarray | None:
    """Pixels between two pieces if something nearer hides all of them, else None."""
    pixels = a.pixels | b.pixels
    gap = _hull(pixels) & ~_hull(a.whole) & ~_hull(b.whole)
    size = int(gap.sum())
    if size < LEAST_GAP_PX or size > LARGEST_GAP * pixels.sum():
        return None
    expected = _plane(pixels, depth)
    if expected is None:
        return None
    count, labels, stats, _ = cv2.connectedComponentsWithStats(gap.astype(np.uint8), connectivity=8)
    hidden = False
    for i in range(1, count):
        if stats[i, cv2.CC_STAT_AREA] < LEAST_GAP_PX:
            continue
        v, u = np.nonzero(labels == i)
        nearer = expected(u, v) - depth[v, u]
        nearer = nearer[np.isfinite(nearer)]
        # Beside what hides it depth is mixed: the middle of all is meant, and most of them.
        if len(nearer) < LEAST_GAP_PX / 2 or np.median(nearer) < NEARER or np.mean(nearer > 0.0) < 0.8:
            return None
        hidden = True
    if not hidden:
        return None
    return (_hull(pixels) & ~pixels) if a.behind is None and b.behind is None else (_hull(a.whole | b.whole) & ~pixels)


def _plane(pixels: np.ndarray, depth: np.ndarray):
    """Depth in [m] at (u, v) of a plane through some pixels: its inverse is linear in u and v. None for too few."""
    v, u = np.nonzero(pixels & np.isfinite(depth))
    if len(v) < 30:
        return None
    inverse = 1.0 / depth[v, u]
    chosen = np.ones(len(v), bool)
    answer = np.zeros(3)
    for _ in range(3):  # pixels at a piece's edge belong to what is before or behind it
        design = np.c_[np.ones(int(chosen.sum())), u[chosen], v[chosen]]
        answer = np.linalg.lstsq(design, inverse[chosen], rcond=None)[0]
        off = np.abs(np.c_[np.ones(len(v)), u, v] @ answer - inverse)
        chosen = off <= np.quantile(off, 0.85)
    return lambda u, v: 1.0 / np.maximum(answer[0] + answer[1] * u + answer[2] * v, 0.05)
