"""Which depths of a picture can be trusted: known ones, away from depth steps, in patches and not single specks."""

import cv2
import numpy as np


def neighbour_range(depth: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Highest minus lowest known depth among each pixel and its eight neighbours in [m], shape (height, width).

    Args:
        depth: In [m], shape (height, width).
        valid: Where depth is known, bool, same shape. Elsewhere the result means nothing.
    """
    size = np.ones((3, 3), np.uint8)
    far = np.finfo(depth.dtype).max
    return cv2.dilate(np.where(valid, depth, 0), size) - cv2.erode(np.where(valid, depth, far), size)


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
