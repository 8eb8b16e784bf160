"""Reward specs: plans for one subtask as data, in a closed vocabulary of terms. Needs numpy only."""

from dataclasses import InitVar, dataclass

from control.errors import RewardSpecError, UnknownObjectError
from control.tasks.terms.definition import PALM, PLACES, REST_POSITION, TermDefinition
from control.tasks.terms.registry import TERMS
from control.tasks.terms.vocabulary import Vocabulary

__all__ = ["PALM", "REST_POSITION", "RewardSpec", "RewardTerm"]


@dataclass(frozen=True)
class RewardTerm:
    """One term, as data; what it means is its definition's.

    Attributes:
        kind: Name of its definition; docs/reward-terms.md lists them.
        subject: Object, joint or "palm" that the term is about.
        target: The other object, "palm" or "rest_position", for terms of two names; else None.
        value: Its number, in the unit of its definition, or None.
        primary: Whether the subtask is finished when this term is met; exactly one term of a spec is primary.
        vocabulary: Where its kind is looked up; no part of the data.

    Raises:
        RewardSpecError: No such term, or names or number that are not of its signature.
    """

    kind: str
    subject: str
    target: str | None = None
    value: float | None = None
    primary: bool = False
    vocabulary: InitVar[Vocabulary] = TERMS

    def __post_init__(self, vocabulary: Vocabulary) -> None:
        # Kept beside the fields: `dataclasses.replace` hands it on, while comparisons and records see the data alone.
        object.__setattr__(self, "vocabulary", vocabulary)
        object.__setattr__(self, "_definition", vocabulary.find(self.kind))
        self.definition.check(self)

    @property
    def definition(self) -> TermDefinition:
        """What the term means."""
        return vars(self)["_definition"]

    @property
    def number(self) -> float:
        """Its number; 0 for a term that has none."""
        return float(self.value or 0.0)

    @property
    def text(self) -> str:
        """As a call, for messages."""
        parts = [self.subject, *([self.target] if self.target else [])]
        return f"{self.kind}({', '.join([*parts, *([] if self.value is None else [f'{self.value:g}'])])})"

    @property
    def carries(self) -> str | None:
        """The object that has to be brought somewhere, or None: of two objects the first, beside a place the object."""
        return self.definition.carries(self)

    @property
    def destination(self) -> str | None:
        """Where it has to be brought; None where nothing is carried."""
        if self.carries is None:
            return None
        return self.target if self.carries == self.subject else self.subject

    @property
    def names(self) -> tuple[str, ...]:
        """Names of objects and joints in the term; the palm and its rest position are not objects."""
        return tuple(n for n in (self.subject, self.target) if n is not None and n not in PLACES)

    @property
    def joints(self) -> frozenset[str]:
        """Those of its names that are joints."""
        given = zip(self.definition.names, (self.subject, self.target), strict=False)
        return frozenset(str(name) for argument, name in given if argument.kind == "joint")

    def check_names(self, objects: frozenset[str], joints: frozenset[str] = frozenset()) -> None:
        """Raise UnknownObjectError when the term names something that the scene does not have."""
        for name in self.names:
            what, valid = ("joint", joints) if name in self.joints else ("object", objects)
            if name not in valid:
                raise UnknownObjectError(f"no {what} named '{name}' in this scene; it has {sorted(valid)}")


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
            term.check_names(objects, joints)
