"""Goals in everyday words, rewritten into plainer ones before they are parsed.

Each rule stands for a turn of phrase and keeps the meaning; what no rule touches is left to the grammar.
"""

import re
from functools import cache

from perception.catalogue.catalogue import builtin_catalogue
from planning.language.names import ARTICLES, LIKE

_FILLERS = r"^(?:(?:please|can you|could you|would you|will you|kindly|now|first|next|finally|just|you should)[ ,]+)+"
_LIKE = re.compile(
    r" (?:(?:that|which) (?:has|is|shares|have) )?(?:(?:with|of|in|having) )?(?:(?:the|a) )?same colou?r"
    r" (?:as|of|like)(?: that of)? "
    r"| (?:(?:that|which) (?:has|have) |with |of |in |having )?(?:the )colou?r of "
    r"| (?:that|which) (?:matches|match)(?: the colou?r of)? | matching(?: the colou?r of)? "
    r"| (?:that|which) is (?:coloured|colored) like | (?:coloured|colored) like "
)
# Where something is, said before what to do with it; it says nothing that cameras do not see or that looking will not.
_WHERE_IT_IS = re.compile(
    r"^(?:wherever (?P<a>.+?) (?:is|may be|might be)|(?P<b>.+?) is (?:somewhere|behind|inside|in|on|under)\b[^,:;.]*)$"
)


def split_goal(whole: str, verbs: str) -> list[str]:
    """The parts of a goal, in lower case and without courtesies.

    Args:
        whole: The goal.
        verbs: Verbs that begin a part, as alternatives of a regular expression.
    """
    text = re.sub(_FILLERS, "", whole.lower().strip())
    text = re.sub(r"[ ,]+(?:please|for me|right now)\b", "", text).rstrip(".!? ")
    text = re.sub(r"\bafter (?:that|this|it)\s*,?\s*", "then ", text)
    text = re.sub(r"\bthen\s*$", "", text)
    parts = re.split(
        rf"\s*[,;:.]?\s*\b(?:and then|then|afterwards|and afterwards)\b[\s,]*|\s*[;:]\s*|\.\s+"
        rf"|,?\s+and\s+(?=(?:{verbs})\b)|,\s+(?=(?:{verbs})\b)",
        text,
    )
    return [re.sub(r"^and ", "", p.strip(" ,.")) for p in parts if p and p.strip(" ,.")]


def told_where(part: str) -> str | None:
    """The thing of a part that only tells where it is ("wherever the ball is"), or None."""
    match = _WHERE_IT_IS.match(" ".join(part.split()))
    return None if match is None else (match["a"] or match["b"])


def plainer(part: str, subject: str | None, target: str | None, stop: frozenset[str]) -> str:
    """A part in plain words.

    Args:
        part: Of a goal, in lower case.
        subject, target: What the part before was about; "it", "its" and "one" may mean them.
        stop: Words that no name contains.
    """
    text = " ".join(re.sub(r"[^a-z0-9_ ]", " ", part).split())
    text = re.sub(r"\b(left|right) hand (?=door|side)", r"\1 ", text)
    text = _door_of().sub(r"\2 \1", text)
    text = re.sub(r"\bfrom (?:inside|within)(?: of)?\b", "from", text)
    text = re.sub(r"\bover (?=to\b|onto\b|on\b|in\b|into\b)", "", text)
    # Where a thing is taken from is seen; where it goes is what is wanted.
    text = re.sub(
        r"^((?:transfer|move|take|bring|carry) .+?) (?:from|out of) (?:the )?\w+(?: \w+)? "
        r"(?=to\b|into\b|onto\b|in\b|on\b)",
        r"\1 ",
        text,
    )
    text = re.sub(r"\b(?:back|down|away|up) (?=(?:on|onto|in|into|inside)\b)", "", text)
    text = re.sub(r"^(?:get|fetch|bring|hand|give) me ", "get ", text)
    text = re.sub(r"\bstand (?=.+ on)", "put ", text)
    if target is not None:
        text = re.sub(r"\bits door\b", f"{target} door", text)
        text = re.sub(r"\b(open|shut|close) it\b", rf"\1 {target}", text)
        text = re.sub(r"\bon it$", f"on {target}", text)
        text = re.sub(r"\b(?:in|inside|into it|in it|there)$", f"in {target}", text)
    if subject is not None:
        noun = subject.split()[-1]
        text = re.sub(r"\b(\w+) one\b", rf"\1 {noun}", text)
    text = _own_noun(text)
    return _with_colours(text, stop)


@cache
def _door_of() -> re.Pattern[str]:
    """A door and what has it, in words of the catalogue, as in "door of the wooden cabinet"."""
    with_inside = (noun for noun, f in builtin_catalogue().furniture.items() if f.carries == "inside")
    words = [word for noun in with_inside for word in (noun, *builtin_catalogue().furniture[noun].synonyms)]
    return re.compile(rf"\b((?:left |right )?door) (?:of|on) (?:the )?(\w+(?: (?:{'|'.join(words)}))?)")


def _own_noun(text: str) -> str:
    """Replace "one" by the noun of the thing before, as in "the yellow cube off the blue one"."""
    match = re.search(r"\b(?P<noun>[a-z0-9_]+) (?:off|from|on|onto|away from|out of) (?:the )?(?:\w+ )one\b", text)
    return text if match is None else re.sub(r"\bone\b", match["noun"], text)


def _with_colours(text: str, stop: frozenset[str]) -> str:
    """Rewrite "the cube with the same colour as the crate" as "the cube coloured like crate"."""
    same = _LIKE.search(text)
    if same is None:
        return text
    rest = text[same.end() :].split()
    while rest and rest[0] in ARTICLES:
        rest.pop(0)
    end = next((k for k, w in enumerate(rest) if w in stop), len(rest))
    return " ".join([text[: same.start()] + LIKE + " ".join(rest[:end]), *rest[end:]])
