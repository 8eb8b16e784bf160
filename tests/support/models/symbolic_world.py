"""A little symbolic world behind the loop's interfaces: boxes that stand on each other, executor that may be blocked.

It knows where everything is; the loop sees only what `look` returns. Shared by the tests of planning.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from control.errors import UnknownObjectError
from control.tasks.failure import FailureCause
from control.tasks.reward_spec import PALM, REST_POSITION, RewardSpec, RewardTerm
from control.tasks.terms.views import TermJudgement
from perception.errors import UnknownPhraseError
from perception.estimates import ObjectEstimate, SceneEstimate, Unseen
from planning.loop.interfaces import AttemptResult

SIZE = 0.05  # [m]; every object is a cube of this size, the carriers below are wider
CARRIER = 0.12


def estimate(name: str, position: Sequence[float], extents: Sequence[float]) -> ObjectEstimate:
    """An axis-parallel box as perception would report it; position of its centre and sizes in [m]."""
    pose = np.eye(4)
    pose[:3, 3] = position
    return ObjectEstimate(
        name=name,
        phrase=name.replace("_", " "),
        world_T_object=pose,
        extents=np.asarray(extents, float),
        shape="box",
        position_std=np.full(3, 0.003),
        yaw_std=0.02,
        score=0.9,
        stamp=0.0,
    )


@dataclass
class World:
    """Scene observer, motion executor and term evaluator at once.

    Attributes:
        places: Each object's place: "table" or the carrier that it is on.
        carriers: Wide objects, each with room for one thing.
        beside: Things that stand close beside another one.
        deaf_to: Names that the detector cannot look for.
        failures: Causes that the next attempts end with, first one first, whatever is asked.
        undo: How many of the next motions are played without effect.
        looks, specs: What was asked so far.
        explanation: What the executor say of motions that were played without effect.
    """

    places: dict[str, str]
    carriers: frozenset[str]
    deaf_to: frozenset[str] = frozenset()
    beside: dict[str, str] = field(default_factory=dict)
    failures: list[FailureCause | BaseException] = field(default_factory=list)
    undo: int = 0
    looks: int = 0
    specs: list[RewardSpec] = field(default_factory=list)
    explanation: FailureCause | None = None

    # observer

    def look(self, names: Sequence[str]) -> SceneEstimate:
        self.looks += 1
        for name in names:
            if name in self.deaf_to:
                raise UnknownPhraseError(f"cannot look for '{name}'")
        seen, unseen = [], []
        for name in names:
            if name in self.places:
                seen.append(self._estimate(name))
            else:
                unseen.append(Unseen(name, "no box above the threshold"))
        return SceneEstimate(tuple(seen), tuple(unseen), 0.0, float(self.looks), "symbolic world")

    def _estimate(self, name: str) -> ObjectEstimate:
        width = CARRIER if name in self.carriers else SIZE
        x = 0.4
        y = -0.6 + 0.3 * sorted(self.places).index(name)
        z = SIZE / 2
        under = self.places[name]
        if name in self.beside:
            x, y = self._estimate(self.beside[name]).position[:2] + np.array([0.08, 0.0])
        if under in self.places:
            base = self._estimate(under)
            x, y, z = base.position[0], base.position[1], base.top + SIZE / 2
        return estimate(name, (x, y, z), (width, width, SIZE))

    # executor

    def attempt(self, spec: RewardSpec, scene: SceneEstimate) -> AttemptResult:
        self.specs.append(spec)
        if self.failures:
            failure = self.failures.pop(0)
            if isinstance(failure, FailureCause):
                return AttemptResult(False, failure)
            raise failure
        term = spec.primary
        subject, target = term.subject, str(term.target)
        loads = tuple(n for n, place in self.places.items() if place == subject)
        occupants = tuple(n for n, place in self.places.items() if place == target and n != subject)
        relocates = subject != PALM
        if relocates and loads:
            return AttemptResult(False, FailureCause("blocked_by", subject, f"{loads[0]} lies on it", bodies=loads))
        if term.kind == "minimize_l2_distance" and relocates and occupants:
            message = f"{subject} finds no room"
            return AttemptResult(False, FailureCause("blocked_by", subject, message, bodies=occupants))
        if self.undo:
            self.undo -= 1
        elif relocates:
            self.beside.pop(subject, None)
            self.places[subject] = target if term.kind == "minimize_l2_distance" else "table"
        return AttemptResult(True, stats={"steps": 1})

    def explain(self, spec: RewardSpec, scene: SceneEstimate) -> FailureCause | None:
        return self.explanation

    # evaluator

    def evaluate(self, term: RewardTerm, scene: SceneEstimate, before: SceneEstimate, /) -> TermJudgement:
        """On what was seen, not on `places`."""
        for name in term.names:
            if scene.get(name) is None:
                raise UnknownObjectError(f"no object named '{name}' in this scene; it has {sorted(scene.names)}")
        if {PALM, REST_POSITION} & {term.subject, term.target}:
            met = self.specs[-1].primary == term  # the next motion takes the palm elsewhere
            return TermJudgement(met, 0.0 if met else 0.3, f"{term.subject} is {'' if met else 'not '}at {term.target}")
        a, b = scene.get(term.subject), scene.get(str(term.target))
        assert a is not None
        if term.kind in ("set_obj_z_position", "set_obj_orientation"):
            return TermJudgement(True, 0.0, f"{a.name} is {'up' if term.kind == 'set_obj_z_position' else 'turned'}")
        assert b is not None
        distance = float(np.linalg.norm(a.position - b.position))
        if term.kind == "maximize_l2_distance":
            met = distance >= float(term.value or 0.0)
            return TermJudgement(met, 0.0 if met else distance, f"{a.name} is {distance:.2f} m from {b.name}")
        met = distance < 0.08
        return TermJudgement(met, 0.0 if met else distance, f"{a.name} is{'' if met else ' not'} on {b.name}")


@dataclass
class Journal:
    """Collects what the loop logs."""

    events: list[tuple[str, dict]] = field(default_factory=list)

    def __call__(self, event: str, /, **data) -> None:
        self.events.append((event, data))

    def of(self, event: str) -> list[dict]:
        """Data of all events of this name."""
        return [data for name, data in self.events if name == event]
