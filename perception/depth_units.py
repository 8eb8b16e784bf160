"""Metres out of depth pictures of whole numbers, and when a unit that nobody wrote down may be assumed."""

import numpy as np

from perception.errors import FrameError

MILLIMETRE = 0.001  # [m]; what most depth cameras count in
# [m]; where the middle of a picture of a bench lies. Cameras over a table stand 0.3 to 2 m away; stereo depth of 10 m
# has decimetres of noise. A picture in tenths of millimetres read as millimetres lies ten times too far.
PLAUSIBLE = (0.15, 5.0)


def checked_scale(said: float | None, picture: np.ndarray | None, what: str) -> tuple[float, str]:
    """Metres per unit of a depth picture, and a note where it was assumed.

    Args:
        said: What the recording or the user says, in [m]; None if nobody does.
        picture: A first depth picture of whole numbers, 0 where unknown, any shape; None where there is none.
        what: Which pictures, for the message.

    Raises:
        FrameError: Nobody says the unit and millimetres would put the picture where no bench is.
    """
    if said is not None:
        if not np.isfinite(said) or said <= 0.0:
            raise FrameError(f"a depth scale of {said:g} is not valid; it is metres per unit, for instance 0.001")
        return said, ""
    known = picture[picture > 0] if picture is not None else np.zeros(0)
    if not len(known):
        return MILLIMETRE, ""
    middle = float(np.median(known)) * MILLIMETRE
    if not PLAUSIBLE[0] <= middle <= PLAUSIBLE[1]:
        raise FrameError(
            f"nothing says the unit of {what}: in millimetres half of the first would lie beyond {middle:.3g} m, "
            f"outside {PLAUSIBLE[0]:g} to {PLAUSIBLE[1]:g} m; say --depth-scale with the metres per unit, for instance "
            "0.001 for millimetres or 0.0001 for tenths of them"
        )
    return MILLIMETRE, f"nothing says the unit of the depth; taken as millimetres (half lie beyond {middle:.2f} m)"


def depth_in_metres(picture: np.ndarray, scale: float, what: str) -> np.ndarray:
    """Depth in [m], float32, NaN where unknown, of a 16-bit picture with 0 where unknown.

    Args:
        picture: uint16, shape (height, width).
        scale: Metres per unit.
        what: Which picture, for the message.

    Raises:
        FrameError: The picture is not of that kind.
    """
    if picture.ndim != 2 or picture.dtype != np.uint16:
        raise FrameError(
            f"{what} is {picture.dtype} of shape {picture.shape}; "
            "it must be a 16-bit picture of one channel (metres = value x depth_scale, 0 = unknown)"
        )
    return np.where(picture > 0, picture * np.float32(scale), np.float32(np.nan)).astype(np.float32)
