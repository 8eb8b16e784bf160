"""Scores from 0 to 1 of how well an outline, a size or a place agrees with the appearance of a noun."""

import numpy as np

from perception.catalogue.appearance import Appearance
from perception.geometry.outline import Outline


def outline_score(outline: Outline, appearance: Appearance) -> float:
    """How well the outline's roundness and aspect suit a noun, 0..1."""
    if appearance.outline == "round":
        # A ball of which half is hidden, or beyond the picture's edge, shows as a slice.
        longest = 2.6 / max(outline.free, 0.4) if appearance.solid == "sphere" else 2.6
        return rise(outline.roundness, 0.50, 0.66) if outline.aspect < longest else 0.0
    if appearance.outline == "vessel":  # two ellipses of different size and what lies between
        return rise(outline.roundness, 0.38, 0.50) if outline.aspect < 2.6 else 0.0
    if appearance.outline == "angular":
        return rise(-outline.roundness, -0.66, -0.50) * rise(-outline.aspect, -4.5, -3.0)
    if appearance.outline == "elongated":
        return rise(outline.aspect, 1.7, 2.5)
    return 1.0


def rise(value: float, low: float, high: float) -> float:
    """0 up to `low`, 1 from `high`, a straight line between."""
    return float(np.clip((value - low) / (high - low), 0.0, 1.0))


def equality(ratio: float) -> float:
    """1 for sides that noise alone may make unequal, falling to little: of two things the cube is the one that is."""
    return 0.3 + 0.7 * rise(-ratio, -1.8, -1.35)


def size_score(outline: Outline, appearance: Appearance, long_side: float) -> float:
    """1 within the noun's sizes, falling to 0 outside; a box seen over its corner shows up to 1.7 of its side.

    Args:
        outline: Of the blob; where part of it is hidden it may look smaller than it is.
        appearance: Of the noun.
        long_side: Longest visible side in [m].
    """
    low, high = appearance.size
    high *= 1.2 if appearance.outline in ("round", "vessel") else 1.7
    low *= max(0.3, outline.free)
    if long_side < low:
        return float(np.clip((long_side / low - 0.6) / 0.3, 0.0, 1.0))
    return float(np.clip((1.5 - long_side / high) / 0.4, 0.0, 1.0))


def stands_on_something(blob: np.ndarray, depth: np.ndarray, below_px: int = 4, step: float = 0.04) -> bool:
    """Whether depth goes on without a step at the lower edge of a blob."""
    height = blob.shape[0]
    columns = np.nonzero(blob.any(0))[0]
    lowest = height - 1 - np.argmax(blob[::-1, columns], axis=0)
    inside, outside = np.clip(lowest - 2, 0, None), np.clip(lowest + below_px, None, height - 1)
    gap = np.abs(depth[outside, columns] - depth[inside, columns])
    middle = gap[len(gap) // 4 : max(len(gap) // 4 + 1, 3 * len(gap) // 4)]
    return bool(np.isfinite(middle).any() and np.nanmedian(middle) < step)
