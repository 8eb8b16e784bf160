"""The symbolic world with furniture in it: doors, levers, plates, bolts that nothing shows, things behind closed doors.

It can also say what an attempt would lead to without making it, as an executor with a twin can. Shared by tests of
baselines.
"""

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace

from control.errors import UnknownObjectError
from control.tasks.failure import FailureCause
from control.tasks.reward_spec import RewardSpec, RewardTerm
from control.tasks.terms.views import TermJudgement
from perception.estimates import ObjectEstimate, SceneEstimate, Unseen
from planning.baselines.rehearsal import Rehearsal
from planning.language.furnishings import Front, JointRole, KnownFurniture, KnownJoint
from planning.loop.interfaces import AttemptResult
from tests.support.models.symbolic_world import World, estimate

CUPBOARD_SIZE = (0.3, 0.4, 0.5)  # [m]


def piece(name: str, role: JointRole, *parts: str) -> KnownFurniture:
    """Furniture with joints named after it, for instance piece("cupboard", "door", "left_door", "right_door")."""
    joints = tuple(KnownJoint(f"{name}_{part}", name, role) for part in parts)
    kind = {"door": "cabinet", "lever": "lever", "plate": "weight_plate"}[role]
    return KnownFurniture(name, kind, joints, Front(0.1, 0.3) if role == "door" else None)


@dataclass
class FurnishedWorld(World):
    """Furniture stands along y = 0.9 m; what lies in it is seen only while all of its doors are wide open.

    Attributes:
        furniture: By name; each piece is in view.
        fractions: How far joints are open; those left out are closed.
        bolts: Door -> joint that must be open for it to move. Nothing shows them.
        most: Joint -> how far it can be driven, where not all the way.
        bars: Door -> thing that must be gone from beside its furniture for it to move. The twin sees it.
        rehearsed: What was tried in thought so far.
        rehearsed_at_first_motion: How much of that there was before anything moved.
    """

    furniture: Mapping[str, KnownFurniture] = field(default_factory=dict)
    fractions: dict[str, float] = field(default_factory=dict)
    bolts: Mapping[str, str] = field(default_factory=dict)
    bars: Mapping[str, str] = field(default_factory=dict)
    most: Mapping[str, float] = field(default_factory=dict)
    rehearsed: list[RewardSpec] = field(default_factory=list)
    rehearsed_at_first_motion: int | None = None

    def is_open(self, joint: str) -> bool:
        """Whether a joint counts as open."""
        return self.fractions.get(joint, 0.0) > 0.9

    def _shut_in(self, name: str) -> bool:
        owner = self.furniture.get(self.places.get(name, ""))
        return (
            owner is not None
            and owner.has_inside
            and not all(self.fractions.get(j.name, 0.0) > 0.6 for j in owner.joints)
        )

    # observer

    def look(self, names: Sequence[str]) -> SceneEstimate:
        scene = super().look([n for n in names if n not in self.furniture])
        objects = [o for o in scene.objects if not self._shut_in(o.name)]
        hidden = [Unseen(o.name, "no box above the threshold") for o in scene.objects if self._shut_in(o.name)]
        objects += [self._piece(n) for n in names if n in self.furniture]
        return replace(scene, objects=tuple(objects), unseen=(*scene.unseen, *hidden))

    def _piece(self, name: str) -> ObjectEstimate:
        x, width, depth, height = 0.4 + 0.6 * sorted(self.furniture).index(name), *CUPBOARD_SIZE
        if not self.furniture[name].has_inside:
            width, depth, height = 0.13, 0.13, 0.03
        fractions = {j.name: self.fractions.get(j.name, 0.0) for j in self.furniture[name].joints}
        solid = estimate(name, (x, 0.9, height / 2), (width, depth, height))
        return replace(solid, joint_fractions=fractions)

    def _estimate(self, name: str) -> ObjectEstimate:
        if name in self.furniture:
            return self._piece(name)
        under = self.places[name]
        if under in self.furniture:
            base = self._piece(under)
            raised = 0.25 if self.furniture[under].has_inside else base.top + 0.025
            return estimate(name, (base.position[0], base.position[1], raised), (0.05, 0.05, 0.05))
        return super()._estimate(name)

    # executor

    def attempt(self, spec: RewardSpec, scene: SceneEstimate) -> AttemptResult:
        if self.rehearsed_at_first_motion is None:
            self.rehearsed_at_first_motion = len(self.rehearsed)
        term = spec.primary
        if term.kind == "set_joint_fraction":
            self.specs.append(spec)
            cause = self._held_shut(term)
            if cause is None and self.bolts.get(term.subject, "") in ("", *filter(self.is_open, self.fractions)):
                self.fractions[term.subject] = float(term.value or 0.0)
            return AttemptResult(cause is None, cause)
        cause = self._no_way_in(term)
        if cause is not None:
            self.specs.append(spec)
            return AttemptResult(False, cause)
        was = self.places.get(term.subject)
        result = super().attempt(spec, scene)
        if result.ok and was is not None:
            for plate in (j for f in self.furniture.values() for j in f.joints if j.role == "plate"):
                if plate.owner in (was, self.places[term.subject]):
                    self.fractions[plate.name] = 1.0 if plate.owner == self.places[term.subject] else 0.0
        return result

    def _held_shut(self, term: RewardTerm) -> FailureCause | None:
        most = self.most.get(term.subject, 1.0)
        if float(term.value or 0.0) > most:
            return FailureCause(
                "no_candidate", term.subject, f"{term.subject} can be driven to {most:.0%} at most: ask for less"
            )
        bar = self.bars.get(term.subject)
        owner = next(f.name for f in self.furniture.values() if term.subject in [j.name for j in f.joints])
        if bar is None or self.beside.get(bar) != owner:
            return None
        return FailureCause("blocked_by", term.subject, f"{bar} is in the way of '{term.subject}'", bodies=(bar,))

    def _no_way_in(self, term: RewardTerm) -> FailureCause | None:
        for name in (self.places.get(term.subject, ""), term.target or ""):
            owner = self.furniture.get(name)
            if owner is not None and owner.has_inside and self._closed_for(owner, term):
                return FailureCause("no_candidate", term.subject, f"no way to {term.subject} through closed doors")
        return None

    def _closed_for(self, owner: KnownFurniture, term: RewardTerm) -> bool:
        inside = term.kind == "minimize_l2_distance" or self.places.get(term.subject) == owner.name
        return inside and not all(self.is_open(j.name) for j in owner.joints)

    def rehearse(
        self, spec: RewardSpec, scene: SceneEstimate, after: Rehearsal | None = None
    ) -> Rehearsal | FailureCause:
        """As an attempt in a world without bolts: a twin knows of none."""
        self.rehearsed.append(spec)
        thought: FurnishedWorld = deepcopy(self) if after is None else deepcopy(after.motion[0])
        thought.bolts = {}
        result = thought.attempt(spec, scene)
        if result.cause is not None:
            return result.cause
        return Rehearsal(thought.look(scene.names), (thought, spec))

    def play(self, rehearsal: Rehearsal) -> AttemptResult:
        """The attempt that was rehearsed."""
        return self.attempt(rehearsal.motion[1], rehearsal.scene)

    # evaluator

    def evaluate(self, term: RewardTerm, scene: SceneEstimate, before: SceneEstimate, /) -> TermJudgement:
        if term.kind != "set_joint_fraction":
            if term.target in self.furniture and term.kind == "minimize_l2_distance":
                return self._judge_at(term, scene)
            return super().evaluate(term, scene, before)
        seen = {k: v for o in scene.objects for k, v in o.joint_fractions.items()}
        if term.subject not in seen:
            raise UnknownObjectError(f"no joint named '{term.subject}' in this scene; it has {sorted(seen)}")
        met = abs(seen[term.subject] - float(term.value or 0.0)) < 0.05
        return TermJudgement(met, 0.0 if met else 1.0, f"{term.subject} is {seen[term.subject]:.0%} open")

    def _judge_at(self, term: RewardTerm, scene: SceneEstimate) -> TermJudgement:
        a, b = scene.get(term.subject), scene.get(str(term.target))
        if a is None or b is None:
            raise UnknownObjectError(f"no object named '{term.subject}' in this scene; it has {sorted(scene.names)}")
        met = bool(abs(a.position - b.position)[:2].max() < 0.1)
        return TermJudgement(met, 0.0 if met else 1.0, f"{a.name} is{'' if met else ' not'} in {b.name}")
