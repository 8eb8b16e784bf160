"""Straight pictures out of those of a lens that bends: each pixel of the straight one is looked up in the bent one."""

import cv2
import numpy as np


class Straightening:
    """The look-up for one lens.

    Args:
        bent: Where each pixel of the straight picture is in the bent one, (x, y) in [px], shape (height, width, 2).
    """

    def __init__(self, bent: np.ndarray) -> None:
        self._x, self._y = (np.ascontiguousarray(bent[:, :, i], np.float32) for i in range(2))

    def colour(self, colour: np.ndarray) -> np.ndarray:
        """A straight colour picture, shape (height, width, 3); black from outside."""
        return cv2.remap(colour, self._x, self._y, cv2.INTER_LINEAR)

    def depth(self, depth: np.ndarray) -> np.ndarray:
        """A straight depth picture in [m], each pixel from its nearest, NaN from outside; shape (height, width)."""
        return cv2.remap(
            depth, self._x, self._y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=(np.nan,)
        )
