"""Pages are written in short sentences and in the field's terms."""

import re
from pathlib import Path

import pytest

from tests.support.documents import ROOT, pages

LONGEST = 40  # words; about 25 are aimed at, and a list of things takes more
WORDS = re.compile(
    r"\b(start law|time law|workbench|ghosts?|overheard|latched robot|contradictions?|eyes|foreign motion)\b",
    re.IGNORECASE,
)
MADE_FROM_CODE = {"api.md", "reward-terms.md"}


def prose(page: Path) -> str:
    """A page without code blocks, tables, headings and pictures."""
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    return "\n".join(line for line in text.splitlines() if not line.startswith(("|", "    ", "#", "!", "<!--")))


def sentences(text: str) -> list[str]:
    """Sentences of a text; those of a list end with their item."""
    items = re.split(r"\n\s*\n|\n(?=\s*(?:[-*]|\d+\.) )", text)
    ends = r"(?<=[.!?:;])\s+"
    return [sentence for item in items for sentence in re.split(ends, " ".join(item.split()))]


@pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_sentences_are_short_and_use_the_terms_of_the_field(page):
    text = prose(page)
    if page.name not in MADE_FROM_CODE:
        long = [sentence for sentence in sentences(text) if len(sentence.split()) > LONGEST]
        assert not long, f"{page.relative_to(ROOT)}: longer than {LONGEST} words: {long}"
    assert not WORDS.findall(text), f"{page.relative_to(ROOT)} uses a word that was given up"


def test_a_long_sentence_and_a_word_that_was_given_up_are_found():
    text = "Short. " + "word " * 41 + "end.\n\n- An item\n- its neighbour"
    assert [len(s.split()) for s in sentences(text)] == [1, 42, 3, 3]
    assert WORDS.findall("the workbench has a time law") == ["workbench", "time law"]
