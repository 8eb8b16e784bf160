"""Motion descriptions: what a subtask brings about, in lines of the forms that the reward terms serve.

palm is close to A
A is close to B        A is far from B
A is at height Z       J is open        J is N % open        J is closed
"""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from control.tasks.reward_spec import PALM, REST_POSITION
from control.tasks.terms.definition import TermDefinition
from control.tasks.terms.lines import LineForm
from control.tasks.terms.registry import TERMS
from control.tasks.terms.vocabulary import Vocabulary

NOTES_AT = 26  # column of the notes beside the forms


@dataclass(frozen=True)
class DescriptionLine:
    """One line.

    Attributes:
        definition: The term that serves it.
        form: Its form, one of the term's.
        a: Object, joint or "palm".
        b: The other object, for forms of two names; else None.
        value: Height of the object's centre in [m], for height; how far a joint is open, 0..1, where it is not open all
            the way; else None.
    """

    definition: TermDefinition
    form: LineForm
    a: str
    b: str | None = None
    value: float | None = None

    @property
    def kind(self) -> str:
        """Short name of its form."""
        return self.form.kind

    def __str__(self) -> str:
        return self.form.fill(self.a, self.b, self.value)


def line_of(
    kind: str, a: str, b: str | None = None, value: float | None = None, vocabulary: Vocabulary = TERMS
) -> DescriptionLine:
    """The line of this kind that says these names, and the number where there is one.

    Raises:
        ValueError: No term serves such a line.
    """
    for definition, form in _forms(vocabulary):
        if form.kind == kind and form.numbered == (value is not None):
            return DescriptionLine(definition, form, a, b, value)
    known = sorted({form.kind for _, form in _forms(vocabulary)})
    raise ValueError(f"no reward term serves a line '{kind}' with {value}; lines are {known}")


def parse_line(text: str, vocabulary: Vocabulary = TERMS) -> DescriptionLine | None:
    """One line, or None when it has none of the forms."""
    plain = re.sub(r"^\s*(?:\d+[.)]|[-*>])\s*", "", text).strip().rstrip(".")
    for definition, form in _forms(vocabulary):
        read = form.read(plain)
        if read is not None:
            return DescriptionLine(definition, form, *read)
    return None


def offered_lines(relocates: bool, joints: bool, vocabulary: Vocabulary = TERMS) -> tuple[str, ...]:
    """The forms that a prompt shows, each with its note: those about objects first.

    Args:
        relocates: Whether the step moves an object; else lines about objects are said to be rarely needed.
        joints: Whether the scene has joints.
        vocabulary: The terms whose lines may be written.
    """
    out = []
    for _, form in sorted(_forms(vocabulary), key=lambda f: f[1].about_joint):
        if (form.about_joint and not joints) or (form.relocates and not relocates):
            continue
        note = form.note if form.about_joint or relocates else "only if needed"
        out.append(f"{form.text:<{NOTES_AT}}({note})" if note else form.text)
    return tuple(out)


def _forms(vocabulary: Vocabulary) -> list[tuple[TermDefinition, LineForm]]:
    return [(definition, form) for definition in vocabulary.definitions for form in definition.lines]


def find_fault(
    lines: Sequence[DescriptionLine], objects: Collection[str], joints: Collection[str], relocates: bool
) -> str | None:
    """What breaks the template's rules, as a reason to ask again; None if nothing does.

    Args:
        lines: The description.
        objects, joints: Names of the scene.
        relocates: Whether the subtask moves an object, so that a line must say where to.
    """
    if not lines:
        return "the description is empty"
    first = lines[0]
    if first.kind != "close" or first.a != PALM:
        return "the first line must be 'palm is close to A' with one of the objects"
    seen: set[tuple[str, str]] = set()
    for line in lines:
        is_joint = line.form.about_joint
        valid = set(joints) if is_joint else {*objects, PALM, REST_POSITION}
        for name in (line.a, line.b):
            if name is not None and name not in valid:
                what = "joint" if is_joint else "object"
                return f"there is no {what} '{name}'; there are {sorted(valid) or 'none'}"
        if line.a == line.b:
            return f"'{line}' names '{line.a}' twice"
        if (line.kind, line.a) in seen or (line.b is not None and _partners(line.a, lines) > 1):
            return f"'{line.a}' is described more than once; each object is close to or far from one thing only"
        seen.add((line.kind, line.a))
    if relocates and not any(line.a != PALM and not line.form.about_joint for line in lines):
        return "the step moves an object, but no line says where the object ends up"
    return None


def _partners(name: str, lines: Sequence[DescriptionLine]) -> int:
    return len({(line.kind, line.b) for line in lines if line.a == name and line.b is not None})
