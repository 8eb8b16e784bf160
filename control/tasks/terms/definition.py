"""What every reward term says of itself: signature, predicate, cost, conflicts, what it asks of the hand, and texts."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np

from control.errors import RewardSpecError
from control.tasks.terms.lines import LineForm
from control.tasks.terms.views import Layout, SampledMotions, SceneState, TermJudgement

if TYPE_CHECKING:
    from control.tasks.reward_spec import RewardTerm

PALM = "palm"  # the tool centre point
REST_POSITION = "rest_position"  # where the palm is in the robot's rest configuration
PLACES = (PALM, REST_POSITION)  # names that are no objects

Manipulation = Literal["reach", "rest", "retreat", "place", "away", "lift", "bring", "drive", "turn"]
ArgumentKind = Literal["object", "joint", "place"]


@dataclass(frozen=True)
class NameArgument:
    """A name that a term is given.

    Attributes:
        name: Of the argument in a reward call.
        kind: `object` an object of the scene; `joint` a joint of furniture; `place` an object, "palm" or
            "rest_position".
    """

    name: str
    kind: ArgumentKind

    @property
    def what(self) -> Literal["joint", "object"]:
        """What a name that the scene does not have would have been."""
        return "joint" if self.kind == "joint" else "object"


@dataclass(frozen=True)
class NumberArgument:
    """A number that a term is given.

    Attributes:
        name: Of the argument in a reward call.
        quantity: What it is, for messages.
        unit: Its unit; "" for a share.
        low, high: What a reward program may ask for.
        least, most: What any spec may hold. These bounds catch nonsense (a negative distance, millimetres for metres);
            what is out of an arm's reach is a matter of the search.
        default: In a reward call that leaves it out; None where it has to be said.
    """

    name: str
    quantity: str
    unit: str
    low: float
    high: float
    least: float
    most: float
    default: float | None = None

    @property
    def spelled_unit(self) -> str:
        """The unit as it follows a number in a sentence."""
        return f" {self.unit}" if self.unit else ""


@dataclass(frozen=True)
class HandTask:
    """One manipulation.

    Attributes:
        manipulation: `reach` the palm near an object; `rest` the palm at its rest position; `retreat` the palm away
            from something; `place` an object on or in another; `away` an object put down far from something; `lift` an
            object held up; `bring` an object held at the rest position; `drive` a joint to a fraction by its handle;
            `turn` an object over and put it down near where it stood.
        subject: The object or joint that is handled, or None when only the palm moves.
        target: The other object, "palm" or "rest_position", or None.
        amount: Height in [m] for `lift`, distance in [m] for `away`, fraction of the range for `drive`; else unused.
    """

    manipulation: Manipulation
    subject: str | None
    target: str | None
    amount: float

    @property
    def releases(self) -> bool:
        """Whether the object has to be let go at the end."""
        return self.manipulation in ("place", "away", "drive", "turn")

    @property
    def holds(self) -> bool:
        """Whether the object has to be in the hand at the end."""
        return self.manipulation in ("lift", "bring")


class TermDefinition(ABC):
    """One kind of reward term, all of it in one place.

    A subclass has no state: its class attributes and methods are the term. Methods get the term as it stands in a spec
    (`control.tasks.reward_spec.RewardTerm`: subject, target, value), whose names were checked before.

    Attributes:
        name: As specs name it; the call of a reward program is `name_reward`.
        names: One or two names that it is given: the spec's subject and target.
        number: The number that it is given, or None: the spec's value.
        prompt: What the call does, for the prompt that lists the calls.
        lines: Lines of a motion description that it serves; none where descriptions do not speak of it.
        hand: What the hand does for it, for the documentation.
        met: When it is met, for the documentation.
        cost: Its residual along a motion, symbol by symbol with units, for the documentation.
        conflicts: With which terms it cannot be met, for the documentation.
    """

    name: ClassVar[str]
    names: ClassVar[tuple[NameArgument, ...]]
    number: ClassVar[NumberArgument | None] = None
    prompt: ClassVar[str]
    lines: ClassVar[tuple[LineForm, ...]] = ()
    hand: ClassVar[str]
    met: ClassVar[str]
    cost: ClassVar[str]
    conflicts: ClassVar[str] = "none"

    @property
    def call(self) -> str:
        """Name of its call in reward programs."""
        return f"{self.name}_reward"

    @property
    def signature(self) -> str:
        """Its call with the names of the arguments."""
        words = [a.name for a in self.names]
        if self.number is not None:
            default = "" if self.number.default is None else f"={self.number.default:g}"
            words.append(f"{self.number.name}{default}")
        return f"{self.call}({', '.join(words)})"

    def check(self, term: RewardTerm) -> None:
        """Raise RewardSpecError where a term's names or number are not of this signature."""
        self._check_names(term)
        self._check_number(term)

    def _check_names(self, term: RewardTerm) -> None:
        if len(self.names) == 2:
            if term.target is None:
                raise RewardSpecError(f"{self.name} needs two names; it was given '{term.subject}' alone")
            if term.target == term.subject:
                raise RewardSpecError(f"{self.name} was given '{term.subject}' twice; name two different things")
        elif term.target is not None:
            raise RewardSpecError(f"{self.name} takes one name; it was given '{term.subject}' and '{term.target}'")
        for argument, name in zip(self.names, (term.subject, term.target), strict=False):
            if argument.kind != "place" and name in PLACES:
                what = "a joint" if argument.kind == "joint" else "an object"
                raise RewardSpecError(f"{self.name} needs the name of {what}; '{name}' is none")

    def _check_number(self, term: RewardTerm) -> None:
        wanted, value = self.number, term.value
        if wanted is None:
            if value is not None:
                raise RewardSpecError(f"{self.name} takes no number; it was given {value}")
            return
        if value is None:
            raise RewardSpecError(f"{self.name} of '{term.subject}' needs a number")
        number = not isinstance(value, bool) and isinstance(value, (int, float))
        if not number or not math.isfinite(value) or not wanted.least <= value <= wanted.most:
            raise RewardSpecError(
                f"the {wanted.quantity} of {self.name} of '{term.subject}' must be a number from {wanted.least:g} to "
                f"{wanted.most:g}{wanted.spelled_unit}, not {value}"
            )

    @abstractmethod
    def judge(self, term: RewardTerm, scene: SceneState) -> TermJudgement:
        """Whether the term is met in a scene, of the twin or perceived; the residual is 0 exactly when it is.

        The scene has every object and joint that the term names.
        """

    @abstractmethod
    def residual_along(self, term: RewardTerm, motions: SampledMotions) -> np.ndarray:
        """The residual r of simulated motions, shape (n, t, k), in [m]: never flat before the term is met."""

    @abstractmethod
    def asks_of_hand(self, term: RewardTerm) -> HandTask:
        """The manipulation that meets it as a primary term."""

    def excludes(self, term: RewardTerm, other: RewardTerm, layout: Layout) -> str:
        """Why another term cannot be met beside it, in words; "" where it can, or where the other one says so."""
        return ""

    def carries(self, term: RewardTerm) -> str | None:
        """The object that has to be brought to a place that the term names, or None."""
        return None

    def handles(self, term: RewardTerm) -> str | None:
        """The object or joint that would have to be handled to meet it."""
        return term.subject

    def approaches(self, term: RewardTerm) -> str | None:
        """What the palm itself is brought to, or None where the term is not about that."""
        return None

    def turns_by(self, term: RewardTerm) -> float | None:
        """By how much in [rad] its subject has to be turned about its own x axis, or None where it says nothing."""
        return None


def brought(term: RewardTerm) -> str | None:
    """Of a term about two places the object that is brought to the other: the first one; None beside the palm."""
    if PALM in (term.subject, term.target):
        return None
    return term.target if term.subject == REST_POSITION else term.subject
