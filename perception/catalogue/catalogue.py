"""The catalogue of objects: read from a file once, asked by noun and by colour word."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from types import UnionType
from typing import Any, get_args, get_origin

import yaml
from pydantic import BaseModel, ValidationError

from perception.catalogue.appearance import Appearance, Colour
from perception.catalogue.entries import AppearanceEntry, CatalogueFile, FurnitureEntry, ObjectEntry, UnknownEntry
from perception.errors import CatalogueError

BUILTIN_FILE = Path(__file__).with_name("objects.yaml")


@dataclass(frozen=True)
class Catalogue:
    """What is known of nouns and colour words.

    Attributes:
        source: The file, for messages.
        file: All that stands in it.
    """

    source: Path
    file: CatalogueFile

    @property
    def objects(self) -> Mapping[str, ObjectEntry]:
        """Entries by noun."""
        return self.file.objects

    @property
    def furniture(self) -> Mapping[str, FurnitureEntry]:
        """Words for furniture, by noun."""
        return self.file.furniture

    @property
    def unknown(self) -> UnknownEntry:
        """What is taken of things whose noun has no entry."""
        return self.file.unknown

    @cached_property
    def colours(self) -> Mapping[str, Colour]:
        """Colours as ranges of pixels, by word."""
        return {w: Colour(w, c.hue, c.saturation, c.value) for w, c in self.file.colours.items()}

    @cached_property
    def colour_aliases(self) -> Mapping[str, str]:
        """Colour words by other words whose pixels have that colour."""
        aliases = {other: w for w, c in self.file.colours.items() for other in (*c.synonyms, *c.includes)}
        return aliases | {m.adjective: m.colour for m in self.file.materials.values()}

    @cached_property
    def spoken_colours(self) -> frozenset[str]:
        """All words that name a colour in goals and names; what names a material is none of them."""
        own = {word for w, c in self.file.colours.items() for word in (w, *c.synonyms, *c.includes)}
        return frozenset((*own, *self.file.unseen_colours))

    @cached_property
    def paints(self) -> Mapping[str, tuple[float, float, float]]:
        """RGB of simulated things, 0..1: by colour words, then by materials' names ("wood")."""
        colours = {w: c.paint for w, c in self.file.colours.items()}
        return colours | {name: m.paint for name, m in self.file.materials.items()}

    @cached_property
    def painted_words(self) -> Mapping[str, str]:
        """Words that pictures describe paint with, colours first: each with its key in `paints`."""
        return {w: w for w in self.file.colours} | {m.adjective: name for name, m in self.file.materials.items()}

    @cached_property
    def alike_colours(self) -> tuple[frozenset[str], ...]:
        """Pairs of words for nearly the same colour."""
        return tuple(frozenset(pair) for pair in self.file.alike_colours)

    @cached_property
    def appearances(self) -> Mapping[str, Appearance]:
        """What nouns look like, of those that detection by colour and shape knows."""
        return {
            noun: self._appearance(noun, entry, entry.look)
            for noun, entry in self.objects.items()
            if entry.look is not None
        }

    @cached_property
    def any_thing(self) -> Appearance:
        """What a thing looks like whose noun is not known."""
        return self._appearance(None, self.unknown, self.unknown.look)

    @cached_property
    def prompt_words(self) -> Mapping[str, tuple[str, ...]]:
        """Further words that detectors learn to read, by the noun or colour word that they stand for."""
        file = self.file
        adjectives = ((m.adjective, m) for m in file.materials.values())
        said = (*file.colours.items(), *adjectives, *file.furniture.items(), *file.objects.items())
        return {word: entry.prompt_words for word, entry in said if entry.prompt_words}

    @cached_property
    def _synonyms(self) -> tuple[frozenset[str], ...]:
        said = (*self.file.colours.items(), *self.furniture.items(), *self.objects.items())
        return tuple(frozenset((word, *entry.synonyms)) for word, entry in said if entry.synonyms)

    def mean_the_same(self, a: str, b: str) -> bool:
        """Whether people use two words for one another: some entry has both."""
        return a == b or any(a in words and b in words for words in self._synonyms)

    def seen_colour(self, word: str) -> str | None:
        """The colour that a thing's pixels have where a word describes it; None for a word that says none."""
        word = self.colour_aliases.get(word, word)
        return word if word in self.colours else None

    def usual_colours(self, noun: str) -> tuple[str, ...]:
        """Colours of a noun that has an entry; all that have a hue where its entry says nothing."""
        return self.objects[noun].colours or self._chromatic

    @cached_property
    def _chromatic(self) -> tuple[str, ...]:
        return tuple(word for word, colour in self.colours.items() if colour.chromatic)

    def _appearance(
        self, noun: str | None, entry: ObjectEntry | UnknownEntry, appearance: AppearanceEntry
    ) -> Appearance:
        return Appearance(
            noun=noun,
            colours=self._chromatic if noun is None else self.usual_colours(noun),
            outline=appearance.outline,
            size=appearance.size,
            solid=entry.shape,
            equal_sides=appearance.equal_sides,
            hollow=isinstance(entry, ObjectEntry) and entry.carries == "inside",
            kinds=appearance.kinds,
        )


@cache
def builtin_catalogue() -> Catalogue:
    """The catalogue that comes with the program; its file is read by the first call."""
    return read_catalogue(BUILTIN_FILE)


def read_catalogue(path: Path) -> Catalogue:
    """Read a catalogue file.

    Raises:
        CatalogueError: The file cannot be read, is not YAML, or has a key or value that is not valid; one line for
            each mistake, with file, entry and what is valid.
    """
    try:
        content = yaml.load(path.read_text(encoding="utf-8"), Loader=_OneOfEachKey)
    except (OSError, UnicodeDecodeError) as error:
        raise CatalogueError(f"{path}: the catalogue cannot be read ({error})") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f":{mark.line + 1}" if mark else ""
        raise CatalogueError(f"{path}{line}: not valid YAML ({getattr(error, 'problem', None) or error})") from None
    if not isinstance(content, dict):
        raise CatalogueError(f"{path}: a catalogue has the keys {', '.join(CatalogueFile.model_fields)}")
    try:
        return Catalogue(path, CatalogueFile.model_validate(content))
    except ValidationError as error:
        raise CatalogueError("\n".join(f"{path}: {_explained(fault)}" for fault in error.errors())) from None


class _OneOfEachKey(yaml.SafeLoader):
    """YAML's safe subset, in which a key given twice is a mistake instead of the last one winning."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        seen = set()
        for key, _ in node.value:
            if key.value in seen:
                raise yaml.constructor.ConstructorError(None, None, f"key '{key.value}' is given twice", key.start_mark)
            seen.add(key.value)
        return super().construct_mapping(node, deep)


def _explained(fault: Any) -> str:
    """Where one mistake is, what is wrong and what would be valid."""
    loc = tuple(part for part in fault["loc"] if part != "[key]")
    where = ".".join(str(part) for part in loc)
    if fault["type"] == "extra_forbidden":
        return f"{where}: unknown key; valid there are {', '.join(_keys(loc[:-1]))}"
    if fault["type"] == "missing":
        return f"{where}: the key is missing"
    if fault["type"] == "string_pattern_mismatch":
        return f"{where}: '{fault['input']}' must be one word of small letters"
    said = fault["msg"].removeprefix("Value error, ")
    return f"{where}: {said}" if where else said


def _keys(loc: tuple[str | int, ...]) -> list[str]:
    """Keys that the file may have at a place."""
    here: Any = CatalogueFile
    for part in loc:
        if isinstance(here, type) and issubclass(here, BaseModel):
            here = here.model_fields[str(part)].annotation
        else:
            here = get_args(here)[-1]  # what a mapping holds
        if get_origin(here) is UnionType:  # what may be left out
            here = get_args(here)[0]
    return list(here.model_fields)
