"""Things of random kind, size and colour out of the object library, and which words name them: as the catalogue says.

For pictures that detectors learn from and are judged on. Some things have several fair names (a long block is a box
too, an orange ball may be an orange) and some colours are a matter of opinion (a dark orange is a brown); questions
about what is absent keep away from both.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from perception.catalogue.catalogue import Catalogue, builtin_catalogue
from perception.catalogue.entries import Carries, DrawnEntry
from perception.estimates import Shape
from sim_check.cells.furniture_config import CabinetConfig, LeverConfig, MicrowaveConfig, WeightPlateConfig
from sim_check.furniture.build import furniture_model
from sim_check.furniture.model import FurnitureModel
from sim_check.objects.library import ObjectModel, object_model


@dataclass(frozen=True)
class RandomThing:
    """One thing or piece of furniture, and the words for it.

    Attributes:
        model: What is built; its name is unique within a scene's pool.
        nouns: What it may be called, the best word first.
        may_be_called: Further nouns that somebody might use.
        colour: Its colour word.
        alike: Words for nearly the same colour.
        unsaid_colours: Colours of such things that go without saying.
        extents: Full sizes of its box in [m], shape (3,).
        shape: Solid that describes it.
        carries: Whether other things may stand on it or lie in it.
        lies: How often it lies on its side, 0..1.
    """

    model: ObjectModel | FurnitureModel
    nouns: tuple[str, ...]
    may_be_called: tuple[str, ...]
    colour: str
    alike: frozenset[str]
    unsaid_colours: tuple[str, ...]
    extents: NDArray[np.float64]
    shape: Shape
    carries: Carries | None = None
    lies: float = 0.0

    @property
    def radius(self) -> float:
        """Of the circle around its footprint in [m]."""
        return float(np.hypot(*self.extents[:2])) / 2 if self.shape == "box" else float(self.extents[:2].max()) / 2

    def fits(self, noun: str, colour: str | None) -> bool:
        """Whether a phrase of this noun and, where given, colour word names it rightly."""
        return noun in self.nouns and (colour is None or colour == self.colour)

    def may_fit(self, noun: str, colour: str | None) -> bool:
        """Whether somebody might call it that; a phrase for which this is False certainly means something else."""
        if noun not in self.nouns and noun not in self.may_be_called:
            return False
        return colour is None or colour == self.colour or colour in self.alike


def drawn_objects(catalogue: Catalogue) -> dict[str, DrawnEntry]:
    """How random scenes draw objects, by noun."""
    return {noun: entry.drawn for noun, entry in catalogue.objects.items() if entry.drawn is not None}


def kind_names(catalogue: Catalogue) -> tuple[tuple[str, ...], ...]:
    """What each kind of thing is called, the best noun first: objects, then furniture."""
    objects = ((noun, *drawn.also_called) for noun, drawn in drawn_objects(catalogue).items())
    return (*objects, *((noun,) for noun in catalogue.furniture))


def drawn_nouns(catalogue: Catalogue) -> tuple[str, ...]:
    """All nouns that name something in random scenes."""
    return tuple(dict.fromkeys(noun for names in kind_names(catalogue) for noun in names))


def random_thing(rng: np.random.Generator, name: str, catalogue: Catalogue | None = None) -> RandomThing:
    """Draw a thing of the object library.

    Args:
        rng: Source of randomness.
        name: Of its body; colour and noun are put behind it.
        catalogue: What may be drawn, and how; the built-in one if None.
    """
    known = catalogue or builtin_catalogue()
    kinds = drawn_objects(known)
    weights = np.array([drawn.weight for drawn in kinds.values()])
    noun = list(kinds)[int(rng.choice(len(kinds), p=weights / weights.sum()))]
    drawn, entry = kinds[noun], known.objects[noun]
    share = rng.random(3)
    if drawn.equal == "all":
        share[:] = share[0]
    elif drawn.equal == "xy":
        share[1] = share[0]
    extents = np.array(drawn.low) + share * (np.array(drawn.high) - drawn.low)
    colour = str(rng.choice(drawn.colours or known.usual_colours(noun)))
    model = object_model(f"{name}_{noun}", extents, catalogue=known)
    model = replace(model, movable=False, rgb=shade(rng, colour, known))
    return RandomThing(
        model,
        (noun, *drawn.also_called),
        drawn.may_be_called,
        colour,
        _alike(colour, known),
        drawn.unsaid_colours,
        model.extents,
        model.shape,
        entry.carries,
        drawn.lies,
    )


def _alike(colour: str, catalogue: Catalogue) -> frozenset[str]:
    return frozenset(word for pair in catalogue.alike_colours if colour in pair for word in pair - {colour})


def random_furniture(rng: np.random.Generator, name: str, catalogue: Catalogue | None = None) -> RandomThing:
    """Draw a cabinet, a microwave, a lever or a weight plate.

    Args:
        rng: Source of randomness.
        name: Of its body; the kind is put behind it.
        catalogue: Words and paints; the built-in one if None.
    """
    known = catalogue or builtin_catalogue()
    nouns = {entry.kind or noun: noun for noun, entry in known.furniture.items()}
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
            colour=colour,
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
            colour=paint,
        )
    elif kind == "lever":
        colour = str(rng.choice(known.furniture[nouns[kind]].unsaid_colours))
        config = LeverConfig(kind="lever", colour=colour)
    else:
        colour = str(rng.choice(known.furniture[nouns[kind]].unsaid_colours))
        config = WeightPlateConfig(kind="weight_plate", colour=colour)
    noun = nouns[kind]
    word = next(word for word, paint in known.painted_words.items() if paint == colour)
    model = furniture_model(f"{name}_{kind}", config)
    model = replace(model, rgb=tuple(np.clip(np.array(known.paints[colour]) + rng.normal(0, 0.02, 3), 0, 1)))
    unsaid = known.furniture[noun].unsaid_colours
    return RandomThing(model, (noun,), (), word, _alike(word, known), unsaid, model.extents, "box")


def shade(rng: np.random.Generator, colour: str, catalogue: Catalogue) -> tuple[float, float, float]:
    """A colour word's paint, a little off: RGB, 0..1."""
    rgb = np.array(catalogue.paints[catalogue.painted_words[colour]]) * rng.uniform(0.85, 1.12) + rng.normal(
        0.0, 0.02, 3
    )
    return tuple(float(x) for x in np.clip(rgb, 0.02, 1.0))  # type: ignore[return-value]
