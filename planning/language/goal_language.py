"""A small language of goals and plan steps: what the rule-based reasoner understands.

    GOAL    = PART { ("then" | "and then" | ";" | "and" or "," before a verb) PART }
    PART    = CLAUSE | HINT
    CLAUSE  = place|put|move|stack|...  X  on|in|into|onto|to|...  Y
            | move|take|remove|...      X  away from|off|out of|from  Y
            | pick up|lift|...          X
            | clear|empty               X
            | look for|find|...         X  [in Y]
            | move to|reach|touch|...   X
            | open|look into|...        X  [to N %]
            | close|shut                X
            | pull|press|operate|...    X
            | see whether               X  is  on|in Y | open | closed
    HINT    = X  opens|unlocks|...  when  Y is put on Z | Y is pulled | ...
    X, Y    = words without prepositions, an article first or not; "it" is the clause before's X; a thing may be said
              to have the same colour as another

Steps of plans are clauses with exact names ("place red_cube on crate"), so one parser reads both.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from control.errors import GoalError
from planning.language.names import ARTICLES, LIKE, word_set, words_of
from planning.language.plain_words import plainer, split_goal, told_where

ClauseKind = Literal["place", "away", "lift", "clear", "find", "reach", "open", "close", "pull", "check"]

UNDERSTOOD = (
    '"place X on Y", "put X in Y", "move X away from Y", "take X out of Y", "pick up X", "clear X", "find X", '
    '"reach X", "open X", "close X", "pull X", several joined by "then"'
)

_ONTO = r"(?P<how>on top of|onto|on|inside of|inside|into|in|over|at|to)"
_FROM = r"(?P<how>away from|(?:from|off)(?: on)?(?: the)? top of|off of|off|out of|from)"
_PLACE = (
    "place|put|move|stack|set|lay|bring|carry|drop|transfer|take|stow|insert|store|position|deposit|leave|return|slide"
    "|hide|pop|tuck|rest|get"
)
_REQUEST = r"(?:make sure(?: that)?|see to it that|ensure(?: that)?|i (?:want|need|would like)|we (?:want|need))"
_BE = r"(?:is|are|to be|be|should be|ends up|belongs|goes)"
_PATTERNS: tuple[tuple[ClauseKind, re.Pattern[str]], ...] = tuple(
    (kind, re.compile(pattern))  # type: ignore[misc]
    for kind, pattern in (
        ("check", r"(?:see whether|is) (?P<a>.+?)(?: is)? (?P<how>open|closed)"),
        ("check", r"see whether (?P<a>.+?) is (?P<how>on|in) (?P<b>.+)"),
        ("open", r"open (?P<a>.+?) (?P<how>to [0-9]{1,3})(?: percent)?"),
        ("open", rf"{_REQUEST} (?P<a>.+?) {_BE} (?:open|opened)"),
        ("close", rf"{_REQUEST} (?P<a>.+?) {_BE} (?:closed|shut)"),
        ("away", rf"{_REQUEST} (?P<a>.+?) (?:{_BE} )?{_FROM} (?P<b>.+)"),
        ("place", rf"{_REQUEST} (?P<a>.+?) (?:{_BE} )?{_ONTO} (?P<b>.+)"),
        ("place", rf"(?P<a>.+?) (?:should be|belongs|goes|should go|must be|must go) {_ONTO} (?P<b>.+)"),
        ("find", r"(?:look for|find|search for|locate|where is|show me|is there) (?P<a>.+?) (?:in|inside) (?P<b>.+)"),
        ("find", r"(?:look for|find|search for|locate|where is|show me) (?P<a>.+)"),
        ("find", r"is (?P<a>.+?) (?:in|inside) (?P<b>.+)"),
        ("open", r"(?:look (?:into|inside of|inside|in)|check|what is (?:in|inside)) (?P<a>.+)"),
        ("open", r"(?:open up|open|unlock|unbolt|slide open|swing open) (?P<a>.+)"),
        ("open", r"(?:pull|push|slide|swing|get) (?P<a>.+?) open"),
        ("close", r"(?:close|shut)(?: up)? (?P<a>.+)"),
        ("close", r"(?:pull|push|slide|swing) (?P<a>.+?) (?:shut|closed)"),
        ("reach", r"(?:reach for|reach|touch|go to|move to|approach) (?P<a>.+)"),
        ("reach", r"(?:move|bring) (?:the )?(?:palm|hand|arm|gripper) (?:close to|to|towards) (?P<a>.+)"),
        ("clear", r"(?:clear|clear off|empty|unload) (?P<a>.+)"),
        ("clear", rf"(?:take|remove|get|clear|move) (?:everything|all things|whatever is) {_FROM} (?P<a>.+)"),
        (
            "away",
            rf"(?:move|take|remove|get|clear|keep|bring|pull|put|fetch|lift|pick|slide) (?P<a>.+?)(?: up)? {_FROM} "
            r"(?P<b>.+)",
        ),
        ("place", rf"(?:{_PLACE}) (?P<a>.+?) {_ONTO} (?P<b>.+)"),
        ("place", r"(?P<x>load|fill) (?P<b>.+?) (?P<how>with) (?P<a>.+)"),
        ("lift", r"(?:pick up|lift up|lift|raise|grasp|grab|hold|fetch(?: me)?|bring me|get me|hand me) (?P<a>.+)"),
        ("lift", r"(?:pick|lift) (?P<a>.+) up"),
        ("lift", r"(?:get|bring|take) (?P<a>[\w ]+)"),
        ("pull", r"(?:pull|press|push|operate|flip|turn|use|activate|switch)(?: on| down)? (?P<a>.+?)(?: down| on)?"),
    )
)
_VERBS = word_set(
    "place put move stack set lay bring carry drop transfer take remove get clear keep pull pick lift raise grasp "
    "grab look find search locate where show reach touch go approach open close shut unlock press operate flip "
    "activate stow insert store deposit leave return fetch empty unload ensure push slide check stand "
    "hide pop tuck rest load fill"
)
# Words that cannot be part of a name: what remains of a clause that says more than the grammar knows.
_NOT_IN_NAMES = (
    word_set(
        "on in into onto to from of off at over under inside beside near next behind by with without that which who "
        "whose same than as if until while and or but not then before after is are all both every each away up down "
        "back everything"
    )
    | _VERBS
)
_HINT = re.compile(
    r"(?P<what>.+?) (?:opens|unlocks|releases|is unlocked|is opened|is released|can be opened|lets go)"
    r" (?:when|if|once|as soon as|after) (?P<how>.+)"
)
_ENABLED = re.compile(r"(?P<a>.+?) (?:is|are|has been|gets) (?P<done>\w+)(?: (?P<where>on|onto|in|into) (?P<b>.+))?")
_PUT = word_set("put placed set laid moved brought stacked")
_DRIVEN = word_set("pulled pressed pushed turned operated flipped moved")


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
    """One clause of a goal.

    Attributes:
        kind: What is to happen.
        subject: Words for the thing that it happens to, without an article.
        target: Words for the other thing, for place and away, and where given for find and check.
        preposition: As it was said, for place; on, in, open or closed for check; "to N", in %, for open.
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

    @property
    def share(self) -> float | None:
        """How far something is to be opened, 0..1; None where nothing is said, which means all the way."""
        said = re.fullmatch(r"to (\d+)", self.preposition)
        return min(1.0, int(said[1]) / 100) if said and self.kind == "open" else None

    def as_text(self) -> str:
        """The clause in its plainest words; parsing them gives the clause back."""
        place = f" in {self.target}" if self.target else ""
        state = f"{self.preposition} {self.target}" if self.target else self.preposition
        share = f" {self.preposition} %" if self.preposition else ""
        return {
            "place": f"place {self.subject} {self.preposition or 'on'} {self.target}",
            "away": f"move {self.subject} away from {self.target}",
            "lift": f"pick up {self.subject}",
            "clear": f"clear {self.subject}",
            "find": f"look for {self.subject}{place}",
            "reach": f"reach {self.subject}",
            "open": f"open {self.subject}{share}",
            "close": f"close {self.subject}",
            "pull": f"pull {self.subject}",
            "check": f"see whether {self.subject} is {state}",
        }[self.kind]


@dataclass(frozen=True)
class Hint:
    """What a goal tells about the place: `what` opens when `clause` has been done.

    Attributes:
        what: Words for what opens.
        clause: What opens it.
    """

    what: str
    clause: Clause


@dataclass(frozen=True)
class Goal:
    """What is wanted, and what is told besides."""

    clauses: tuple[Clause, ...]
    hints: tuple[Hint, ...] = ()


def parse_goal(text: str) -> Goal:
    """All clauses of a goal, in order, and its hints.

    Raises:
        GoalError: The goal is empty.
        NotUnderstoodError: No rule fits; the message names the part of the goal.
    """
    whole = " ".join(text.split())
    parts = split_goal(whole, "|".join(sorted(_VERBS)))
    if not parts:
        raise GoalError(f"the goal is empty; say what to reach, for instance {UNDERSTOOD}")
    clauses: list[Clause] = []
    hints: list[Hint] = []
    before = _Before()
    for k, part in enumerate(parts):
        about = told_where(part) if k + 1 < len(parts) else None
        if about is not None:
            before = _Before(subject=_phrase(about, whole, None))
            continue
        hint = _parse_hint(part, whole, before.subject)
        if hint is not None:
            hints.append(hint)
            continue
        clauses += _parse_clauses(part, whole, before)
        before = _Before(clauses[-1].kind, clauses[-1].subject, clauses[-1].target or before.target)
    if not clauses:
        raise NotUnderstoodError(parts[0], whole, "it tells how something opens, but not what to do")
    return Goal(tuple(clauses), tuple(hints))


def parse_step(text: str) -> Clause | None:
    """A plan's step as a clause, or None when it is not exactly one clause of this language."""
    try:
        goal = parse_goal(text)
    except GoalError:
        return None
    return goal.clauses[0] if len(goal.clauses) == 1 and not goal.hints else None


def only_compared_with(goal: str) -> frozenset[str]:
    """Words for things that a goal speaks of for their colour only ("the colour of a lemon")."""
    try:
        said = [p for clause in parse_goal(goal).clauses for p in clause.phrases]
    except GoalError:
        return frozenset()
    named = {phrase.split(LIKE)[0] for phrase in said}
    return frozenset(part for phrase in said for part in phrase.split(LIKE)[1:] if part not in named)


def mentioned_phrases(goal: str) -> tuple[str, ...]:
    """Words for things that a goal speaks of, for cameras to look for; each once.

    A goal of this language gives exactly its names. Of any other text, the words after each article are taken, up to
    one that no name contains.
    """
    try:
        parsed = parse_goal(goal)
        said = [p for clause in (*parsed.clauses, *(h.clause for h in parsed.hints)) for p in clause.phrases]
        phrases = [part for phrase in said for part in phrase.split(LIKE)]
    except GoalError:
        phrases = []
        words = re.findall(r"[a-z0-9_]+", goal.lower())
        for k, word in enumerate(words):
            if word in ARTICLES:
                rest = words[k + 1 :]
                end = next((i for i, w in enumerate(rest) if w in _NOT_IN_NAMES or w in ARTICLES), len(rest))
                phrases.append(" ".join(rest[:end]).replace("_", " "))
    return tuple(dict.fromkeys(p for p in phrases if p))


def _parse_hint(part: str, whole: str, previous: str | None) -> Hint | None:
    match = _HINT.fullmatch(plainer(part, None, None, _NOT_IN_NAMES))
    if match is None:
        return None
    what = " ".join(w for w in words_of(match["what"]) if w not in ("lock", "bolt", "door")) or (previous or "")
    enabled = _ENABLED.fullmatch(match["how"])
    if enabled and enabled["done"] in _PUT and enabled["b"]:
        on = _phrase(enabled["b"], whole, what)
        where = "in" if enabled["where"].startswith("in") else "on"
        return Hint(what, Clause("place", _phrase(enabled["a"], whole, previous), on, where))
    if enabled and enabled["done"] in _DRIVEN and not enabled["b"]:
        return Hint(what, Clause("pull", _phrase(enabled["a"], whole, previous)))
    raise NotUnderstoodError(match["how"], whole, "it does not say what has to be put where, or pulled")


@dataclass(frozen=True)
class _Before:
    """What the part before was about, for words that stand for it."""

    kind: ClauseKind | None = None
    subject: str | None = None
    target: str | None = None


def _parse_clauses(part: str, whole: str, before: _Before) -> list[Clause]:
    """One clause, or one for each of several things that are to go the same way."""
    text = plainer(part, before.subject, before.target, _NOT_IN_NAMES)
    for kind, pattern in _PATTERNS:
        match = pattern.fullmatch(text)
        if match:
            return _clauses(kind, match.groupdict(), part, whole, before.subject)
    if before.kind == "place":  # "then the yellow cube on the blue crate": the verb is the one before
        match = re.fullmatch(rf"(?P<a>.+?) {_ONTO} (?P<b>.+)", text)
        if match and text.split()[0] in ARTICLES:
            return _clauses("place", match.groupdict(), part, whole, before.subject)
    if text.split()[0] in ("remove", "move", "take", "place", "put"):
        why = "it does not say where to, or away from what"
    else:
        why = "no rule fits these words"
    raise NotUnderstoodError(part, whole, why)


def _clauses(kind: ClauseKind, groups: dict, part: str, whole: str, previous: str | None) -> list[Clause]:
    target = _phrase(groups["b"], whole, previous) if groups.get("b") else None
    how = (groups.get("how") or "") if kind in ("place", "check", "open") else ""
    how = "in" if how == "with" else how  # "load the oven with the cube"
    clauses = []
    for words in re.split(r" and (?:also )?", groups["a"]):
        subject = _phrase(words, whole, previous)
        if target is not None and words_of(subject) == words_of(target):
            raise NotUnderstoodError(part, whole, f"it names '{subject}' twice")
        clauses.append(Clause(kind, subject, target, how))
    return clauses


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
