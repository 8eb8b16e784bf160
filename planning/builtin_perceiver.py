"""Rules by which the builtin reasoner answers questions about the scene, from the facts of perception alone."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

from planning.memory import MOTION_FAILED
from planning.names import as_name, colour_of, mentioned

_RELATION = re.compile(r"(?P<a>\w+) is (?P<how>on|in|next to) (?P<b>\w+)")
_OBJECT = re.compile(r"(?P<name>\w+): (?P<what>.+)")
_SEEKS = re.compile(r"is (?:there )?(?:the |an? )?(?P<x>[\w ]+?) (?:in view|visible|there)\b", re.IGNORECASE)
_IN_THE_WAY = re.compile(r"(?P<x>\w+) is (?:in the way|too close)\b")


def _seen(facts: Sequence[str]) -> dict[str, str]:
    return {m["name"]: m["what"] for m in map(_OBJECT.fullmatch, facts) if m}


def _relations(facts: Sequence[str]) -> list[tuple[str, str, str]]:
    return [(m["a"], m["how"], m["b"]) for m in map(_RELATION.fullmatch, facts) if m]


def perceive_object(fields: Mapping[str, Any]) -> str:
    """In view is what perception found."""
    return "yes" if as_name(fields["object"]) in _seen(fields["facts"]) else "no"


def answer_question(fields: Mapping[str, Any]) -> str:
    """Presence, colour as the name says it, and what lies on or in a thing."""
    question, seen = fields["question"], _seen(fields["facts"])
    named = mentioned(question, seen)
    match = _SEEKS.search(question)
    if match or not named:
        name = as_name(match["x"]) if match else as_name(question)
        return f"Yes, {name} is in view: {seen[name]}." if name in seen else f"No, {name} is not in view."
    name = named[0]
    if re.search(r"colou?r", question, re.IGNORECASE):
        colour = colour_of(name)
        return f"{name} is {colour}." if colour else f"The colour of {name} is not known."
    if re.search(r"\bwhere\b", question, re.IGNORECASE):
        return f"{name} is in view: {seen[name]}."
    carried = [f"{a} is {how} {b}" for a, how, b in _relations(fields["facts"]) if b == name and how != "next to"]
    return (" and ".join(carried) or f"Nothing is seen on or in {name}") + "."


def diagnose_failure(fields: Mapping[str, Any]) -> str:
    """The first three wordings: what the attempt reported; the others: what lies on or in the things of the action."""
    own = mentioned(fields["action"], fields["objects"])
    about = " and ".join(own) or "what was asked for"
    nothing = f"Nothing is seen in the way of {about}."
    measured: Sequence[str] = fields["measured"]
    if any(line.startswith(MOTION_FAILED) for line in measured):
        return nothing
    where = {a: f"{how} {b}" for a, how, b in _relations(fields["facts"]) if b in own and how != "next to"}
    if fields["phrasing"] <= 3:
        blamed = [m["x"] for line in measured for m in _IN_THE_WAY.finditer(line)]
        blamed = [b for b in dict.fromkeys(blamed) if b in fields["objects"] and b not in own]
        sentences = [
            f"{b} is {where[b]} and is in the way." if b in where else f"{b} is in the way of {about}." for b in blamed
        ]
        if sentences:
            return " ".join(sentences[:2])
    sentences = [f"{a} is {place}." for a, place in where.items() if a not in own]
    return " ".join(sentences[:2]) or nothing
