"""What a sensor_msgs/CameraInfo says about a lens, and straight pictures out of distorted ones. Needs OpenCV."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.errors import FrameError
from perception.frames import CameraIntrinsics

MODELS = ("plumb_bob", "rational_polynomial")  # those whose coefficients OpenCV takes as they are


@dataclass(frozen=True)
class Lens:
    """A lens.

    Attributes:
        intrinsics: Of its straight pictures.
        distortion: Coefficients of OpenCV's model of its own pictures, shape (n,); None where they are straight.
    """

    intrinsics: CameraIntrinsics
    distortion: NDArray[np.float64] | None = None

    def straight_colour(self, colour: np.ndarray) -> np.ndarray:
        """A colour picture as a lens without distortion would take it; shape (height, width, 3)."""
        if self.distortion is None:
            return colour
        return cv2.undistort(colour, self.intrinsics.matrix, self.distortion)

    def straight_depth(self, depth: np.ndarray) -> np.ndarray:
        """A depth picture likewise, each pixel from its nearest one, NaN from outside; shape (height, width)."""
        if self.distortion is None:
            return depth
        matrix, size = self.intrinsics.matrix, (self.intrinsics.width, self.intrinsics.height)
        x, y = cv2.initUndistortRectifyMap(matrix, self.distortion, np.eye(3), matrix, size, cv2.CV_32FC1)
        return cv2.remap(depth, x, y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=(np.nan,))


def is_rectified(topic: str) -> bool:
    """Whether the name of a topic says that its pictures are straight, as image_proc and stereo drivers name them."""
    *folders, last = topic.split("/")
    return "rect" in last or "rect" in folders


def lens_of(info: Any, rectified: bool) -> Lens:
    """The lens of a CameraInfo.

    Args:
        info: sensor_msgs/CameraInfo.
        rectified: Whether the pictures are straight already: P holds then, else K and D.

    Raises:
        FrameError: It was not calibrated, or its distortion is of a model that is not known.
    """
    k = np.array(info.k, float).reshape(3, 3)
    p = np.array(info.p, float).reshape(3, 4)
    matrix = p[:, :3] if rectified and p[0, 0] > 0 else k
    if not (matrix[0, 0] > 0 and matrix[1, 1] > 0 and np.isfinite(matrix).all()):
        raise FrameError(
            f"its CameraInfo is not calibrated (fx {matrix[0, 0]:g}, fy {matrix[1, 1]:g}); say --intrinsics with a file"
        )
    intrinsics = CameraIntrinsics(
        info.width, info.height, matrix[0, 0], matrix[1, 1], float(matrix[0, 2]), float(matrix[1, 2])
    )
    distortion = np.array(info.d, float)
    if rectified or not np.any(distortion):
        return Lens(intrinsics)
    if info.distortion_model not in MODELS or len(distortion) not in (4, 5, 8):
        raise FrameError(
            f"its CameraInfo has {len(distortion)} coefficients of the model '{info.distortion_model}'; valid are 4, 5 "
            f"or 8 of {' or '.join(MODELS)}; rectify the pictures first"
        )
    return Lens(intrinsics, distortion)
