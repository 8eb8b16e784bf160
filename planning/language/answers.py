"""Strict parsers, one for each form of answer. Answers are untrusted text; what does not fit is refused with a reason.

The reason is worded so that it can be sent back with the question.
"""

import re
from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal, get_args

from planning.language.description import DescriptionLine, find_fault, parse_line
from planning.language.names import mentioned

MAX_ANSWER = 20_000  # characters; longer answers are a runaway model
MAX_STEPS = 12  # of one plan; the longest task of the benchmark took 17 actions over all its plans
MAX_STEP_LENGTH = 200  # characters
QuestionType = Literal["OBJECT_PRESENCE", "OBJECT_ATTRIBUTE", "NEITHER"]
ABOUT_ROBOT = re.compile(r"\b(robot\w*|arm|gripper|hand|palm|finger\w*|hold(?:s|ing)|motors?)\b", re.IGNORECASE)
_COMPARISON = re.compile(r"\b(which|same|than|compare\w*|similar|different|most|closest|nearest)\b", re.IGNORECASE)


class MalformedAnswerError(ValueError):
    """An answer that does not have the contract's form; the message tells the one who answered what to change."""


class UnusableAnswerError(MalformedAnswerError):
    """A backend knows by itself that its answer is none: cut off at the length limit, withheld, not of its schema.

    Attributes:
        text: What there is of it, for the record only.
    """

    def __init__(self, reason: str, text: str = "") -> None:
        super().__init__(reason)
        self.text = text


@dataclass(frozen=True)
class Plan:
    """A plan for a goal.

    Attributes:
        thought: Why this plan, for people and for later plans.
        steps: Actions in order; empty when the planner sees no way.
    """

    thought: str
    steps: tuple[str, ...]


def parse_yes_no(text: str) -> bool:
    """Answers that begin with yes or no."""
    match = re.match(r"\W*(yes|no)\b", _checked(text), re.IGNORECASE)
    if not match:
        raise MalformedAnswerError("the answer must begin with yes or no")
    return match[1].lower() == "yes"


def parse_plan(text: str) -> Plan:
    """<thought>...</thought>, then lines starting with > between [start plan] and [end plan]."""
    text = _checked(text)
    if text.count("[start plan]") != 1 or text.count("[end plan]") != 1:
        raise MalformedAnswerError("the plan must stand once between [start plan] and [end plan]")
    body = text.split("[start plan]")[1].split("[end plan]")[0]
    steps = []
    for line in filter(None, map(str.strip, body.splitlines())):
        if not line.startswith(">"):
            raise MalformedAnswerError(f"every line of the plan must start with '>', but one is '{line[:80]}'")
        step = line.lstrip("> ").strip()
        if not step:
            raise MalformedAnswerError("a line of the plan is empty")
        if len(step) > MAX_STEP_LENGTH:
            raise MalformedAnswerError(f"the step '{step[:60]}...' is too long; name one action in few words")
        steps.append(step)
    if len(steps) > MAX_STEPS:
        raise MalformedAnswerError(f"the plan has {len(steps)} steps; at most {MAX_STEPS} are allowed")
    return Plan(_one_tag(text, "thought"), tuple(steps))


def parse_description(
    text: str, objects: Collection[str], joints: Collection[str], relocates: bool
) -> tuple[DescriptionLine, ...]:
    """Lines of the motion template between [start of description] and [end of description]."""
    text = _checked(text)
    if text.count("[start of description]") != 1 or text.count("[end of description]") != 1:
        raise MalformedAnswerError(
            "the description must stand once between [start of description] and [end of description]"
        )
    body = text.split("[start of description]")[1].split("[end of description]")[0]
    lines = []
    for raw in filter(None, map(str.strip, body.splitlines())):
        line = parse_line(raw)
        if line is None:
            raise MalformedAnswerError(f"the line '{raw[:80]}' has none of the forms that were given")
        lines.append(line)
    fault = find_fault(lines, objects, joints, relocates)
    if fault:
        raise MalformedAnswerError(fault)
    return tuple(lines)


def parse_code_block(text: str) -> str:
    """The contents of the one fenced code block."""
    blocks = re.findall(r"```(?:[a-zA-Z]*)[ \t]*\n(.*?)```", _checked(text), re.DOTALL)
    if len(blocks) != 1:
        raise MalformedAnswerError(f"the answer must hold one code block between ``` marks; it has {len(blocks)}")
    return blocks[0]


def parse_step_number(text: str, lines: int, none_allowed: bool) -> int | None:
    """<step>n</step> with n in 1..lines; None for -1, where that is allowed."""
    numbers = re.findall(r"<step>\s*(-?\d{1,4})\s*</step>", _checked(text))
    if len(numbers) != 1:
        raise MalformedAnswerError(f"the answer must hold exactly one <step>n</step>; it has {len(numbers)}")
    n = int(numbers[0])
    if n == -1 and none_allowed:
        return None
    if not 1 <= n <= lines:
        raise MalformedAnswerError(f"there is no line {n}; the lines are 1 to {lines}")
    return n


def parse_sentence(text: str) -> str:
    """Free text of a few sentences that was not cut off."""
    text = " ".join(_checked(text).split())
    if len(text) > 1000:
        raise MalformedAnswerError("the answer is too long; one or two sentences were asked for")
    # A long text that ends without a stop ran into a length limit; a short one is just terse.
    if len(text.split()) > 6 and text[-1] not in ".!?\"')":
        raise MalformedAnswerError("the answer seems to be cut off; end it with a full stop")
    return text


def parse_reasons(text: str) -> tuple[str, ...]:
    """One or two <reason>...</reason>, about objects and not about the robot."""
    reasons = _tags(text, "reason", 1, 2)
    for reason in reasons:
        if ABOUT_ROBOT.search(reason):
            raise MalformedAnswerError(f"the reason '{reason[:80]}' is about the robot; give reasons about objects")
    return reasons


def parse_questions(text: str, names: Collection[str]) -> tuple[str, ...]:
    """One or two <question>...</question>, each about a named object and without comparing things.

    Args:
        text: The answer.
        names: Objects in view, joints of furniture, and objects sought.
    """
    questions = _tags(text, "question", 1, 2)
    for question in questions:
        if not mentioned(question, names):
            raise MalformedAnswerError(f"the question '{question[:80]}' names none of {sorted(names)}")
        comparison = _COMPARISON.search(question)
        if comparison:
            raise MalformedAnswerError(
                f"the question '{question[:80]}' compares things ('{comparison[0]}'); "
                "ask for one property of one named object"
            )
    return questions


def parse_question_type(text: str) -> QuestionType:
    """One of the three words."""
    found = re.findall(r"\b(OBJECT_PRESENCE|OBJECT_ATTRIBUTE|NEITHER)\b", _checked(text))
    if len(set(found)) != 1:
        raise MalformedAnswerError(f"the answer must be one of {', '.join(get_args(QuestionType))}")
    return found[0]


def parse_completion(text: str) -> tuple[bool, str | None]:
    """Yes; or no, with or without <Action>what remains</Action>."""
    if parse_yes_no(text):
        return True, None
    actions = _tags(text, "Action", 0, 1)
    return False, actions[0] if actions else None


def usable_vote(sentence: str, objects: Collection[str]) -> str | None:
    """Why a diagnosis cannot count, or None when it can: it must speak of objects, and not of the robot."""
    if ABOUT_ROBOT.search(sentence):
        return "it is about the robot"
    if not mentioned(sentence, objects):
        return "it names no object of the scene"
    return None


def _checked(text: str) -> str:
    if not text.strip():
        raise MalformedAnswerError("the answer is empty")
    if len(text) > MAX_ANSWER:
        raise MalformedAnswerError(f"the answer has {len(text)} characters; at most {MAX_ANSWER} are read")
    return text


def _tags(text: str, tag: str, least: int, most: int) -> tuple[str, ...]:
    text = _checked(text)
    found = tuple(" ".join(t.split()) for t in re.findall(rf"<{tag}>(.*?)</{tag}>", text, re.DOTALL))
    if text.count(f"<{tag}>") != len(found):
        raise MalformedAnswerError(f"a <{tag}> is not closed; the answer may have been cut off")
    found = tuple(t for t in found if t)
    if not least <= len(found) <= most:
        raise MalformedAnswerError(f"the answer must hold {least} to {most} <{tag}>...</{tag}>; it has {len(found)}")
    return found


def _one_tag(text: str, tag: str) -> str:
    return _tags(text, tag, 1, 1)[0]
