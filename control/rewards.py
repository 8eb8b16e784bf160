"""Reward specs: plans for one subtask as data, in a closed vocabulary. Needs the standard library only."""

from dataclasses import dataclass
from typing import Literal, get_args

from control.errors import RewardSpecError, UnknownObjectError

TermKind = Literal[
    "minimize_l2_distance", "maximize_l2_distance", "set_joint_fraction", "set_obj_z_position", "set_obj_orientation"
]
PALM = "palm"  # the tool centre point
REST_POSITION = "rest_position"  # where the palm is in the robot's rest configuration


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
        if self.kind.endswith("l2_distance"):
            if self.target is None:
                raise RewardSpecError(f"{self.kind} needs two names; it was given '{self.subject}' alone")
            if self.target == self.subject:
                raise RewardSpecError(f"{self.kind} was given '{self.subject}' twice; name two different things")
        needs_value = self.kind != "minimize_l2_distance"
        if needs_value and self.value is None:
            raise RewardSpecError(f"{self.kind} of '{self.subject}' needs a number")

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
