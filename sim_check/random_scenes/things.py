"""Things of random kind, size and colour out of the object library, and which words name them.

For pictures that detectors learn from and are judged on. Some things have several fair names (a long block is a box
too, an orange ball may be an orange) and some colours are a matter of opinion (a dark orange is a brown); questions
about what is absent keep away from both.
"""

from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from perception.estimates import Shape
from sim_check.cells.furniture_config import CabinetConfig, LeverConfig, MicrowaveConfig, WeightPlateConfig
from sim_check.furniture.build import furniture_model
from sim_check.furniture.model import FurnitureModel
from sim_check.objects.library import COLOURS, ObjectModel, object_model, rgb_of

# Colour words that describe nearly the same; neither is asked for where the other is.
ALIKE = (
    {"white", "grey"},
    {"grey", "black"},
    {"brown", "orange"},
    {"brown", "wooden"},
    {"orange", "wooden"},
    {"orange", "yellow"},
    {"pink", "purple"},
    {"pink", "red"},
    {"blue", "cyan"},
    {"blue", "purple"},
    {"green", "cyan"},
    {"red", "brown"},
    {"red", "orange"},
    {"brown", "black"},
)
COLOUR_WORDS = (*COLOURS, "wooden")
# Colours that go without saying.
USUAL = MappingProxyType(
    {
        "apple": ("red",),
        "lemon": ("yellow",),
        "orange": ("orange",),
        "crate": ("brown", "wooden"),
        "microwave": ("white", "grey"),
        "lever": ("red", "yellow", "green", "blue", "black"),
        "sensor": ("grey", "white", "black", "red", "blue"),
    }
)
VIVID = ("red", "orange", "yellow", "green", "cyan", "blue", "purple", "pink")


@dataclass(frozen=True)
class Kind:
    """A kind of thing that may be drawn.

    Attributes:
        noun: The library's noun that it is built as.
        names: Nouns that people may call it.
        low, high: Full sizes along its own axes in [m], each (3,); a size is drawn between them.
        equal: Axes that share one draw: "all", "xy" (round about z) or "none".
        colours: Words it may be painted with; often the first ones.
        shape: Solid that describes it.
        weight: How often it is drawn.
    """

    noun: str
    names: tuple[str, ...]
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    equal: str
    colours: tuple[str, ...]
    shape: Shape
    weight: float = 1.0


def _same(size: float) -> tuple[float, float, float]:
    return (size, size, size)


_ANY = (*VIVID, "brown", "white", "grey", "black")
_NOT_ORANGE = tuple(c for c in _ANY if c != "orange")
KINDS = (
    Kind("cube", ("cube",), _same(0.032), _same(0.065), "all", (*VIVID, *VIVID, "brown", "white", "black"), "box", 2.0),
    Kind("block", ("block", "box"), (0.06, 0.03, 0.03), (0.13, 0.06, 0.06), "none", _ANY, "box", 1.5),
    Kind("crate", ("crate",), (0.09, 0.09, 0.05), (0.16, 0.14, 0.085), "none", ("brown", "wooden", *_ANY), "box", 1.5),
    Kind("bar", ("bar",), (0.18, 0.016, 0.016), (0.30, 0.028, 0.028), "none", _ANY, "box"),
    Kind("apple", ("apple",), _same(0.058), _same(0.085), "all", ("red", "green", "yellow"), "sphere", 1.3),
    Kind("orange", ("orange", "ball"), _same(0.062), _same(0.085), "all", ("orange",), "sphere", 0.6),
    Kind("lemon", ("lemon",), (0.056, 0.044, 0.044), (0.085, 0.062, 0.062), "none", ("yellow", "green"), "sphere", 1.1),
    Kind("ball", ("ball",), _same(0.045), _same(0.085), "all", _NOT_ORANGE, "sphere"),
    Kind("can", ("can", "cylinder"), (0.055, 0.055, 0.085), (0.075, 0.075, 0.13), "xy", _ANY, "cylinder"),
    Kind("cylinder", ("cylinder", "can"), (0.04, 0.04, 0.06), (0.06, 0.06, 0.10), "xy", _ANY, "cylinder", 0.6),
    Kind("bowl", ("bowl",), (0.12, 0.12, 0.045), (0.19, 0.19, 0.075), "xy", (*VIVID, "white", "grey"), "cylinder", 1.3),
    Kind("kettle", ("kettle",), (0.12, 0.09, 0.17), (0.17, 0.13, 0.23), "none", _ANY, "box", 0.8),
)
FURNITURE_NAMES = MappingProxyType(
    {"cabinet": ("cabinet",), "microwave": ("microwave",), "lever": ("lever",), "weight_plate": ("sensor",)}
)
NOUNS = tuple(dict.fromkeys(n for names in (*(k.names for k in KINDS), *FURNITURE_NAMES.values()) for n in names))


@dataclass(frozen=True)
class RandomThing:
    """One thing or piece of furniture, and the words for it.

    Attributes:
        model: What is built; its name is unique within a scene's pool.
        nouns: What it may be called, the best word first.
        colour: Its colour word.
        extents: Full sizes of its box in [m], shape (3,).
        shape: Solid that describes it.
    """

    model: ObjectModel | FurnitureModel
    nouns: tuple[str, ...]
    colour: str
    extents: np.ndarray
    shape: Shape

    @property
    def radius(self) -> float:
        """Of the circle around its footprint in [m]."""
        return float(np.hypot(*self.extents[:2])) / 2 if self.shape == "box" else float(self.extents[:2].max()) / 2

    def fits(self, noun: str, colour: str | None) -> bool:
        """Whether a phrase of this noun and, where given, colour word names it rightly."""
        return noun in self.nouns and (colour is None or colour == self.colour)

    def may_fit(self, noun: str, colour: str | None) -> bool:
        """Whether somebody might call it that; a phrase for which this is False certainly means something else."""
        if noun not in self.nouns and not {noun, self.nouns[0]} <= {"cube", "block", "box", "crate"}:
            return False
        return colour is None or colour == self.colour or {colour, self.colour} in ALIKE


def random_thing(rng: np.random.Generator, name: str, kinds: tuple[Kind, ...] = KINDS) -> RandomThing:
    """Draw a thing of the object library.

    Args:
        rng: Source of randomness.
        name: Of its body; colour and noun are put behind it.
        kinds: To choose from.
    """
    weights = np.array([k.weight for k in kinds])
    kind = kinds[int(rng.choice(len(kinds), p=weights / weights.sum()))]
    share = rng.random(3)
    if kind.equal == "all":
        share[:] = share[0]
    elif kind.equal == "xy":
        share[1] = share[0]
    extents = np.array(kind.low) + share * (np.array(kind.high) - kind.low)
    colour = str(rng.choice(kind.colours))
    model = replace(object_model(f"{name}_{kind.noun}", extents), movable=False, rgb=shade(rng, colour))
    return RandomThing(model, kind.names, colour, model.extents, kind.shape)


def random_furniture(rng: np.random.Generator, name: str) -> RandomThing:
    """Draw a cabinet, a microwave, a lever or a weight plate."""
    kind = str(rng.choice(["cabinet", "cabinet", "microwave", "microwave", "lever", "weight_plate"]))
    colour = str(rng.choice(["wood", "wood", "brown", "white", "grey", "black", "blue", "red", "green"]))
    scale = rng.uniform(0.75, 1.15, 3)
    if kind == "cabinet":
        doors = 2 if rng.random() < 0.5 else 1
        config = CabinetConfig(
            kind="cabinet",
            doors=doors,
            opening="sliding" if rng.random() < 0.2 else "hinged",
            hinge="left" if rng.random() < 0.5 else "right",
            width=round((0.50 if doors == 2 else 0.40) * scale[0], 3),
            depth=round(0.28 * scale[1], 3),
            height=round(0.42 * scale[2], 3),
            colour=colour,  # type: ignore[arg-type]
        )
    elif kind == "microwave":
        hinge = "left" if rng.random() < 0.5 else "right"
        paint = colour if colour not in ("wood", "brown") else "white"
        colour = paint
        config = MicrowaveConfig(
            kind="microwave",
            hinge=hinge,
            width=round(0.42 * scale[0], 3),
            depth=round(0.30 * scale[1], 3),
            colour=paint,  # type: ignore[arg-type]
        )
    elif kind == "lever":
        colour = str(rng.choice(["red", "yellow", "green", "blue", "black"]))
        config = LeverConfig(kind="lever", colour=colour)  # type: ignore[arg-type]
    else:
        colour = str(rng.choice(["grey", "white", "black", "red", "blue"]))
        config = WeightPlateConfig(kind="weight_plate", colour=colour)  # type: ignore[arg-type]
    word = "wooden" if colour == "wood" else colour
    model = furniture_model(f"{name}_{kind}", config)
    model = replace(model, rgb=tuple(np.clip(np.array(rgb_of(colour)) + rng.normal(0, 0.02, 3), 0, 1)))
    return RandomThing(model, FURNITURE_NAMES[kind], word, model.extents, "box")


def shade(rng: np.random.Generator, colour: str) -> tuple[float, float, float]:
    """A colour word's paint, a little off: RGB, 0..1."""
    word = "wood" if colour == "wooden" else colour
    rgb = np.array(rgb_of(word)) * rng.uniform(0.85, 1.12) + rng.normal(0.0, 0.02, 3)
    return tuple(float(x) for x in np.clip(rgb, 0.02, 1.0))  # type: ignore[return-value]
