"""Facts read back from their sentences (`planning.loop.perceiver.describe`), for reasoners that work by rules.

A rule-based reasoner gets what a language model gets: sentences. Those of a fixed form are taken apart here; all others
are none of its business. Needs the standard library only.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field

_OBJECT = re.compile(r"(?P<name>\w+): (?P<what>.+)")
_CENTRE = re.compile(r".*centre at x (?P<x>-?[\d.]+), y (?P<y>-?[\d.]+), z (?P<z>-?[\d.]+) m")
_COLOUR = re.compile(r"(?P<colour>[a-z]+) (?:box|cylinder|sphere) of ")
_RELATION = re.compile(r"(?P<a>\w+) is (?P<how>on|in front of|in|next to) (?P<b>\w+)")
_JOINT = re.compile(r"(?P<name>\w+) is a (?P<role>door|lever|plate) of (?P<owner>\w+) and is (?P<state>[\w% ]+)")
_HIDDEN = re.compile(r"the inside of (?P<name>\w+) is hidden")
_UNSEEN = re.compile(r"(?P<name>\w+) is not in view: .+")
_NOBODY = "; nobody named it"
AT_ENDS = {"open", "pulled"}
WIDE = 0.6  # share of a door's way; of the 1.9 rad of a cabinet's door, square to its front


@dataclass(frozen=True)
class JointFact:
    """A joint of furniture as it is seen.

    Attributes:
        name, owner: Of the joint and of the furniture.
        role: door, lever or plate.
        state: closed or up; open or pulled; or in between ("40 % open").
    """

    name: str
    owner: str
    role: str
    state: str

    @property
    def at_end(self) -> bool:
        """Whether it is all the way open or pulled."""
        return self.state in AT_ENDS

    @property
    def share(self) -> float:
        """About how far it is open, 0..1."""
        percent = re.match(r"(\d+) %", self.state)
        return float(percent[1]) / 100 if percent else float(self.at_end)

    @property
    def wide(self) -> bool:
        """Whether a hand gets through where it was shut, and cameras see in."""
        return self.share >= WIDE

    @property
    def at_start(self) -> bool:
        """Whether it is closed, or not pulled."""
        return self.state in ("closed", "up")


@dataclass(frozen=True)
class SceneFacts:
    """What the sentences say.

    Attributes:
        seen: Name -> what it is, in the words of the fact.
        centres: Name -> (x, y, z) in the world in [m].
        colours: Name -> colour word, where one was seen.
        relations: (a, how, b).
        joints: By name.
        hidden: Furniture whose inside is hidden.
        unnamed: Names of what nobody named.
        unseen: Names that were looked for in vain.
    """

    seen: dict[str, str] = field(default_factory=dict)
    centres: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    colours: dict[str, str] = field(default_factory=dict)
    relations: tuple[tuple[str, str, str], ...] = ()
    joints: dict[str, JointFact] = field(default_factory=dict)
    hidden: frozenset[str] = frozenset()
    unseen: tuple[str, ...] = ()
    unnamed: frozenset[str] = frozenset()

    @property
    def furniture(self) -> frozenset[str]:
        """Names of what has joints."""
        return frozenset(j.owner for j in self.joints.values())

    def joints_of(self, owner: str) -> list[JointFact]:
        """Joints of a piece of furniture."""
        return [j for j in self.joints.values() if j.owner == owner]

    def doors_of(self, owner: str) -> list[JointFact]:
        """Its doors."""
        return [j for j in self.joints_of(owner) if j.role == "door"]

    def distance(self, a: str, b: str | None = None) -> float:
        """Horizontal distance in [m] of a from b, or from the world's origin; infinite where one is not seen."""
        at = self.centres.get(a)
        other = (0.0, 0.0, 0.0) if b is None else self.centres.get(b)
        return math.inf if at is None or other is None else math.dist(at[:2], other[:2])

    def on_or_in(self, place: str) -> list[str]:
        """What is seen on or in a thing."""
        return [a for a, how, b in self.relations if b == place and how in ("on", "in")]


def read_facts(facts: Sequence[str]) -> SceneFacts:
    """Take sentences apart; those of another form are left out."""
    seen = {m["name"]: m["what"] for m in map(_OBJECT.fullmatch, facts) if m}
    centres = {}
    colours = {}
    for name, what in seen.items():
        at, colour = _CENTRE.match(what), _COLOUR.match(what)
        if at:
            centres[name] = (float(at["x"]), float(at["y"]), float(at["z"]))
        if colour:
            colours[name] = colour["colour"]
    joints = {
        m["name"]: JointFact(m["name"], m["owner"], m["role"], m["state"]) for m in map(_JOINT.fullmatch, facts) if m
    }
    return SceneFacts(
        seen,
        centres,
        colours,
        tuple((m["a"], m["how"], m["b"]) for m in map(_RELATION.fullmatch, facts) if m),
        joints,
        frozenset(m["name"] for m in map(_HIDDEN.fullmatch, facts) if m),
        tuple(m["name"] for m in map(_UNSEEN.fullmatch, facts) if m),
        frozenset(name for name, what in seen.items() if what.endswith(_NOBODY)),
    )
