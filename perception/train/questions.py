"""Phrases to ask of a picture: some name things in it, others certainly nothing."""

from dataclasses import dataclass

import numpy as np

from perception.catalogue.catalogue import builtin_catalogue
from perception.train.shards import Thing, Words


@dataclass(frozen=True)
class TrainingQuestion:
    """One phrase.

    Attributes:
        phrase: For instance "red cube".
        answers: Numbers of the things that it names, into the sample's things; none for what is absent.
    """

    phrase: str
    answers: tuple[int, ...]


def ask(things: tuple[Thing, ...], words: Words, rng: np.random.Generator, most: int = 8) -> list[TrainingQuestion]:
    """Draw phrases for a picture.

    Phrases that a thing might be meant by, but that do not name it rightly, are not asked.

    Args:
        things: Of the picture.
        words: Vocabulary.
        rng: Source of randomness.
        most: Most phrases.
    """
    total = int(rng.integers(2, most + 1))
    asked: dict[tuple[str, str | None], tuple[int, ...]] = {}
    clear = [t for t in things if t.clear]
    for i in rng.permutation(len(clear))[: max(1, round(0.75 * total))]:
        thing = clear[int(i)]
        noun = str(rng.choice(words.kinds[thing.kind]))
        colour = words.colours[thing.colour]
        key = (noun, None if colour == noun or rng.random() < 0.35 else colour)
        if not any(_may_fit(t, *key, words) and not _fits(t, *key, words) for t in things):
            asked[key] = tuple(k for k, t in enumerate(things) if t.clear and _fits(t, *key, words))
    for _ in range(40):
        if len(asked) >= total:
            break
        noun, colour = str(rng.choice(words.nouns)), str(rng.choice(words.colours))
        if clear and rng.random() < 0.75:  # the hardest to tell apart share a word with what is there
            thing = clear[int(rng.integers(len(clear)))]
            if rng.random() < 0.5:
                noun = words.kinds[thing.kind][0]
            else:
                colour = words.colours[thing.colour]
        key = (noun, None if colour == noun or rng.random() < 0.3 else colour)
        if key not in asked and not any(_may_fit(t, *key, words) for t in things):
            asked[key] = ()
    questions = [TrainingQuestion(_say(noun, colour, rng), answers) for (noun, colour), answers in asked.items()]
    return [questions[int(i)] for i in rng.permutation(len(questions))]


def _fits(thing: Thing, noun: str, colour: str | None, words: Words) -> bool:
    return noun in words.kinds[thing.kind] and (colour is None or words.colours[thing.colour] == colour)


def _may_fit(thing: Thing, noun: str, colour: str | None, words: Words) -> bool:
    if noun not in words.may_be_called[thing.kind]:
        return False
    own = words.colours[thing.colour]
    return colour is None or colour == own or frozenset((own, colour)) in words.alike_colours


def _say(noun: str, colour: str | None, rng: np.random.Generator) -> str:
    spoken = []
    for word in (colour, noun) if colour else (noun,):
        others = builtin_catalogue().prompt_words.get(word, ())
        spoken.append(str(rng.choice(others)) if others and rng.random() < 0.3 else word)
    return " ".join(spoken)
