"""Motion descriptions: what a subtask brings about, in lines of a fixed form. Needs the standard library only.

palm is close to A
A is close to B        A is far from B
A is at height Z       J is open        J is N % open        J is closed
"""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal

from control.tasks.reward_spec import PALM, REST_POSITION

LineKind = Literal["close", "far", "height", "open", "closed"]

_LINE = re.compile(
    r"(?P<a>\w+) is (?:(?P<how>close to|far from) (?P<b>\w+)|at height (?P<z>\d+(?:\.\d+)?)(?: ?m)?"
    r"|(?:(?P<share>\d+) ?% )?(?P<j>open)|(?P<shut>closed))"
)


@dataclass(frozen=True)
class DescriptionLine:
    """One line.

    Attributes:
        kind: Its form.
        a: Object, joint or "palm".
        b: The other object, for close and far; else None.
        value: Height of the object's centre in [m], for height; how far a joint is open, 0..1, where it is not open all
            the way; else None.
    """

    kind: LineKind
    a: str
    b: str | None = None
    value: float | None = None

    def __str__(self) -> str:
        if self.kind in ("close", "far"):
            return f"{self.a} is {'close to' if self.kind == 'close' else 'far from'} {self.b}"
        if self.kind == "height":
            return f"{self.a} is at height {self.value:g}"
        share = "" if self.value is None else f"{self.value * 100:.0f} % "
        return f"{self.a} is {share}{self.kind}"


def parse_line(text: str) -> DescriptionLine | None:
    """One line, or None when it has none of the forms."""
    match = _LINE.fullmatch(re.sub(r"^\s*(?:\d+[.)]|[-*>])\s*", "", text).strip().rstrip("."))
    if not match:
        return None
    if match["how"]:
        return DescriptionLine("close" if match["how"] == "close to" else "far", match["a"], match["b"])
    if match["z"]:
        return DescriptionLine("height", match["a"], value=float(match["z"]))
    if match["shut"]:
        return DescriptionLine("closed", match["a"])
    return DescriptionLine("open", match["a"], value=None if match["share"] is None else int(match["share"]) / 100)


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
        is_joint = line.kind in ("open", "closed")
        valid = set(joints) if is_joint else {*objects, PALM, REST_POSITION}
        for name in (line.a, line.b):
            if name is not None and name not in valid:
                what = "joint" if is_joint else "object"
                return f"there is no {what} '{name}'; there are {sorted(valid) or 'none'}"
        if line.a == line.b:
            return f"'{line}' names '{line.a}' twice"
        if (line.kind, line.a) in seen or (line.kind in ("close", "far") and _partners(line.a, lines) > 1):
            return f"'{line.a}' is described more than once; each object is close to or far from one thing only"
        seen.add((line.kind, line.a))
    if relocates and not any(line.a != PALM and line.kind in ("close", "far", "height") for line in lines):
        return "the step moves an object, but no line says where the object ends up"
    return None


def _partners(name: str, lines: Sequence[DescriptionLine]) -> int:
    return len({(line.kind, line.b) for line in lines if line.a == name and line.kind in ("close", "far")})
