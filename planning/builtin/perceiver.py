"""Rules by which the builtin reasoner answers questions about the scene, from the facts of perception alone."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

from planning.language.memory import MOTION_FAILED
from planning.language.names import as_name, colour_of, mentioned
from planning.language.scene_facts import SceneFacts, read_facts

_SEEKS = re.compile(r"is (?:there )?(?:the |an? )?(?P<x>[\w ]+?) (?:in view|visible|there)\b", re.IGNORECASE)
_STATE = re.compile(r"is (?P<x>\w+) (?P<how>open|closed|on|in)(?: (?!view)(?P<y>\w+))?\?", re.IGNORECASE)
_LOCKED = re.compile(r"(?P<x>\w+) is locked\b")
_IN_THE_WAY = re.compile(r"(?P<x>\w+) is (?:in the way|too close)\b")


def perceive_object(fields: Mapping[str, Any]) -> str:
    """In view is what perception found."""
    return "yes" if as_name(fields["object"]) in read_facts(fields["facts"]).seen else "no"


def answer_question(fields: Mapping[str, Any]) -> str:
    """Presence, colour, the state of a joint, and what lies on or in a thing."""
    question, facts = fields["question"], read_facts(fields["facts"])
    seen = facts.seen
    state = _STATE.fullmatch(question.strip())
    if state:
        return _is_so(state, facts)
    if re.search(r"\bin the way\b|\bunnamed\b", question, re.IGNORECASE):
        return _unnamed_things(facts)
    named = mentioned(question, seen)
    match = _SEEKS.search(question)
    if match or not named:
        name = as_name(match["x"]) if match else as_name(question)
        return f"Yes, {name} is in view: {seen[name]}." if name in seen else f"No, {name} is not in view."
    name = named[0]
    if re.search(r"colou?r", question, re.IGNORECASE):
        colour = colour_of(name) or facts.colours.get(name)
        return f"{name} is {colour}." if colour else f"The colour of {name} is not known."
    if re.search(r"\bwhere\b", question, re.IGNORECASE):
        return f"{name} is in view: {seen[name]}."
    carried = [f"{a} is {how} {b}" for a, how, b in facts.relations if b == name and how != "next to"]
    return (" and ".join(carried) or f"Nothing is seen on or in {name}") + "."


def _unnamed_things(facts: SceneFacts) -> str:
    """What may be in the way without anybody having named it."""
    things = [f"{name} is in view: {facts.seen[name]}" for name in sorted(facts.unnamed)]
    return (". ".join(things) or "Nothing is seen that nobody named") + "."


def _is_so(asked: re.Match[str], facts: SceneFacts) -> str:
    """Whether a joint is open or closed, or a thing on or in another one."""
    name, how, place = as_name(asked["x"]), asked["how"], asked["y"]
    if place is None:
        joint = facts.joints.get(name)
        if joint is None:
            return f"The state of {name} is not known."
        so = joint.at_end if how == "open" else joint.at_start
        return f"{'Yes' if so else 'No'}, {name} is {joint.state}."
    found = any((a, b) == (name, as_name(place)) and h in ("on", "in") for a, h, b in facts.relations)
    return f"Yes, {name} is {how} {as_name(place)}." if found else f"No, {name} is not seen {how} {as_name(place)}."


def diagnose_failure(fields: Mapping[str, Any]) -> str:
    """The first three wordings: what the attempt reported; the others: what lies on, in or before what it is about."""
    facts = read_facts(fields["facts"])
    named = mentioned(fields["action"], fields["objects"])
    # A joint is blocked where its furniture is.
    own = [*named, *(facts.joints[n].owner for n in named if n in facts.joints)]
    own = list(dict.fromkeys(own))
    about = " and ".join(named) or "what was asked for"
    nothing = f"Nothing is seen in the way of {about}."
    measured: Sequence[str] = fields["measured"]
    if any(line.startswith(MOTION_FAILED) for line in measured):
        return nothing
    where = {a: f"{how} {b}" for a, how, b in facts.relations if b in own and how != "next to"}
    if fields["phrasing"] <= 3:
        locked = next((m["x"] for m in map(_LOCKED.match, measured) if m and m["x"] in named), None)
        if locked:
            return _standing(where, own) or f"{locked} is locked and nothing is seen in its way."
        blamed = [m["x"] for line in measured for m in _IN_THE_WAY.finditer(line)]
        blamed = [b for b in dict.fromkeys(blamed) if b in fields["objects"] and b not in own]
        sentences = [
            f"{b} is {where[b]} and is in the way." if b in where else f"{b} is in the way of {about}." for b in blamed
        ]
        if sentences:
            return " ".join(sentences[:2])
    return _standing(where, own) or nothing


def _standing(where: Mapping[str, str], own: Sequence[str]) -> str:
    return " ".join([f"{a} is {place}." for a, place in where.items() if a not in own][:2])
