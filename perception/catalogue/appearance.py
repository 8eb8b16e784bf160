"""What colours and nouns look like: the types that detection by colour and shape and the fits share."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from perception.estimates import Shape

Kind = Literal["box", "cylinder", "sphere", "lying cylinder", "ellipsoid"]
Outline = Literal["round", "vessel", "angular", "elongated", "any"]
ANY_HUE = (0.0, 360.0)


@dataclass(frozen=True)
class Colour:
    """A colour word as a range of hue, saturation and value.

    Attributes:
        word: The word.
        hue: (from, to) in [degrees], going up; `from` is below zero where the range runs through red. None for a
            colour without a hue, such as grey.
        saturation, value: (lowest, highest), 0..1.
    """

    word: str
    hue: tuple[float, float] | None
    saturation: tuple[float, float]
    value: tuple[float, float]

    @property
    def chromatic(self) -> bool:
        """Whether it has a hue, which tells a thing from a grey table."""
        return self.hue is not None

    def matches(self, hsv: np.ndarray) -> np.ndarray:
        """Which pixels are of this colour.

        Args:
            hsv: Hue in [degrees], saturation and value 0..1, float, shape (..., 3).

        Returns:
            bool, shape (...).
        """
        low, high = ANY_HUE if self.hue is None else self.hue
        span = (hsv[..., 0] - low) % 360.0 <= high - low
        strong = (hsv[..., 1] >= self.saturation[0]) & (hsv[..., 1] <= self.saturation[1])
        return span & strong & (hsv[..., 2] >= self.value[0]) & (hsv[..., 2] <= self.value[1])


@dataclass(frozen=True)
class Appearance:
    """What a noun looks like.

    Attributes:
        noun: The noun; None for any thing whose noun is not known.
        colours: Colours tried when the phrase names none.
        outline: Shape of the outline in the picture.
        size: (lowest, highest) of the longest visible side in [m].
        solid: Solid to fit to its points.
        equal_sides: Whether the word says that it is as long as wide as high.
        hollow: Whether things lie in it rather than on it.
        kinds: Solids to try in fits, where it is not `solid` alone.
    """

    noun: str | None
    colours: tuple[str, ...]
    outline: Outline
    size: tuple[float, float]
    solid: Shape
    equal_sides: bool
    hollow: bool
    kinds: tuple[Kind, ...]
