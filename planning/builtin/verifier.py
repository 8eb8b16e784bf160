"""Rules by which the builtin reasoner checks reward calls and names."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

from control.tasks.reward_spec import PALM, RewardTerm
from planning.builtin.planner import JOINT_STATES, reward_call
from planning.language.answers import MalformedAnswerError
from planning.language.description import DescriptionLine, parse_line
from planning.language.goal_language import parse_step
from planning.language.names import ARTICLES, as_name, candidates, closest, mentioned, word_set
from planning.language.reward_program import EXECUTE, parse_reward_program

# Words that end a name in a sentence, and nouns that are no objects of the scene.
_ENDS = word_set(
    "is are was were has have lies stands sits blocks keeps prevents stops occupies covers and or but on in into "
    "of at to from off out over under with by for near next inside behind beside too already still that which it "
    "its can cannot must"
)
_NO_OBJECTS = word_set(
    "way top bottom side front middle edge space room place table surface scene picture object thing goal action "
    "motion reason inside outside left right ground floor position robot arm gripper hand"
)


def _term(call: str) -> RewardTerm | None:
    words = re.findall(r"\w+", call)
    try:
        return parse_reward_program(f"{call}\n{EXECUTE}()", words, words).calls[0].term
    except MalformedAnswerError:
        return None


def _same(a: RewardTerm, b: RewardTerm) -> bool:
    """Whether two terms are about the same thing; distances have no order, and numbers may differ."""
    return a.kind == b.kind and {a.subject, a.target} == {b.subject, b.target}


def verify_reward(fields: Mapping[str, Any]) -> str:
    """The line whose own call is about the same things."""
    term = _term(fields["call"])
    for number, text in enumerate(fields["description"], 1):
        line = parse_line(text)
        wanted = _term(reward_call(line)) if line is not None else None
        if term is not None and wanted is not None and _same(term, wanted) and _same_sense(line, term):
            return f"<step>{number}</step>"
    return "<step>-1</step>"


def _same_sense(line: DescriptionLine | None, term: RewardTerm) -> bool:
    """An open joint is not a closed one."""
    if line is None or line.kind not in ("open", "closed"):
        return True
    share = float(term.value or 0.0)
    return share == line.value if line.value is not None else (share >= 0.5) == (line.kind == "open")


def verify_primary(fields: Mapping[str, Any]) -> str:
    """The line that says what the action asks for; for other actions the last one that is not about the palm."""
    lines = [parse_line(text) for text in fields["description"]]
    clause = parse_step(fields["action"])
    kinds = {"place": "close", "away": "far", "lift": "height", "reach": "close", **JOINT_STATES}
    kind = kinds.get(clause.kind) if clause else None
    about_palm = clause is not None and clause.kind == "reach"
    fitting = [k for k, line in enumerate(lines, 1) if line and line.kind == kind and (line.a == PALM) == about_palm]
    others = [k for k, line in enumerate(lines, 1) if line and line.a != PALM]
    number = (fitting or others or [len(lines)])[-1]
    return f"<thought>The action is done when line {number} is true.</thought>\n<step>{number}</step>"


def unknown_phrases(sentence: str, objects: Sequence[str]) -> list[str]:
    """Words of a sentence that stand where a name would and mean nothing in the scene."""
    found = [w for w in re.findall(r"\b\w+_\w+\b", sentence) if w.lower() not in objects]
    words = re.findall(r"\w+", sentence)
    for k, word in enumerate(words):
        if word.lower() not in ARTICLES:
            continue
        rest = words[k + 1 : k + 4]
        end = next((i for i, w in enumerate(rest) if w.lower() in _ENDS), len(rest))
        phrase = " ".join(rest[:end])
        known = not phrase or rest[end - 1].lower() in _NO_OBJECTS or mentioned(phrase, objects)
        # "the block" for a thing that is called cube here is understood, but has to be written with its name.
        if not known and len(candidates(phrase, objects)) < 2:
            found.append(phrase)
    return list(dict.fromkeys(found))


def verify_names(fields: Mapping[str, Any]) -> str:
    """Names in the sentence that the scene does not have."""
    unknown = unknown_phrases(fields["sentence"], fields["objects"])
    return f"yes: {', '.join(unknown)}" if unknown else "no"


def remap_names(fields: Mapping[str, Any]) -> str:
    """Each unknown name replaced by the closest one, if any is close."""
    sentence = fields["sentence"]
    for phrase in unknown_phrases(sentence, fields["objects"]):
        name = next(iter(candidates(phrase, fields["objects"])), None) or closest(as_name(phrase), fields["objects"])
        if name is not None:
            sentence = re.sub(rf"\b{re.escape(phrase)}\b", name, sentence)
    return sentence
