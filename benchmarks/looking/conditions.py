"""What is done to a frame's depth before perception sees it: parts of it lost, or all of it wrong by one factor."""

from dataclasses import replace

import cv2
import numpy as np

from perception.errors import FrameError
from perception.frames import RgbdFrame

BLOB_PX = 4.0  # size of the patches in which depth is lost, in [px]


def under_condition(frame: RgbdFrame, condition: str, rng: np.random.Generator) -> RgbdFrame:
    """The frame as a worse camera gives it.

    Args:
        frame: As it is.
        condition: "plain"; "dropout:SHARE", of whose pixels depth is lost, in patches; or "scale:FACTOR", by which all
            depth is wrong.
        rng: Draws the patches.

    Raises:
        FrameError: Another condition.
    """
    kind, _, text = condition.partition(":")
    if kind == "plain" and not text:
        return frame
    try:
        value = float(text)
    except ValueError:
        kind = ""
    else:
        if kind == "scale" and value > 0.0:
            return replace(frame, depth=(frame.depth * value).astype(np.float32))
        if kind == "dropout" and 0.0 <= value < 1.0:
            drawn = cv2.GaussianBlur(rng.standard_normal(frame.depth.shape).astype(np.float32), (0, 0), BLOB_PX)
            lost = drawn < np.quantile(drawn, value)
            return replace(frame, depth=np.where(lost, np.nan, frame.depth).astype(np.float32))
    raise FrameError(f"there is no condition '{condition}'; there are plain, dropout:SHARE (0 to 1) and scale:FACTOR")
