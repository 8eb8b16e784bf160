"""Pixels that depth shows to be the support itself: masks may leave them out."""

import cv2
import numpy as np

from perception.geometry.prepared_frame import PreparedFrame


def surely_support(frame: PreparedFrame, clearance: float, foot_px: int) -> np.ndarray:
    """Pixels that are surely the support: low, like everything around them. bool, shape (height, width).

    Args:
        frame: Picture with depth.
        clearance: Pixels lower than this above the support may be the support, in [m].
        foot_px: Low pixels this near to higher ones may be a thing's foot and do not count, in [px].
    """
    known = frame.valid_depth
    smooth = cv2.medianBlur(np.where(known, frame.heights, 1.0).astype(np.float32), 3)
    low = known & (smooth < frame.support.height + clearance)
    size = 2 * foot_px + 1
    return cv2.erode(low.astype(np.uint8), np.ones((size, size), np.uint8)) > 0
