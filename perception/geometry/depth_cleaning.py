"""Which depths of a picture can be trusted: known ones, away from depth steps, in patches and not single specks.

Where single pixels are missing all over a picture, the nearest known depth stands for each of them.
"""

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


def without_pinholes(
    depth: np.ndarray, valid: np.ndarray, reach: float = 2.9, least_share: float = 0.10
) -> np.ndarray | None:
    """Depth in which unknown pixels near known ones have the nearest known depth; None where few are missing so.

    Stereo depth is missing in patches, which say something about what is there; some sensors lose every other pixel,
    which says nothing, and cuts surfaces to specks.

    Args:
        depth: In [m], shape (height, width).
        valid: Where depth is known, bool, same shape.
        reach: How far the nearest known depth may be, in [px].
        least_share: Share of the picture that has to be missing in single pixels.
    """
    unknown = (~valid).astype(np.uint8)
    patches = cv2.morphologyEx(unknown, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0
    if np.count_nonzero(~valid & ~patches) < least_share * depth.size or not valid.any():
        return None
    away, nearest = cv2.distanceTransformWithLabels(unknown, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    label = np.asarray(nearest, np.intp)
    of_label = np.zeros(int(label.max()) + 1, depth.dtype)
    of_label[label[valid]] = depth[valid]
    return np.where(valid, depth, np.where(away <= reach, of_label[label], np.nan)).astype(depth.dtype)
