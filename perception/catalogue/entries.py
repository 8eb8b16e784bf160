"""What a catalogue file may say, checked strictly. Lengths in [m], densities in [kg/m^3], masses in [kg].

A word that stands for something else in the file (a colour, a noun) must stand there too.
"""

from collections.abc import Iterable
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from perception.catalogue.appearance import Kind, Outline
from perception.estimates import Shape

Word = Annotated[str, Field(pattern=r"^[a-z]+$")]
Positive = Annotated[float, Field(gt=0)]
Share = Annotated[float, Field(ge=0, le=1)]
Rgb = tuple[Share, Share, Share]
Sizes = tuple[Positive, Positive, Positive]
Carries = Literal["on_top", "inside"]
EqualAxes = Literal["all", "xy", "none"]
ModelName = Literal["bowl", "kettle"]  # built by `sim_check.objects.library`
VisualName = Literal["boards", "apple"]  # drawn by `sim_check.models.object_visuals`


class StrictEntry(BaseModel):
    """A part of the file: unknown keys and numbers that are not finite are mistakes, values do not change."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class ColourEntry(StrictEntry):
    """A colour word.

    Attributes:
        hue: (from, to) in [degrees], going up; absent for a colour without one, such as grey.
        saturation, value: (lowest, highest), 0..1.
        paint: RGB of simulated things, 0..1.
        synonyms: Words for the same colour.
        includes: Words for other colours whose pixels have this one.
        prompt_words: Further words that detectors learn to read for it.
    """

    hue: tuple[float, float] | None = None
    saturation: tuple[Share, Share]
    value: tuple[Share, Share]
    paint: Rgb
    synonyms: tuple[Word, ...] = ()
    includes: tuple[Word, ...] = ()
    prompt_words: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _ranges_go_up(self) -> Self:
        for name, span in (("hue", self.hue), ("saturation", self.saturation), ("value", self.value)):
            if span is not None and span[0] >= span[1]:
                raise ValueError(f"{name} must go up, as in [{span[1]:g}, {span[0]:g}]")
        return self


class MaterialEntry(StrictEntry):
    """A material that is named in the place of a colour.

    Attributes:
        adjective: What is made of it ("wooden").
        colour: Colour word that its pixels have.
        paint: RGB of simulated things, 0..1.
        prompt_words: Further words that detectors learn to read for the adjective.
    """

    adjective: Word
    colour: Word
    paint: Rgb
    prompt_words: tuple[str, ...] = ()


class FurnitureEntry(StrictEntry):
    """Words for a kind of furniture; the key is what people call it first.

    Attributes:
        kind: As in cell files; the noun if absent.
        synonyms: Other nouns for it.
        carries: Whether it has an inside, behind doors.
        prompt_words: Further words that detectors learn to read for it.
        unsaid_colours: Colours that go without saying.
    """

    kind: str | None = None
    synonyms: tuple[Word, ...] = ()
    carries: Carries | None = None
    prompt_words: tuple[str, ...] = ()
    unsaid_colours: tuple[Word, ...] = ()


class AppearanceEntry(StrictEntry):
    """How detection by colour and shape knows a thing; a thing without one is left to learned weights.

    Attributes:
        outline: Shape of the outline in the picture.
        size: (lowest, highest) of the longest visible side.
        equal_sides: Whether the noun says that it is as long as wide as high.
        kinds: Solids to try in fits, where it is not the entry's shape alone.
    """

    outline: Outline
    size: tuple[Positive, Positive]
    equal_sides: bool = False
    kinds: tuple[Kind, ...] = ()

    @model_validator(mode="after")
    def _size_goes_up(self) -> Self:
        if self.size[0] >= self.size[1]:
            raise ValueError(f"size must go up, as in [{self.size[1]:g}, {self.size[0]:g}]")
        return self


class BodyEntry(StrictEntry):
    """How the object library builds a thing; one without a body is built as the solid that was seen.

    Attributes:
        extents: Usual full sizes along its own axes.
        density: Mass over the volume of its solids. Either this or `mass` is given.
        mass: Of a thing of the usual sizes; others have the same density.
        friction: Sliding friction; that of unknown things if absent.
        paint: Colour of a thing whose name says none; the first of the entry's colours if absent.
        model: What builds its solids, where it is no primitive.
        visual: What draws it for cameras, where that is not its solids.
        grasp: Whether fingers close on its body, or on the handle that its model has.
    """

    extents: Sizes
    density: Positive | None = None
    mass: Positive | None = None
    friction: Positive | None = None
    paint: Word | None = None
    model: ModelName | None = None
    visual: VisualName | None = None
    grasp: Literal["body", "handle"] = "body"

    @model_validator(mode="after")
    def _one_of_density_and_mass(self) -> Self:
        if (self.density is None) == (self.mass is None):
            raise ValueError("give either density in kg/m^3 or mass in kg")
        return self


class DrawnEntry(StrictEntry):
    """How random scenes draw a thing, and which words name it there.

    Attributes:
        low, high: Full sizes along its own axes; a size is drawn between them.
        equal: Axes that share one draw; xy is round about z.
        colours: Colours and adjectives of materials it may have; the entry's colours if absent. One that stands twice
            is drawn twice as often.
        also_called: Other nouns that name it rightly.
        may_be_called: Nouns that somebody might use; where it stands they are neither asked for nor called absent.
        unsaid_colours: Colours that go without saying.
        lies: How often it lies on its side, 0..1.
        weight: How often it is drawn, compared with the others.
    """

    low: Sizes
    high: Sizes
    equal: EqualAxes = "none"
    colours: tuple[Word, ...] | None = None
    also_called: tuple[Word, ...] = ()
    may_be_called: tuple[Word, ...] = ()
    unsaid_colours: tuple[Word, ...] = ()
    lies: Share = 0.0
    weight: Positive = 1.0

    @model_validator(mode="after")
    def _sizes_go_up(self) -> Self:
        if any(low > high for low, high in zip(self.low, self.high, strict=True)):
            raise ValueError(f"low {list(self.low)} must not be above high {list(self.high)} along any axis")
        return self


class ObjectEntry(StrictEntry):
    """Everything that is known of one noun.

    Attributes:
        synonyms: Nouns that people use for it.
        shape: Solid that describes it.
        carries: Whether things are put on top of it or inside; nothing is put on it in random scenes if absent.
        colours: Colours it is looked for in when its name says none; all that have a hue if absent.
        prompt_words: Further words that detectors learn to read for it.
        look: How detection by colour and shape knows it.
        body: How the object library builds it.
        drawn: How random scenes draw it.
    """

    synonyms: tuple[Word, ...] = ()
    shape: Shape
    carries: Carries | None = None
    colours: tuple[Word, ...] | None = Field(default=None, min_length=1)
    prompt_words: tuple[str, ...] = ()
    look: AppearanceEntry | None = None
    body: BodyEntry | None = None
    drawn: DrawnEntry | None = None

    @model_validator(mode="after")
    def _drawn_things_are_built(self) -> Self:
        if self.drawn is not None and self.body is None:
            raise ValueError("random scenes draw what the object library builds; give a body, or leave out drawn")
        return self


class UnknownEntry(StrictEntry):
    """What is taken of a thing whose noun has no entry.

    Attributes:
        shape: Solid that describes it.
        look: How detection by colour and shape knows it, where it is named by a colour.
        density, friction: As in `BodyEntry`.
        paint: Colour of a thing whose name says none.
    """

    shape: Shape
    look: AppearanceEntry
    density: Positive
    friction: Positive
    paint: Word


class CatalogueFile(StrictEntry):
    """A whole file.

    Attributes:
        colours: By word.
        materials: By name.
        alike_colours: Pairs of words for nearly the same colour.
        unseen_colours: Colour words of people that no range describes.
        furniture: By noun.
        unknown: Of nouns without an entry.
        objects: By noun.
    """

    colours: dict[Word, ColourEntry] = Field(min_length=1)
    materials: dict[Word, MaterialEntry] = Field(default_factory=dict)
    alike_colours: tuple[tuple[Word, Word], ...] = ()
    unseen_colours: tuple[Word, ...] = ()
    furniture: dict[Word, FurnitureEntry] = Field(default_factory=dict)
    unknown: UnknownEntry
    objects: dict[Word, ObjectEntry] = Field(min_length=1)

    @model_validator(mode="after")
    def _words_stand_in_the_file(self) -> Self:
        twice = sorted(set(self.objects) & set(self.furniture))
        if twice:
            raise ValueError(f"objects.{twice[0]}: '{twice[0]}' stands under furniture too; keep one of the two")
        seen, painted = list(self.colours), [*self.colours, *(m.adjective for m in self.materials.values())]
        nouns = [*self.objects, *self.furniture]
        for name, material in self.materials.items():
            _known(f"materials.{name}.colour", [material.colour], seen, "colours")
        for k, pair in enumerate(self.alike_colours):
            _known(f"alike_colours[{k}]", pair, painted, "colours")
        for noun, piece in self.furniture.items():
            _known(f"furniture.{noun}.unsaid_colours", piece.unsaid_colours, painted, "colours")
        _known("unknown.paint", [self.unknown.paint], seen, "colours")
        for noun, entry in self.objects.items():
            _known(f"objects.{noun}.colours", entry.colours or (), seen, "colours")
            if entry.body is not None and entry.body.paint is not None:
                _known(f"objects.{noun}.body.paint", [entry.body.paint], seen, "colours")
            if entry.drawn is not None:
                where = f"objects.{noun}.drawn"
                _known(f"{where}.colours", entry.drawn.colours or (), painted, "colours")
                _known(f"{where}.unsaid_colours", entry.drawn.unsaid_colours, painted, "colours")
                _known(f"{where}.also_called", entry.drawn.also_called, nouns, "nouns")
                _known(f"{where}.may_be_called", entry.drawn.may_be_called, nouns, "nouns")
        return self


def _known(where: str, words: Iterable[str], valid: list[str], what: str) -> None:
    for word in words:
        if word not in valid:
            raise ValueError(f"{where}: '{word}' is none of the file's {what}: {', '.join(valid)}")
