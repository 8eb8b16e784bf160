"""Reward specs: plans for one subtask as data, in a closed vocabulary. Needs the standard library only."""

import math
from dataclasses import dataclass
from typing import Literal, get_args

from control.errors import RewardSpecError, UnknownObjectError

TermKind = Literal[
    "minimize_l2_distance", "maximize_l2_distance", "set_joint_fraction", "set_obj_z_position", "set_obj_orientation"
]
PALM = "palm"  # the tool centre point
REST_POSITION = "rest_position"  # where the palm is in the robot's rest configuration
# What the number of a term is, its least and largest value and its unit. These bounds catch nonsense (a negative
# distance, millimetres for metres); what is out of an arm's reach is a matter of the search.
VALUES: dict[str, tuple[str, float, float, str]] = {
    "maximize_l2_distance": ("distance", 0.0, 10.0, " m"),
    "set_joint_fraction": ("fraction", 0.0, 1.0, ""),
    "set_obj_z_position": ("height", -10.0, 10.0, " m"),
    "set_obj_orientation": ("rotation", -2 * math.pi, 2 * math.pi, " rad"),
}


@dataclass(frozen=True)
class RewardTerm:
    """One term.

    Attributes:
        kind: Which call of the vocabulary.
        subject: Object, joint or "palm" that the term is about.
        target: The other object, "palm" or "rest_position", for the two distance terms; else None.
        value: Distance to keep in [m] (maximize_l2_distance), fraction 0..1 (set_joint_fraction), height of the
            object's centre in [m] (set_obj_z_position) or rotation about x in [rad] (set_obj_orientation); else None.
        primary: Whether the subtask is finished when this term is met; exactly one term of a spec is primary.
    """

    kind: TermKind
    subject: str
    target: str | None = None
    value: float | None = None
    primary: bool = False

    def __post_init__(self) -> None:
        if self.kind not in get_args(TermKind):
            raise RewardSpecError(f"no reward term '{self.kind}'; there are {sorted(get_args(TermKind))}")
        self._check_names()
        self._check_value()

    def _check_names(self) -> None:
        if self.kind.endswith("l2_distance"):
            if self.target is None:
                raise RewardSpecError(f"{self.kind} needs two names; it was given '{self.subject}' alone")
            if self.target == self.subject:
                raise RewardSpecError(f"{self.kind} was given '{self.subject}' twice; name two different things")
            return
        if self.target is not None:
            raise RewardSpecError(f"{self.kind} takes one name; it was given '{self.subject}' and '{self.target}'")
        if self.subject in (PALM, REST_POSITION):
            what = "a joint" if self.kind == "set_joint_fraction" else "an object"
            raise RewardSpecError(f"{self.kind} needs the name of {what}; '{self.subject}' is none")

    def _check_value(self) -> None:
        if self.kind == "minimize_l2_distance":
            if self.value is not None:
                raise RewardSpecError(f"{self.kind} takes no number; it was given {self.value}")
            return
        if self.value is None:
            raise RewardSpecError(f"{self.kind} of '{self.subject}' needs a number")
        what, low, high, unit = VALUES[self.kind]
        number = not isinstance(self.value, bool) and isinstance(self.value, (int, float))
        if not number or not math.isfinite(self.value) or not low <= self.value <= high:
            raise RewardSpecError(
                f"the {what} of {self.kind} of '{self.subject}' must be a number from {low:g} to {high:g}{unit}, not "
                f"{self.value}"
            )

    @property
    def text(self) -> str:
        """As a call, for messages."""
        parts = [self.subject, *([self.target] if self.target else [])]
        return f"{self.kind}({', '.join([*parts, *([] if self.value is None else [f'{self.value:g}'])])})"

    @property
    def carries(self) -> str | None:
        """The object that has to be brought somewhere, or None: of two objects the first, beside a place the object."""
        if not self.kind.endswith("l2_distance") or PALM in (self.subject, self.target):
            return None
        return self.target if self.subject == REST_POSITION else self.subject

    @property
    def names(self) -> tuple[str, ...]:
        """Names of objects and joints in the term; the palm and its rest position are not objects."""
        return tuple(n for n in (self.subject, self.target) if n is not None and n not in (PALM, REST_POSITION))


@dataclass(frozen=True)
class RewardSpec:
    """What one subtask should achieve.

    Attributes:
        terms: At least one; exactly one is primary.

    Raises:
        RewardSpecError: No term, or not exactly one primary term.
    """

    terms: tuple[RewardTerm, ...]

    def __post_init__(self) -> None:
        primaries = sum(t.primary for t in self.terms)
        if primaries != 1:
            raise RewardSpecError(f"a reward spec has exactly one primary term; this one has {primaries}")

    @property
    def primary(self) -> RewardTerm:
        """The term that ends the subtask."""
        return next(t for t in self.terms if t.primary)

    @property
    def names(self) -> frozenset[str]:
        """All objects and joints that the subtask names; everything else must stay where it is."""
        return frozenset(n for t in self.terms for n in t.names)

    def check_names(self, objects: frozenset[str], joints: frozenset[str] = frozenset()) -> None:
        """Raise UnknownObjectError when a term names something that the scene does not have."""
        for term in self.terms:
            valid = joints if term.kind == "set_joint_fraction" else objects
            what = "joint" if term.kind == "set_joint_fraction" else "object"
            for name in term.names:
                if name not in valid:
                    raise UnknownObjectError(f"no {what} named '{name}' in this scene; it has {sorted(valid)}")
