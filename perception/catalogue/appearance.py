"""What nouns and colour words look like: one typed table that the colour-and-shape detector and the fits share.

Sizes are ranges of everyday things and of toys that a two-finger hand can hold, not of one scene.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from perception.errors import UnknownPhraseError
from perception.estimates import Shape

Kind = Literal["box", "cylinder", "sphere", "lying cylinder", "ellipsoid"]
Outline = Literal["round", "vessel", "angular", "elongated", "any"]


@dataclass(frozen=True)
class Colour:
    """A colour word as a range of hue, saturation and value.

    Attributes:
        word: The word.
        hue: (from, to) in [degrees], going up; `from` is below zero where the range runs through red.
        saturation, value: (lowest, highest), 0..1.
    """

    word: str
    hue: tuple[float, float]
    saturation: tuple[float, float]
    value: tuple[float, float]

    def matches(self, hsv: np.ndarray) -> np.ndarray:
        """Which pixels are of this colour.

        Args:
            hsv: Hue in [degrees], saturation and value 0..1, float, shape (..., 3).

        Returns:
            bool, shape (...).
        """
        span = (hsv[..., 0] - self.hue[0]) % 360.0 <= self.hue[1] - self.hue[0]
        strong = (hsv[..., 1] >= self.saturation[0]) & (hsv[..., 1] <= self.saturation[1])
        return span & strong & (hsv[..., 2] >= self.value[0]) & (hsv[..., 2] <= self.value[1])


# Ranges of neighbouring words overlap on purpose (a dark orange is a brown); scores and suppression settle it.
COLOURS: dict[str, Colour] = {
    c.word: c
    for c in (
        Colour("red", (-16.0, 14.0), (0.45, 1.0), (0.15, 1.0)),
        Colour("orange", (14.0, 40.0), (0.70, 1.0), (0.45, 1.0)),
        Colour("brown", (10.0, 46.0), (0.22, 0.80), (0.12, 0.90)),
        Colour("yellow", (41.0, 66.0), (0.40, 1.0), (0.30, 1.0)),
        Colour("green", (66.0, 168.0), (0.28, 1.0), (0.12, 1.0)),
        Colour("cyan", (168.0, 196.0), (0.30, 1.0), (0.20, 1.0)),
        Colour("blue", (190.0, 255.0), (0.35, 1.0), (0.12, 1.0)),
        Colour("purple", (255.0, 305.0), (0.25, 1.0), (0.12, 1.0)),
        Colour("pink", (305.0, 346.0), (0.20, 1.0), (0.35, 1.0)),
        Colour("white", (0.0, 360.0), (0.0, 0.14), (0.72, 1.0)),
        Colour("grey", (0.0, 360.0), (0.0, 0.14), (0.25, 0.72)),
        Colour("black", (0.0, 360.0), (0.0, 1.0), (0.0, 0.16)),
    )
}
COLOUR_ALIASES = {"gray": "grey", "violet": "purple", "wooden": "brown", "magenta": "pink", "turquoise": "cyan"}
CHROMATIC = ("red", "orange", "brown", "yellow", "green", "cyan", "blue", "purple", "pink")


@dataclass(frozen=True)
class Appearance:
    """What a noun looks like.

    Attributes:
        noun: The noun.
        colours: Colours tried when the phrase names none.
        outline: Shape of the outline in the picture.
        size: (lowest, highest) of the longest visible side in [m].
        solid: Solid to fit to its points.
        equal_sides: Whether the word says that it is as long as wide as high.
        hollow: Whether things lie in it rather than on it.
        kinds: Solids to try in fits, where it is not `solid` alone.
    """

    noun: str
    colours: tuple[str, ...]
    outline: Outline
    size: tuple[float, float]
    solid: Shape
    equal_sides: bool = False
    hollow: bool = False
    kinds: tuple[Kind, ...] = ()


LOOKS: dict[str, Appearance] = {
    look.noun: look
    for look in (
        Appearance("cube", CHROMATIC, "angular", (0.02, 0.12), "box", equal_sides=True),
        Appearance("block", CHROMATIC, "angular", (0.02, 0.20), "box"),
        Appearance("box", CHROMATIC, "angular", (0.03, 0.50), "box"),
        Appearance("crate", ("brown",), "angular", (0.08, 0.60), "box"),
        Appearance("bar", CHROMATIC, "elongated", (0.08, 0.60), "box"),
        Appearance("apple", ("red", "green"), "round", (0.045, 0.11), "sphere"),
        Appearance("orange", ("orange",), "round", (0.045, 0.11), "sphere"),
        Appearance("lemon", ("yellow",), "round", (0.04, 0.14), "sphere", kinds=("ellipsoid",)),
        Appearance("ball", CHROMATIC, "round", (0.02, 0.25), "sphere"),
        Appearance("banana", ("yellow",), "elongated", (0.11, 0.26), "box"),
        Appearance(
            "bowl", ("blue", "white", "cyan", "green", "orange"), "vessel", (0.08, 0.32), "cylinder", hollow=True
        ),
        Appearance("plate", ("blue", "white", "cyan", "green"), "round", (0.10, 0.35), "cylinder", hollow=True),
        Appearance("cylinder", CHROMATIC, "any", (0.03, 0.20), "cylinder"),
        Appearance("can", CHROMATIC, "any", (0.05, 0.20), "cylinder", kinds=("cylinder", "lying cylinder", "box")),
        Appearance("cup", (*CHROMATIC, "white"), "any", (0.05, 0.16), "cylinder", hollow=True),
    )
}
ANY_THING = Appearance("thing", CHROMATIC, "any", (0.015, 0.60), "box")


@dataclass(frozen=True)
class Query:
    """A phrase in terms of the table.

    Attributes:
        phrase: The phrase.
        colours: Colours to look for, each by itself.
        look: What the noun looks like; `ANY_THING` for a noun that the table lacks but that has a colour word.
    """

    phrase: str
    colours: tuple[Colour, ...]
    look: Appearance


def parse_phrase(phrase: str) -> Query:
    """Read colour words and a noun out of a phrase such as "red cube" or "the small green block".

    Raises:
        UnknownPhraseError: Neither a noun of the table nor a colour word.
    """
    words = phrase.lower().replace("_", " ").replace("-", " ").split()
    words = [w.strip(".,;:!?\"'") for w in words]
    # "orange" is a colour before a noun and a fruit at the end.
    noun = next((LOOKS[w] for w in reversed(words) if w in LOOKS), None)
    noun_at = max((i for i, w in enumerate(words) if w in LOOKS), default=len(words))
    named = [COLOUR_ALIASES.get(w, w) for i, w in enumerate(words) if i != noun_at]
    colours = tuple(COLOURS[w] for w in dict.fromkeys(named) if w in COLOURS)
    if noun is None and not colours:
        raise UnknownPhraseError(
            f"the colour-and-shape detector cannot look for '{phrase}': it knows the nouns {sorted(LOOKS)} "
            f"and, for any other noun, needs one of the colours {sorted(COLOURS)}; "
            "name one of these or choose a learned detector"
        )
    look = noun or ANY_THING
    return Query(phrase, colours or tuple(COLOURS[c] for c in look.colours), look)


def appearance_of(phrase: str) -> Appearance:
    """What the thing that a phrase names looks like; `ANY_THING` for nouns that the table lacks."""
    try:
        return parse_phrase(phrase).look
    except UnknownPhraseError:
        return ANY_THING
