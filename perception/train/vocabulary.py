"""The words that the bundled detector knows, and a tokenizer of them that GroundingDINO's code accepts."""

import string
from collections.abc import Sequence
from typing import Any

from perception.catalogue.catalogue import Catalogue, builtin_catalogue
from perception.detection.devices import load_package

# transformers' GroundingDINO finds where phrases end by these fixed ids of BERT's vocabulary.
FIXED = {"[PAD]": 0, "[UNK]": 100, "[CLS]": 101, "[SEP]": 102, "[MASK]": 103, ".": 1012, "?": 1029}


def known_words(nouns: Sequence[str], colours: Sequence[str], catalogue: Catalogue | None = None) -> tuple[str, ...]:
    """All words that phrases may be made of, sorted: the given ones, and a catalogue's prompt words for them.

    Args:
        nouns, colours: Of the pictures.
        catalogue: The built-in one if None.
    """
    words = {*nouns, *colours}
    for said, others in (catalogue or builtin_catalogue()).prompt_words.items():
        if said in words:
            words |= {w for phrase in others for w in phrase.split()}
    return tuple(sorted(words))


def make_tokenizer(words: Sequence[str]) -> Any:
    """A BERT tokenizer with whole words, letters and digits; every other id up to 1029 is unused.

    Args:
        words: Whole words.
    """
    transformers = load_package("transformers")
    letters = [*string.ascii_lowercase, *string.digits, "-", ",", "'"]
    tokens = dict.fromkeys([*words, *letters, *("##" + c for c in string.ascii_lowercase + string.digits)])
    table = dict(FIXED)
    free = iter(i for i in range(1, 1030) if i not in FIXED.values())
    for token in tokens:
        table.setdefault(token, next(free))
    used = set(table.values())
    table |= {f"[unused{i}]": i for i in range(1030) if i not in used}
    return transformers.BertTokenizer(vocab=table, do_lower_case=True)
