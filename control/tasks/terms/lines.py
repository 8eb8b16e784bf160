"""Lines of a motion description that reward terms serve: "A is close to B", "J is N % open"."""

import re
from dataclasses import dataclass

_PARTS = {
    "A": r"(?P<a>\w+)",
    "B": r"(?P<b>\w+)",
    "J": r"(?P<a>\w+)",
    "Z": r"(?P<z>\d+(?:\.\d+)?)(?: ?m)?",
    "N": r"(?P<n>\d+)",
}


@dataclass(frozen=True)
class LineForm:
    """One form.

    Attributes:
        kind: Short name; forms of one kind say the same with and without a number.
        text: As a prompt shows it. Capitals stand for what is filled in: A and B objects, "palm" or "rest_position", J
            a joint, Z a number, N a whole number of percent.
        note: What the prompt says beside it, or "".
        value: The term's number where the line says none; None where the term has none or its default.
        relocates: Whether it is offered only for steps that move an object.
    """

    kind: str
    text: str
    note: str = ""
    value: float | None = None
    relocates: bool = False

    @property
    def about_joint(self) -> bool:
        """Whether it is about a joint of furniture."""
        return "J" in self.text.split()

    @property
    def numbered(self) -> bool:
        """Whether it says a number."""
        return bool({"Z", "N"} & set(self.text.split()))

    def fill(self, a: str, b: str | None, value: float | None) -> str:
        """The line with names and number in place of the capitals; `value` is a share where the form says percent."""
        words = {"A": a, "J": a, "B": b, "Z": f"{value or 0.0:g}", "N": f"{(value or 0.0) * 100:.0f}"}
        return " ".join(str(words.get(word, word)) for word in self.text.split())

    def read(self, line: str) -> tuple[str, str | None, float | None] | None:
        """Names and number of a line of this form, or None where it has another."""
        pattern = " ".join(_PARTS.get(word, re.escape(word)) for word in self.text.split())
        match = re.fullmatch(pattern.replace(r" %", r" ?%"), line)
        if not match:
            return None
        found = match.groupdict()
        value = float(found["z"]) if "z" in found else int(found["n"]) / 100 if "n" in found else None
        return found["a"], found.get("b"), value
