"""Rules by which the builtin reasoner describes motions, writes reward programs, asks, and sums up failures."""

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from control.errors import ReasonerError
from control.tasks.reward_spec import PALM
from planning.language.answers import ABOUT_ROBOT
from planning.language.description import DescriptionLine, line_of, parse_line
from planning.language.goal_language import Clause, parse_step
from planning.language.names import AmbiguousName, MissingName, as_name, mentioned, resolve

AWAY_DISTANCE = 0.2  # [m] between centres; leaves a hand's width (0.2 m) for the next grasp and stays in reach
AWAY_FROM_DOORS = 0.5  # [m] from the centre of furniture: out of the way of its doors and of the hand that opens them
JOINT_STATES: dict[str, str] = {"open": "open", "close": "closed", "pull": "open"}
LIFT_HEIGHT = 0.25  # [m], of a lifted object's centre: clear of table-top things, far from the arm's own limits


def _is_look(action: str) -> bool:
    clause = parse_step(action)
    return clause is not None and clause.kind in ("find", "check")


def _understood(action: str, what: str) -> Clause:
    clause = parse_step(action)
    if clause is None:
        raise ReasonerError(f"the builtin reasoner cannot {what} '{action}': it is no step of its small language")
    return clause


def action_kind(fields: Mapping[str, Any]) -> str:
    """Looking, or not."""
    return "yes" if _is_look(fields["action"]) else "no"


def needs_relocation(fields: Mapping[str, Any]) -> str:
    """Placing, moving away and lifting move an object; reaching does not."""
    return "yes" if _understood(fields["action"], "judge").kind in ("place", "away", "lift") else "no"


def motion_description(fields: Mapping[str, Any]) -> str:
    """Palm to the object or to the furniture of the joint, then what it should come to."""
    clause = _understood(fields["action"], "describe")
    if clause.kind in JOINT_STATES:
        lines = _joint_lines(clause, fields)
    else:
        lines = _object_lines(clause, fields)
    body = "\n".join(str(line) for line in lines)
    return f"[start of description]\n{body}\n[end of description]"


def _joint_lines(clause: Clause, fields: Mapping[str, Any]) -> list[DescriptionLine]:
    joint = as_name(clause.subject)
    # A piece of furniture by its own name means its first door.
    joint = next((j for j in fields["joints"] if j == joint or j.startswith(f"{joint}_")), joint)
    owner = owner_of(joint, fields["objects"])
    if joint not in fields["joints"] or owner is None:
        known = ", ".join(fields["joints"]) or "none"
        raise ReasonerError(
            f"the builtin reasoner cannot describe '{fields['action']}': there is no joint '{joint}' here that a hand "
            f"can move; there are: {known}"
        )
    goal = line_of(JOINT_STATES[clause.kind], joint, value=clause.share)
    return [line_of("close", PALM, owner), goal]


def _object_lines(clause: Clause, fields: Mapping[str, Any]) -> list[DescriptionLine]:
    try:
        clause = clause.map_names(lambda phrase: resolve(phrase, fields["objects"]))
    except (MissingName, AmbiguousName) as error:
        raise ReasonerError(f"the builtin reasoner cannot describe '{fields['action']}': {error}") from None
    lines = [line_of("close", PALM, clause.subject)]
    if clause.kind == "place":
        lines.append(line_of("close", clause.subject, clause.target))
    elif clause.kind == "away":
        lines.append(line_of("far", clause.subject, clause.target))
    elif clause.kind == "lift":
        lines.append(line_of("height", clause.subject, value=LIFT_HEIGHT))
    return lines


def owner_of(joint: str, objects: Collection[str]) -> str | None:
    """The furniture that a joint belongs to: names of joints begin with it."""
    owners = [name for name in objects if joint.startswith(f"{name}_")]
    return max(owners, key=len, default=None)


def reward_call(line: DescriptionLine, joints: Sequence[str] = ()) -> str:
    """The call that serves a line."""
    words = [name for name in (line.a, line.b) if name is not None]
    number = line.definition.number
    if number is not None:
        value = line.form.value if line.value is None else line.value
        if value is None:  # the only number that descriptions leave out: how far from another thing
            value = AWAY_FROM_DOORS if any(j.startswith(f"{line.b}_") for j in joints) else AWAY_DISTANCE
        words.append(f"{value:g}" if number.default is None else f"{number.name}={value:g}")
    return f"{line.definition.call}({', '.join(words)})"


def reward_program(fields: Mapping[str, Any]) -> str:
    """One call per line; the last line is what the others lead to."""
    lines = [parse_line(text) for text in fields["description"]]
    calls = [reward_call(line, fields["joints"]) for line in lines if line is not None]
    if calls:
        calls[-1] = calls[-1][:-1] + ", primary_reward=True)"
    return "```python\n" + "\n".join(["reset_reward()", *calls, "execute_plan()"]) + "\n```"


def summarize_failure(fields: Mapping[str, Any]) -> str:
    """The explanations with most support, one per thing that they begin with."""
    sentences = [s for s in fields["explanations"] if not ABOUT_ROBOT.search(s)]
    if not sentences:
        return "<reason>Nothing is seen in the way.</reason>"
    support = Counter(s.split()[0] for s in sentences)
    ranked = sorted(dict.fromkeys(sentences), key=lambda s: -support[s.split()[0]])
    chosen: dict[str, str] = {}
    for sentence in ranked:
        chosen.setdefault(sentence.split()[0], sentence)
    return "\n".join(f"<reason>{s}</reason>" for s in list(chosen.values())[:2])


def perception_questions(fields: Mapping[str, Any]) -> str:
    """Whether the thing looked for is there, or whether it is as it should be."""
    clause = _understood(fields["action"], "ask about")
    known = [*fields["objects"], *fields["joints"], *fields["sought"]]
    subject = next(iter(mentioned(clause.subject, known)), as_name(clause.subject))
    if clause.kind == "check":
        where = f" {clause.target}" if clause.target else ""
        return f"<question>Is {subject} {clause.preposition}{where}?</question>"
    return f"<question>Is {subject} in view?</question>"


def question_type(fields: Mapping[str, Any]) -> str:
    """By its words."""
    question = fields["question"].lower()
    if re.search(r"in view|visible|\bwhere\b|\bis there\b|\bsee\b", question):
        return "OBJECT_PRESENCE"
    if re.search(r"colou?r|\bon\b|\bin\b|open|closed|shape|size|large|big", question):
        return "OBJECT_ATTRIBUTE"
    return "NEITHER"


def action_completed(fields: Mapping[str, Any]) -> str:
    """A look is done when an answer says that the thing is in view, or is as it should be."""
    clause = parse_step(fields["action"])
    if clause is not None and clause.kind == "check":
        return "yes" if any("? Yes," in observation for observation in fields["observations"]) else "no"
    name = as_name(clause.subject) if clause else as_name(fields["action"])
    found = any(re.search(rf"\b{re.escape(name)} is in view\b", observation) for observation in fields["observations"])
    return "yes" if found else "no"
