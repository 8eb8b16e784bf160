"""A small language of goals and plan steps: what the rule-based reasoner understands. Needs the standard library only.

    GOAL    = CLAUSE { ("then" | "and then" | ";" | "and" before a verb) CLAUSE }
    CLAUSE  = place|put|move|stack|...  X  on|in|into|onto|to|...  Y
            | move|take|remove|...      X  away from|off|out of|from  Y
            | pick up|lift|...          X
            | look for|find|...         X
            | move to|reach|touch|...   X
    X, Y    = words without prepositions, an article first or not; "it" is the clause before's X

Steps of plans are clauses with exact names ("place red_cube on crate"), so one parser reads both.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from control.errors import GoalError
from planning.names import ARTICLES, word_set, words_of

ClauseKind = Literal["place", "away", "lift", "find", "reach"]

UNDERSTOOD = (
    '"place X on Y", "put X in Y", "move X away from Y", "take X out of Y", "pick up X", "find X", "reach X", '
    'several joined by "then"'
)

_ONTO = r"(?P<how>on top of|onto|on|inside of|inside|into|in|over|at|to)"
_FROM = r"(?P<how>away from|(?:from|off)(?: on)?(?: the)? top of|off of|off|out of|from)"
_PATTERNS: tuple[tuple[ClauseKind, re.Pattern[str]], ...] = tuple(
    (kind, re.compile(pattern))  # type: ignore[misc]
    for kind, pattern in (
        ("find", r"(?:look for|find|search for|locate|where is|show me) (?P<a>.+)"),
        ("reach", r"(?:reach for|reach|touch|go to|move to|approach) (?P<a>.+)"),
        ("reach", r"(?:move|bring) (?:the )?(?:palm|hand|arm|gripper) (?:close to|to|towards) (?P<a>.+)"),
        ("away", rf"(?:move|take|remove|get|clear|keep|bring|pull|put) (?P<a>.+?) {_FROM} (?P<b>.+)"),
        ("place", rf"(?:place|put|move|stack|set|lay|bring|carry|drop|transfer|take) (?P<a>.+?) {_ONTO} (?P<b>.+)"),
        ("lift", r"(?:pick up|lift up|lift|raise|grasp|grab) (?P<a>.+)"),
        ("lift", r"(?:pick|lift) (?P<a>.+) up"),
    )
)
_VERBS = word_set(
    "place put move stack set lay bring carry drop transfer take remove get clear keep pull pick lift raise grasp "
    "grab look find search locate where show reach touch go approach"
)
# Words that cannot be part of a name: what remains of a clause that says more than the grammar knows.
_NOT_IN_NAMES = (
    word_set(
        "on in into onto to from of off at over under inside beside near next behind by with without that which who "
        "whose same than as if until while and or but not then before after is are all both every each away up down "
        "close back"
    )
    | _VERBS
)


class NotUnderstoodError(GoalError):
    """A part of a goal that the small language has no rule for.

    Attributes:
        part: The words.
    """

    def __init__(self, part: str, whole: str, why: str) -> None:
        super().__init__(f"cannot understand '{part}' in '{whole}': {why}; understood are {UNDERSTOOD}")
        self.part = part


@dataclass(frozen=True)
class Clause:
    """One wish.

    Attributes:
        kind: What is to happen.
        subject: Words for the thing that it happens to, without an article.
        target: Words for the other thing, for place and away.
        preposition: As it was said, for place.
    """

    kind: ClauseKind
    subject: str
    target: str | None = None
    preposition: str = ""

    def map_names(self, change: Callable[[str], str]) -> "Clause":
        """The same clause with both phrases changed, for instance to names of a scene."""
        target = None if self.target is None else change(self.target)
        return Clause(self.kind, change(self.subject), target, self.preposition)

    @property
    def phrases(self) -> tuple[str, ...]:
        """Words for the things that the clause is about."""
        return (self.subject,) if self.target is None else (self.subject, self.target)

    def as_text(self) -> str:
        """The clause in its plainest words; parsing them gives the clause back."""
        return {
            "place": f"place {self.subject} {self.preposition or 'on'} {self.target}",
            "away": f"move {self.subject} away from {self.target}",
            "lift": f"pick up {self.subject}",
            "find": f"look for {self.subject}",
            "reach": f"reach {self.subject}",
        }[self.kind]


def parse_goal(text: str) -> tuple[Clause, ...]:
    """All clauses of a goal, in order.

    Raises:
        GoalError: The goal is empty.
        NotUnderstoodError: No rule fits; the message names the part of the goal.
    """
    whole = " ".join(text.split())
    parts = _split(whole)
    if not parts:
        raise GoalError(f"the goal is empty; say what to reach, for instance {UNDERSTOOD}")
    clauses: list[Clause] = []
    for part in parts:
        clauses.append(_parse_clause(part, whole, clauses[-1].subject if clauses else None))
    return tuple(clauses)


def parse_step(text: str) -> Clause | None:
    """A plan's step as a clause, or None when it is not exactly one clause of this language."""
    try:
        clauses = parse_goal(text)
    except GoalError:
        return None
    return clauses[0] if len(clauses) == 1 else None


def mentioned_phrases(goal: str) -> tuple[str, ...]:
    """Words for things that a goal speaks of, for cameras to look for; each once.

    A goal of this language gives exactly its names. Of any other text, the words after each article are taken, up to
    one that no name contains.
    """
    try:
        phrases = [p for clause in parse_goal(goal) for p in clause.phrases]
    except GoalError:
        phrases = []
        words = re.findall(r"[a-z0-9_]+", goal.lower())
        for k, word in enumerate(words):
            if word in ARTICLES:
                rest = words[k + 1 :]
                end = next((i for i, w in enumerate(rest) if w in _NOT_IN_NAMES or w in ARTICLES), len(rest))
                phrases.append(" ".join(rest[:end]).replace("_", " "))
    return tuple(dict.fromkeys(p for p in phrases if p))


def _split(whole: str) -> list[str]:
    text = re.sub(r"^(?:(?:please|can you|could you|would you)[ ,]+)+", "", whole.lower().strip())
    text = re.sub(r"[ ,]+please\b", "", text).rstrip(".!? ")
    verbs = "|".join(sorted(_VERBS))
    parts = re.split(rf"\s*[,;.]?\s*\b(?:and then|then)\b[\s,]*|\s*;\s*|\.\s+|,?\s+and\s+(?=(?:{verbs})\b)", text)
    return [p.strip(" ,.") for p in parts if p and p.strip(" ,.")]


def _parse_clause(part: str, whole: str, previous: str | None) -> Clause:
    text = " ".join(re.sub(r"[^a-z0-9_ ]", " ", part).split())
    for kind, pattern in _PATTERNS:
        match = pattern.fullmatch(text)
        if match:
            groups = match.groupdict()
            subject = _phrase(groups["a"], whole, previous)
            target = _phrase(groups["b"], whole, previous) if groups.get("b") else None
            how = groups.get("how") or ""
            if target is not None and words_of(subject) == words_of(target):
                raise NotUnderstoodError(part, whole, f"it names '{subject}' twice")
            return Clause(kind, subject, target, how if kind == "place" else "")
    if text.split()[0] in ("remove", "move", "take", "place", "put"):
        why = "it does not say where to, or away from what"
    else:
        why = "no rule fits these words"
    raise NotUnderstoodError(part, whole, why)


def _phrase(text: str, whole: str, previous: str | None) -> str:
    words = text.split()
    if words in (["it"], ["that"], ["this"]):
        if previous is None:
            raise NotUnderstoodError(text, whole, "nothing was named before it")
        return previous
    while words and words[0] in ARTICLES:
        words.pop(0)
    if not words:
        raise NotUnderstoodError(text, whole, "no name follows the article")
    for k, word in enumerate(words):
        if word in _NOT_IN_NAMES:
            raise NotUnderstoodError(" ".join(words[k:]), whole, "this says more than a name")
    return " ".join(words)
