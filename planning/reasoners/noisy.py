"""A reasoner that makes mistakes on purpose, to measure what parsers, verifier and repair are worth.

Mistakes are of the kind that language models make: another object's name, a lost step, the wrong line's number. Most of
them are well-formed, so that a parser alone does not catch them. Every one of them is logged.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from planning.language.names import mentioned
from planning.reasoners.options import NoiseOptions
from planning.reasoners.reasoner import AnswerUsage, Log, Reasoner, usage_of
from prompts.contracts import AnswerForm
from prompts.contracts import contract as contract_of

# The answer, the question's fields and a random generator -> the wrong answer and what was done, or None where this
# mistake cannot be made.
_Maker = Callable[[str, Mapping[str, Any], np.random.Generator], tuple[str, str] | None]


class NoisyReasoner:
    """Spoils a share of another reasoner's answers.

    Args:
        inner: Answers.
        options: Which mistakes, and how often.
        rng: Source of all chance; the same generator state and questions give the same mistakes.
        log: Gets `noise` for every mistake: contract, kind, what was done, and both answers.
    """

    def __init__(self, inner: Reasoner, options: NoiseOptions, rng: np.random.Generator, log: Log) -> None:
        self._inner = inner
        self._options = options
        self._rng = rng
        self._log = log

    @property
    def name(self) -> str:
        """Of the reasoner that answers, and that it is not left alone."""
        return f"{self._inner.name} with {100 * self._options.rate:g} % of the answers spoiled"

    @property
    def usage(self) -> AnswerUsage:
        """See `planning.reasoners.reasoner.Metered`."""
        return usage_of(self._inner)

    def answer(self, contract: str, prompt: str, fields: Mapping[str, Any], images: Sequence[Any] = ()) -> str:
        """See `planning.reasoners.reasoner.Reasoner`."""
        answer = self._inner.answer(contract, prompt, fields, images)
        kind = contract_of(contract)
        options = self._options
        if kind.role not in options.roles or self._rng.random() >= options.rate:
            return answer
        for mistake in self._rng.permutation([m for m in MAKERS[kind.answer] if m in options.mistakes]):
            made = MAKERS[kind.answer][mistake](answer, fields, self._rng)
            if made is not None:
                spoiled, done = made
                self._log("noise", contract=contract, mistake=str(mistake), done=done, answer=answer, spoiled=spoiled)
                return spoiled
        return answer


# -- mistakes --------------------------------------------------------------------------------------------------------


def _dropped(answer: str, fields: Mapping[str, Any], rng: np.random.Generator) -> tuple[str, str]:
    return "", "the answer was dropped"


def _other_name(answer: str, fields: Mapping[str, Any], rng: np.random.Generator) -> tuple[str, str] | None:
    """One name, at one place, replaced by another one of the scene."""
    names = [*fields.get("objects", ())]
    said = mentioned(answer, names)
    others = [n for n in names if n not in said] or names
    if not said or len(names) < 2:
        return None
    old = said[int(rng.integers(len(said)))]
    new = [n for n in others if n != old]
    if not new:
        return None
    put = new[int(rng.integers(len(new)))]
    spelled = r"(?<![A-Za-z0-9_])" + r"[ _]".join(map(re.escape, old.split("_"))) + r"(?![A-Za-z0-9_])"
    places = list(re.finditer(spelled, answer, re.IGNORECASE))
    place = places[int(rng.integers(len(places)))]
    return answer[: place.start()] + put + answer[place.end() :], f"{old} replaced by {put}"


def _step_dropped(answer: str, fields: Mapping[str, Any], rng: np.random.Generator) -> tuple[str, str] | None:
    lines, steps = _plan_lines(answer)
    if len(steps) < 2:
        return None
    gone = steps[int(rng.integers(len(steps)))]
    return "\n".join(line for k, line in enumerate(lines) if k != gone), f"step '{lines[gone]}' left out"


def _steps_swapped(answer: str, fields: Mapping[str, Any], rng: np.random.Generator) -> tuple[str, str] | None:
    lines, steps = _plan_lines(answer)
    if len(steps) < 2:
        return None
    k = int(rng.integers(len(steps) - 1))
    a, b = steps[k], steps[k + 1]
    lines[a], lines[b] = lines[b], lines[a]
    return "\n".join(lines), f"steps {k + 1} and {k + 2} swapped"


def _plan_lines(answer: str) -> tuple[list[str], list[int]]:
    """The lines of an answer, and which of them are steps of its plan."""
    lines = answer.splitlines()
    begin = next((k for k, line in enumerate(lines) if "[start plan]" in line), len(lines))
    return lines, [k for k, line in enumerate(lines) if k > begin and line.lstrip().startswith(">")]


def _line_dropped(answer: str, fields: Mapping[str, Any], rng: np.random.Generator) -> tuple[str, str] | None:
    """A line of a description, or a reward call of a program, left out."""
    lines = answer.splitlines()
    able = [k for k, line in enumerate(lines) if re.search(r" is |_reward\(\w", line)]
    if len(able) < 2:
        return None
    gone = able[int(rng.integers(len(able)))]
    return "\n".join(line for k, line in enumerate(lines) if k != gone), f"line '{lines[gone]}' left out"


def _yes_no_flipped(answer: str, fields: Mapping[str, Any], rng: np.random.Generator) -> tuple[str, str] | None:
    match = re.search(r"\b(yes|no)\b", answer, re.IGNORECASE)
    if not match:
        return None
    other = "no" if match[1].lower() == "yes" else "yes"
    return other, f"{match[1].lower()} became {other}"


def _type_flipped(answer: str, fields: Mapping[str, Any], rng: np.random.Generator) -> tuple[str, str]:
    others = [w for w in ("OBJECT_PRESENCE", "OBJECT_ATTRIBUTE", "NEITHER") if w not in answer]
    put = others[int(rng.integers(len(others)))]
    return put, f"became {put}"


def _wrong_number(answer: str, fields: Mapping[str, Any], rng: np.random.Generator) -> tuple[str, str] | None:
    """Another line's number, or none (-1) where a call may serve none."""
    match = re.search(r"<step>\s*(-?\d+)\s*</step>", answer)
    if not match:
        return None
    numbers = [*range(1, len(fields["description"]) + 1), *([-1] if "call" in fields else [])]
    others = [n for n in numbers if n != int(match[1])]
    if not others:
        return None
    put = others[int(rng.integers(len(others)))]
    return answer[: match.start(1)] + str(put) + answer[match.end(1) :], f"line {match[1]} became {put}"


def _moved_primary(answer: str, fields: Mapping[str, Any], rng: np.random.Generator) -> tuple[str, str] | None:
    lines = answer.splitlines()
    mark = ", primary_reward=True"
    calls = [k for k, line in enumerate(lines) if re.match(r"\s*\w+_reward\(\w", line)]
    marked = [k for k in calls if mark in lines[k]]
    others = [k for k in calls if k not in marked]
    if not marked or not others:
        return None
    to = others[int(rng.integers(len(others)))]
    lines[marked[0]] = lines[marked[0]].replace(mark, "")
    lines[to] = lines[to].rstrip().removesuffix(")") + mark + ")"
    return "\n".join(lines), f"the primary mark moved to '{lines[to].strip()}'"


def _extra_call(answer: str, fields: Mapping[str, Any], rng: np.random.Generator) -> tuple[str, str] | None:
    """A reward about two things of the scene that has nothing to do with the description."""
    names = [*fields.get("objects", ())]
    if len(names) < 2 or "execute_plan" not in answer:
        return None
    a, b = (names[k] for k in rng.permutation(len(names))[:2])
    call = f"minimize_l2_distance_reward({a}, {b})"
    return re.sub(r"(?m)^(\s*)(execute_plan)", rf"\g<1>{call}\n\g<1>\g<2>", answer, count=1), f"added {call}"


def _changed_number(answer: str, fields: Mapping[str, Any], rng: np.random.Generator) -> tuple[str, str] | None:
    """A distance, fraction or height three times as large or a third; a fraction of a joint turned round."""
    able = [m for m in re.finditer(r"(?<![\w.])(\d+(?:\.\d+)?)(?![\w.])", answer) if not _of_duration(answer, m)]
    if not able:
        return None
    match = able[int(rng.integers(len(able)))]
    value = float(match[1])
    line = answer[answer.rfind("\n", 0, match.start()) + 1 : match.end()]
    factor = 3.0 if rng.random() < 0.5 else 1.0 / 3.0
    put = f"{1.0 - value if 'joint_fraction' in line else value * factor:.3g}"
    return answer[: match.start()] + put + answer[match.end() :], f"{match[1]} became {put}"


def _of_duration(answer: str, match: re.Match[str]) -> bool:
    line = answer[answer.rfind("\n", 0, match.start()) + 1 : match.start()]
    return "execute_plan" in line or not line.strip()


_ABOUT_NAMES: dict[str, _Maker] = {"dropped": _dropped, "other_name": _other_name}
MAKERS: dict[AnswerForm, dict[str, _Maker]] = {
    "yes_no": {"dropped": _dropped, "flipped": _yes_no_flipped},
    "plan": {**_ABOUT_NAMES, "line_dropped": _step_dropped, "steps_swapped": _steps_swapped},
    "description": {**_ABOUT_NAMES, "line_dropped": _line_dropped, "changed_number": _changed_number},
    "reward_code": {
        **_ABOUT_NAMES,
        "line_dropped": _line_dropped,
        "moved_primary": _moved_primary,
        "extra_call": _extra_call,
        "changed_number": _changed_number,
    },
    "step": {"dropped": _dropped, "wrong_number": _wrong_number},
    "reasons": _ABOUT_NAMES,
    "questions": _ABOUT_NAMES,
    "question_type": {"dropped": _dropped, "flipped": _type_flipped},
    "completion": {"dropped": _dropped, "flipped": _yes_no_flipped},
    "sentence": _ABOUT_NAMES,
}
