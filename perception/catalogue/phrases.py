"""Colour words and nouns of the catalogue, read out of a phrase such as "red cube"."""

from dataclasses import dataclass

from perception.catalogue.appearance import Appearance, Colour
from perception.catalogue.catalogue import Catalogue, builtin_catalogue
from perception.errors import UnknownPhraseError


@dataclass(frozen=True)
class Query:
    """A phrase in terms of the catalogue.

    Attributes:
        phrase: The phrase.
        colours: Colours to look for, each by itself.
        appearance: What the noun looks like; that of any thing for a noun without an appearance but with a colour word.
    """

    phrase: str
    colours: tuple[Colour, ...]
    appearance: Appearance


def parse_phrase(phrase: str, catalogue: Catalogue | None = None) -> Query:
    """Read colour words and a noun out of a phrase such as "red cube" or "the small green block".

    Args:
        phrase: Lower or upper case, words apart or joined by underscores or hyphens.
        catalogue: Of nouns and colours; the built-in one if None.

    Raises:
        UnknownPhraseError: Neither a noun that has an appearance nor a colour word.
    """
    known = catalogue or builtin_catalogue()
    words = phrase.lower().replace("_", " ").replace("-", " ").split()
    words = [w.strip(".,;:!?\"'") for w in words]
    # "orange" is a colour before a noun and a fruit at the end.
    noun_at = max((i for i, w in enumerate(words) if w in known.appearances), default=None)
    named = [known.seen_colour(w) for i, w in enumerate(words) if i != noun_at]
    colours = tuple(known.colours[w] for w in dict.fromkeys(named) if w is not None)
    if noun_at is None and not colours:
        raise UnknownPhraseError(
            f"the colour-and-shape detector cannot look for '{phrase}': it knows the nouns "
            f"{sorted(known.appearances)} and, for any other noun, needs one of the colours {sorted(known.colours)}; "
            "name one of these or choose a learned detector"
        )
    appearance = known.any_thing if noun_at is None else known.appearances[words[noun_at]]
    return Query(phrase, colours or tuple(known.colours[c] for c in appearance.colours), appearance)


def appearance_of(phrase: str, catalogue: Catalogue | None = None) -> Appearance:
    """What the thing that a phrase names looks like; that of any thing for nouns without an appearance."""
    try:
        return parse_phrase(phrase, catalogue).appearance
    except UnknownPhraseError:
        return (catalogue or builtin_catalogue()).any_thing
