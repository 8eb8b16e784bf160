"""Which depths of a picture can be trusted: known ones, away from depth steps, in patches and not single specks."""

import cv2
import numpy as np
from scipy import ndimage


def known_depth(depth: np.ndarray) -> np.ndarray:
    """Where depth is a finite number above zero, bool, shape (height, width)."""
    return np.isfinite(depth) & (depth > 0)


def depth_steps(depth: np.ndarray, valid: np.ndarray, step: float = 0.03, radius: int = 1) -> np.ndarray:
    """Pixels beside a depth step, where stereo depth mixes front and back.

    Args:
        depth: In [m], shape (height, width).
        valid: Where depth is known, bool, same shape.
        step: Smallest step in [m].
        radius: How far beside, in [px].

    Returns:
        bool, shape (height, width).
    """
    size = 2 * radius + 1
    highest = ndimage.maximum_filter(np.where(valid, depth, -np.inf), size)
    lowest = ndimage.minimum_filter(np.where(valid, depth, np.inf), size)
    return valid & (highest - lowest > step)


def speckles(depth: np.ndarray, valid: np.ndarray, largest: int = 25, step: float = 0.02) -> np.ndarray:
    """Small patches of depth that belong to nothing around them: wrong matches.

    A patch is a connected set of pixels (4 neighbours) in which neighbours differ by at most `step`.

    Args:
        depth: In [m], shape (height, width).
        valid: Where depth is known, bool, same shape.
        largest: Patches of up to this many pixels are speckles.
        step: In [m].

    Returns:
        bool, shape (height, width).
    """
    # OpenCV's filter works on 16-bit whole numbers: millimetres reach to 32 m, 0 stands for unknown.
    millimetres = np.where(valid, np.clip(1e3 * np.where(valid, depth, 0.0), 1.0, 32767.0), 0.0).astype(np.int16)
    kept = millimetres.copy()
    cv2.filterSpeckles(kept, 0.0, largest, 1e3 * step)
    return (millimetres > 0) & (kept == 0)


def trusted_depth(depth: np.ndarray, step: float = 0.03, radius: int = 1, largest: int = 25) -> np.ndarray:
    """Where depth is known, away from steps and no speckle; bool, shape (height, width).

    Args:
        depth: In [m]; NaN, infinite, zero and negative numbers are unknown. Shape (height, width).
        step, radius: As in `depth_steps`.
        largest: As in `speckles`.
    """
    known = known_depth(depth)
    return known & ~depth_steps(depth, known, step, radius) & ~speckles(depth, known, largest)
