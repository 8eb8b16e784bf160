"""Rules by which the builtin reasoner plans, describes motions, writes reward programs and sums up failures."""

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from control.errors import GoalError, ReasonerError
from control.rewards import PALM
from planning.answers import ABOUT_ROBOT
from planning.description import DescriptionLine, parse_line
from planning.goal_language import Clause, parse_goal, parse_step
from planning.memory import MOTION_FAILED, FailedAttempt
from planning.names import AmbiguousName, MissingName, as_name, mentioned, resolve, with_names

AWAY_DISTANCE = 0.2  # [m] between centres; leaves a hand's width (0.2 m) for the next grasp and stays in reach
AWAY_SLACK = 0.02  # [m] by which a body may seem nearer than it was put
SAME_FAILURES = 3  # after as many failures in the same words another try is no new information
LIFT_HEIGHT = 0.25  # [m], of a lifted object's centre: clear of table-top things, far from the arm's own limits

# "X is on Y", "X is in the way", "X blocks ...": X is to blame, and Y says what it must go away from.
_BLAME = re.compile(
    r"(?P<x>\w+) (?:(?:is|lies|stands|sits) (?:already )?"
    r"(?:(?:on top of|on|in front of|inside|in|next to) (?!the way\b)(?:the |an? )?(?P<y>\w+)"
    r"|in the way|too close|blocking)|blocks|occupies|covers|obstructs)"
)
_CENTRE = re.compile(r"(?P<name>\w+): .*centre at x (?P<x>-?[\d.]+), y (?P<y>-?[\d.]+)")


def make_plan(fields: Mapping[str, Any]) -> str:
    """high_level_plan, replan and new_plan: the goal's clauses as steps, after what failures say must go first."""
    objects: Sequence[str] = fields["objects"]
    attempts: Sequence[FailedAttempt] = fields.get("attempts", ())
    finished: Sequence[str] = fields.get("finished", ())
    try:
        clauses = [_with_names(c, objects) for c in parse_goal(fields["goal"])]
    except (GoalError, MissingName, AmbiguousName) as error:
        return _plan_text(str(error), ())
    in_vain = [a.action for a in attempts if _is_look(a.action)]
    if in_vain:
        return _plan_text(f"I tried to {in_vain[-1]} and know nothing that may hide it", ())
    if _hopeless(attempts):
        return _plan_text(f"'{attempts[-1].action}' failed {SAME_FAILURES} times alike. {attempts[-1].reason}", ())
    # Whatever is lifted and then put somewhere is lifted on the way.
    clauses = [
        c
        for c, after in zip(clauses, [*clauses[1:], None], strict=True)
        if not (c.kind == "lift" and after is not None and after.subject == c.subject and after.target)
    ]
    remaining, done = [], Counter(finished)
    for clause in clauses:
        if done[clause.as_text()]:
            done[clause.as_text()] -= 1
        else:
            remaining.append(clause)
    wanted = {c.as_text() for c in clauses}
    steps: list[str] = []
    for clause in remaining or clauses:
        prepared = _with_removals(clause, objects, attempts, fields.get("facts", ()), Counter(finished), ())
        steps += [s for s in prepared if s in wanted or s not in steps]
    first_removal = next((s for s in steps if s not in wanted), None)
    if not attempts:
        thought = "The goal says what to do"
    elif first_removal:
        thought = f"{_last_sentence(attempts[-1].reason)}, so I {first_removal} first"
    else:
        thought = f"{_last_sentence(attempts[-1].reason)}, so I try again"
    return _plan_text(thought, steps)


def _last_sentence(reason: str) -> str:
    return reason.rstrip(". ").split(". ")[-1]


def _hopeless(attempts: Sequence[FailedAttempt]) -> bool:
    """Whether the last attempts were one action that failed each time in the same words."""
    last = attempts[-SAME_FAILURES:]
    alike = len(last) == SAME_FAILURES and len({(a.action, a.reason) for a in last}) == 1
    return alike and not last[0].reason.startswith(MOTION_FAILED)


def _with_removals(
    clause: Clause,
    objects: Sequence[str],
    attempts: Sequence[FailedAttempt],
    facts: Sequence[str],
    finished: Counter[str],
    above: tuple[str, ...],
) -> list[str]:
    """The clause's step, with steps before it that move away what its failures blame; those steps likewise.

    A body that was moved away as often as it was blamed is out of the way. `above` are the steps being prepared, so
    that two things which block each other do not send the rules in circles.
    """
    step = clause.as_text()
    steps: list[str] = []
    blames = Counter(b for a in attempts if a.action == step for b in set(_blames(a, clause, objects, facts)))
    for (body, place), count in blames.items():
        removal = Clause("away", body, place)
        if finished[removal.as_text()] < count and removal.as_text() not in above:
            steps += _with_removals(removal, objects, attempts, facts, finished, (*above, step))
    return [*steps, step]


def _blames(
    attempt: FailedAttempt, clause: Clause, objects: Sequence[str], facts: Sequence[str]
) -> list[tuple[str, str]]:
    """Pairs of a body to blame and the thing of the step that it must go away from.

    That thing is the one that the body is said to be on, in or beside; else the one that it is seen nearest to. A
    body that is seen to be away from it already is not the reason.
    """
    if attempt.reason.startswith(MOTION_FAILED):
        return []  # the plan was sound
    places: dict[str, str | None] = {}
    for match in _BLAME.finditer(with_names(attempt.reason, objects)):
        body, place = match["x"], match["y"]
        if body in objects and body not in clause.phrases:
            places[body] = place if place in clause.phrases else places.get(body)
    centres = {m["name"]: (float(m["x"]), float(m["y"])) for m in map(_CENTRE.match, facts) if m}
    found = []
    for body, said in places.items():
        at = centres.get(body)
        gaps = {n: math.dist(at, centres[n]) for n in clause.phrases if at and n in centres}
        place = said or min(gaps, key=lambda n: gaps[n], default=clause.target or clause.subject)
        if gaps.get(place, 0.0) < AWAY_DISTANCE - AWAY_SLACK:
            found.append((body, place))
    return found


def _with_names(clause: Clause, objects: Sequence[str]) -> Clause:
    if clause.kind == "find":
        try:
            return clause.map_names(lambda phrase: resolve(phrase, objects))
        except MissingName:
            return clause.map_names(as_name)  # to look for what is not in view is the point
    named = clause.map_names(lambda phrase: resolve(phrase, objects))
    if named.subject == named.target:
        raise GoalError(f"'{clause.subject}' and '{clause.target}' both mean {named.subject}; name two things")
    return named


def _plan_text(thought: str, steps: Sequence[str]) -> str:
    lines = "".join(f"> {step}\n" for step in steps)
    return f"<thought>{' '.join(thought.split())}</thought>\n[start plan]\n{lines}[end plan]"


def _is_look(action: str) -> bool:
    clause = parse_step(action)
    return clause is not None and clause.kind == "find"


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
    """Palm to the object, then where the object goes."""
    clause = _understood(fields["action"], "describe")
    try:
        clause = clause.map_names(lambda phrase: resolve(phrase, fields["objects"]))
    except (MissingName, AmbiguousName) as error:
        raise ReasonerError(f"the builtin reasoner cannot describe '{fields['action']}': {error}") from None
    lines = [DescriptionLine("close", PALM, clause.subject)]
    if clause.kind == "place":
        lines.append(DescriptionLine("close", clause.subject, clause.target))
    elif clause.kind == "away":
        lines.append(DescriptionLine("far", clause.subject, clause.target))
    elif clause.kind == "lift":
        lines.append(DescriptionLine("height", clause.subject, value=LIFT_HEIGHT))
    body = "\n".join(str(line) for line in lines)
    return f"[start of description]\n{body}\n[end of description]"


def reward_call(line: DescriptionLine) -> str:
    """The call that serves a line."""
    if line.kind == "close":
        return f"minimize_l2_distance_reward({line.a}, {line.b})"
    if line.kind == "far":
        return f"maximize_l2_distance_reward({line.a}, {line.b}, distance={AWAY_DISTANCE})"
    if line.kind == "height":
        return f"set_obj_z_position_reward({line.a}, {line.value:g})"
    return f"set_joint_fraction_reward({line.a}, {1 if line.kind == 'open' else 0})"


def reward_program(fields: Mapping[str, Any]) -> str:
    """One call per line; the last line is what the others lead to."""
    lines = [parse_line(text) for text in fields["description"]]
    calls = [reward_call(line) for line in lines if line is not None]
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
    """Whether the thing looked for is there."""
    clause = _understood(fields["action"], "ask about")
    known = [*fields["objects"], *fields["sought"]]
    subject = next(iter(mentioned(clause.subject, known)), as_name(clause.subject))
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
    """A look is done when an answer says that the thing is in view."""
    clause = parse_step(fields["action"])
    name = as_name(clause.subject) if clause else as_name(fields["action"])
    found = any(re.search(rf"\b{re.escape(name)} is in view\b", observation) for observation in fields["observations"])
    return "yes" if found else "no"
