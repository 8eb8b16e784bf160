"""Which colour a thing has, in a word: by the pixels that it was seen in."""

from collections.abc import Sequence

import cv2
import numpy as np

from perception.catalogue.catalogue import Catalogue, builtin_catalogue
from perception.estimates import Evidence
from perception.frames import RgbdFrame

LEAST_PX = 12  # fewer pixels say nothing
EDGE_PX = 1  # pixels this near to a mask's edge are mixed with what lies behind


def colour_of(
    evidence: Sequence[Evidence], frames: Sequence[RgbdFrame], catalogue: Catalogue | None = None
) -> str | None:
    """Colour word of what several cameras saw, or None where it is undecided.

    Args:
        evidence: Masks of the thing.
        frames: The pictures that they were cut from, found by the camera's name.
        catalogue: Of colours; the built-in one if None.
    """
    parts = []
    for item in evidence:
        frame = next((f for f in frames if f.camera == item.camera and f.depth.shape == item.mask.shape), None)
        if frame is not None:
            size = 2 * EDGE_PX + 1
            inner = cv2.erode(item.mask.astype(np.uint8), np.ones((size, size), np.uint8)) > 0
            parts.append(frame.colour[inner if inner.sum() >= LEAST_PX else item.mask])
    return colour_word(np.concatenate(parts), catalogue) if parts else None


def colour_word(pixels: np.ndarray, catalogue: Catalogue | None = None) -> str | None:
    """Colour word for the median of some pixels, or None where no word fits it, or two do equally well.

    The brighter half of the pixels counts: faces in the shade are darker than the thing, and those in light are not
    much brighter. Where the ranges of two words hold the median, the word wins that more of the pixels have.

    Args:
        pixels: RGB, uint8, shape (n, 3).
        catalogue: Of colours; the built-in one if None.
    """
    if len(pixels) < LEAST_PX:
        return None
    brightness = pixels.max(1)
    lit = pixels[brightness >= np.median(brightness)]
    middle = np.median(lit, axis=0).astype(np.uint8)
    fitting = [c for c in (catalogue or builtin_catalogue()).colours.values() if c.matches(_hsv(middle[None]))[0]]
    if len(fitting) > 1:
        hsv = _hsv(lit)
        shares = [float(c.matches(hsv).mean()) for c in fitting]
        fitting = [c for c, share in zip(fitting, shares, strict=True) if share == max(shares)]
    return fitting[0].word if len(fitting) == 1 else None


def _hsv(pixels: np.ndarray) -> np.ndarray:
    """Hue in [degrees], saturation and value 0..1 of RGB pixels, float32, shape (n, 3)."""
    return cv2.cvtColor(pixels[None].astype(np.float32) / 255.0, cv2.COLOR_RGB2HSV)[0]
