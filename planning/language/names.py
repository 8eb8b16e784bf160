"""Which object of a scene words mean. Needs the standard library only.

A name is lower case with underscores ("red_cube"); its last word is the noun, the words before it describe. A phrase
("the red cube", "cube") means a name when the nouns agree and its other words describe the name. What a name does not
say is let pass ("ripe apple" may be apple), but never a colour: "green apple" is not known to be apple.
"""

import difflib
import re
from collections.abc import Iterable, Sequence


def word_set(text: str) -> frozenset[str]:
    """The words of a text."""
    return frozenset(text.split())


COLOURS = word_set(
    "red green blue yellow orange purple pink brown black white grey gray cyan magenta turquoise violet silver "
    "gold golden beige"
)
ARTICLES = word_set("the a an this that these those my your its some any")
LIKE = " coloured like "  # between words for a thing and words for another one that has its colour
# Nouns that people use for one another; a name's noun and a phrase's noun mean the same when they share a set.
SYNONYMS = (
    word_set("cube block brick"),
    word_set("cabinet cupboard closet"),
    word_set("crate box"),
    word_set("can tin"),
    word_set("violet purple"),
    word_set("grey gray"),
    word_set("bar rod stick"),
    word_set("lever handle switch"),
    word_set("sensor plate scale"),
    word_set("kettle teapot"),
    word_set("microwave oven"),
    word_set("bowl dish"),
)


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
    return next((w for w in words_of(name) if w in COLOURS), None)


def candidates(phrase: str, names: Iterable[str]) -> list[str]:
    """Names that a phrase may mean, in their order; an exact one alone."""
    wanted, names = words_of(phrase), list(names)
    exact = [n for n in names if words_of(n) == wanted]
    return exact if exact or not wanted else [n for n in names if _may_mean(wanted, words_of(n))]


def _may_mean(wanted: list[str], name: list[str]) -> bool:
    wanted_digits, digits = [w for w in wanted if w.isdigit()], [w for w in name if w.isdigit()]
    if wanted_digits and wanted_digits != digits:
        return False
    plain_wanted = [w for w in wanted if not w.isdigit()]
    plain = [w for w in name if not w.isdigit()]
    if not plain_wanted or not plain or not _same_noun(plain_wanted[-1], plain[-1]):
        return False
    said = {next((k for k in plain[:-1] if _same_noun(w, k)), w) for w in plain_wanted[:-1]}
    known = set(plain[:-1])
    unsaid = said - known
    # "big red cube" may be red_cube, but "stone cabinet" is not wooden_cabinet.
    return not unsaid or (known <= said and not unsaid & COLOURS)


def _same_noun(a: str, b: str) -> bool:
    return a == b or any(a in nouns and b in nouns for nouns in SYNONYMS)


def all_said_of(phrase: str, name: str) -> bool:
    """Whether every word of a phrase, or one that people use for it, is a word of a name."""
    known = words_of(name)
    return all(any(_same_noun(word, other) for other in known) for word in words_of(phrase))


def resolve(phrase: str, names: Sequence[str]) -> str:
    """The one name that a phrase means.

    Raises:
        MissingName: None does.
        AmbiguousName: Several do.
    """
    found = candidates(phrase, names)
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
