"""Which object of a scene words mean. Synonyms and colour words are those of the catalogue of objects.

A name is lower case with underscores ("red_cube"); its last word is the noun, the words before it describe. A phrase
("the red cube", "cube") means a name when the nouns agree and its other words describe the name. What a name does not
say is let pass ("ripe apple" may be apple), but never a colour: "green apple" is not known to be apple.
"""

import difflib
import re
from collections.abc import Iterable, Sequence

from perception.catalogue.catalogue import Catalogue, builtin_catalogue


def word_set(text: str) -> frozenset[str]:
    """The words of a text."""
    return frozenset(text.split())


ARTICLES = word_set("the a an this that these those my your its some any")
LIKE = " coloured like "  # between words for a thing and words for another one that has its colour
# Nouns that say nothing of what a thing is; its other words have to do.
ANYTHING = word_set("thing object item one something")
SUPPORTS = word_set("table desk counter floor ground worktop")  # what everything stands on


class NameProblem(ValueError):
    """A phrase that means no object, or more than one; the message is a sentence for people."""


class MissingName(NameProblem):
    """Nothing in the scene is called so.

    Attributes:
        phrase: As it was said.
    """

    def __init__(self, phrase: str, names: Sequence[str]) -> None:
        super().__init__(f"there is no '{phrase}' in view; in view: {', '.join(names) if names else 'nothing'}")
        self.phrase = phrase


class AmbiguousName(NameProblem):
    """More than one object may be meant."""

    def __init__(self, phrase: str, candidates: Sequence[str]) -> None:
        super().__init__(f"'{phrase}' may mean {' or '.join(candidates)}; say which one")
        self.candidates = tuple(candidates)


def words_of(phrase: str) -> list[str]:
    """Lower-case words of a phrase or name, without leading articles."""
    words = re.findall(r"[a-z0-9]+", phrase.lower().replace("_", " "))
    while words and words[0] in ARTICLES:
        words.pop(0)
    return words


def as_name(phrase: str) -> str:
    """The name that a phrase would have: words joined by underscores."""
    return "_".join(words_of(phrase))


def colour_of(name: str) -> str | None:
    """The colour that a name says, or None."""
    colours = builtin_catalogue().spoken_colours
    return next((w for w in words_of(name) if w in colours), None)


def candidates(phrase: str, names: Iterable[str], catalogue: Catalogue | None = None) -> list[str]:
    """Names that a phrase may mean, in their order; an exact one alone.

    Args:
        phrase: As it was said.
        names: Of a scene.
        catalogue: Of synonyms and colour words; the built-in one if None.
    """
    wanted, names, known = words_of(phrase), list(names), catalogue or builtin_catalogue()
    exact = [n for n in names if words_of(n) == wanted]
    return exact if exact or not wanted else [n for n in names if _may_mean(wanted, words_of(n), known)]


def _may_mean(wanted: list[str], name: list[str], known: Catalogue) -> bool:
    wanted_digits, digits = [w for w in wanted if w.isdigit()], [w for w in name if w.isdigit()]
    if wanted_digits and wanted_digits != digits:
        return False
    plain_wanted = [w for w in wanted if not w.isdigit()]
    plain = [w for w in name if not w.isdigit()]
    if not plain_wanted or not plain or not known.mean_the_same(plain_wanted[-1], plain[-1]):
        return False
    said = {next((k for k in plain[:-1] if known.mean_the_same(w, k)), w) for w in plain_wanted[:-1]}
    described = set(plain[:-1])
    unsaid = said - described
    # "big red cube" may be red_cube, but "stone cabinet" is not wooden_cabinet.
    return not unsaid or (described <= said and not unsaid & known.spoken_colours)


def all_said_of(phrase: str, name: str) -> bool:
    """Whether every word of a phrase, or one that people use for it, is a word of a name."""
    same = builtin_catalogue().mean_the_same
    return all(any(same(word, other) for other in words_of(name)) for word in words_of(phrase))


def resolve(phrase: str, names: Sequence[str], catalogue: Catalogue | None = None) -> str:
    """The one name that a phrase means.

    Args:
        phrase, names, catalogue: As in `candidates`.

    Raises:
        MissingName: None does.
        AmbiguousName: Several do.
    """
    found = candidates(phrase, names, catalogue)
    if not found:
        raise MissingName(" ".join(words_of(phrase)) or phrase, names)
    if len(found) > 1:
        raise AmbiguousName(" ".join(words_of(phrase)), found)
    return found[0]


def mentioned(text: str, names: Iterable[str]) -> list[str]:
    """Names that a text mentions, written with underscores or spaces, in the order of their first mention.

    A longer name wins over a shorter one inside it: "red cube crate" does not mention red_cube if there is a
    red_cube_crate.
    """
    remaining = text.lower()
    found: list[tuple[int, str]] = []
    for name in sorted(set(names), key=lambda n: (-len(n), n)):
        pattern = r"(?<![a-z0-9_])" + r"[ _]".join(map(re.escape, name.lower().split("_"))) + r"(?![a-z0-9_])"
        match = re.search(pattern, remaining)
        if match:
            found.append((match.start(), name))
            remaining = re.sub(pattern, lambda m: "\0" * len(m.group()), remaining)
    return [name for _, name in sorted(found)]


def with_names(text: str, names: Iterable[str]) -> str:
    """The text with every spelling of a name ("Red cube") written as the name itself ("red_cube")."""
    for name in sorted(set(names), key=lambda n: (-len(n), n)):
        spelled = r"[ _]".join(map(re.escape, name.split("_")))
        text = re.sub(rf"(?<![A-Za-z0-9_]){spelled}(?![A-Za-z0-9_])", name, text, flags=re.IGNORECASE)
    return text


def closest(phrase: str, names: Sequence[str]) -> str | None:
    """The name that resembles a phrase most: by shared words, nouns first, then by spelling; or None."""

    def likeness(name: str) -> tuple[float, float]:
        a, b = words_of(phrase), words_of(name)
        shared = len(set(a) & set(b)) + (0.5 if a and b and a[-1] == b[-1] else 0.0)
        return shared, difflib.SequenceMatcher(None, " ".join(a), " ".join(b)).ratio()

    best = max(names, key=likeness, default=None)
    if best is None or (likeness(best)[0] == 0 and likeness(best)[1] < 0.5):
        return None
    return best
