"""What a goal wants, in facts and in terms that the term evaluator can check; and what it tells besides.

Words mean the same things as for the rule-based planner (`planning.builtin.situation`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from control.errors import GoalError
from control.tasks.reward_spec import RewardTerm
from perception.estimates import SceneEstimate
from planning.baselines.domain import Distances, distances, spec_of
from planning.baselines.strips import Fact, State
from planning.baselines.told import Told
from planning.builtin.situation import Situation
from planning.language.furnishings import KnownFurniture
from planning.language.goal_language import Clause, Hint, parse_goal
from planning.language.names import MissingName, NameProblem
from planning.language.scene_facts import read_facts
from planning.loop.perceiver import describe


class UnplannableError(ValueError):
    """A goal that the symbols have no words for; the message is the reason, for people."""


@dataclass(frozen=True)
class SymbolicGoal:
    """What a part of a goal wants.

    Attributes:
        text: In plain words.
        facts: What shall be true; none for a thing that only had to be seen.
        terms: What the term evaluator checks.
    """

    text: str
    facts: tuple[Fact, ...] = ()
    terms: tuple[RewardTerm, ...] = ()


@dataclass(frozen=True)
class SymbolicGoals:
    """All of a goal.

    Attributes:
        all: In the order of the goal; one about furniture is one for each of its joints.
        told: What was told, by a person or in the goal's own words.
    """

    all: tuple[SymbolicGoal, ...]
    told: Told

    @property
    def lasting(self) -> tuple[SymbolicGoal, ...]:
        """Symbolic goals that no later one about the same thing replaces."""
        last: dict[str, SymbolicGoal] = {}
        for symbolic in self.all:
            if symbolic.facts:
                last.pop(symbolic.facts[0][1], None)
                last[symbolic.facts[0][1]] = symbolic
        return tuple(last.values())

    @property
    def facts(self) -> State:
        """All that shall be true at the end."""
        return frozenset(f for g in self.lasting for f in g.facts)


def read_symbolic_goals(
    goal: str, scene: SceneEstimate, furniture: Mapping[str, KnownFurniture], told: Told | None = None
) -> SymbolicGoals:
    """The symbolic goals of a goal text in the small goal language.

    Args:
        goal: In plain language.
        scene: What is seen.
        furniture: What is known of furniture, by name.
        told: What a person told; what the goal tells ("the cabinet opens when the lever is pulled") is added.

    Raises:
        GoalError: The goal is empty or not of that language.
        UnplannableError: A name that is not in view or not unique, or a clause that no symbol stands for.
    """
    told = told or Told()
    situation = Situation(scene.names, read_facts(describe(scene, furniture)))
    away = distances(scene, furniture)
    parsed = parse_goal(goal)
    symbolic_goals = tuple(
        _symbolic_goal(meant, scene, furniture, situation, away)
        for c in parsed.clauses
        for meant in _meant(c, situation, scene)
    )
    locks = tuple(lock for hint in parsed.hints for lock in _locks(hint, situation, scene, furniture))
    return SymbolicGoals(symbolic_goals, replace(told, locks=(*told.locks, *locks)))


def _meant(clause: Clause, situation: Situation, scene: SceneEstimate) -> list[Clause]:
    """The clause with names of what is in view."""
    try:
        meant = situation.meant(clause)
    except MissingName as missing:
        raise _out_of_view(missing.phrase, scene) from None
    except (NameProblem, GoalError) as problem:
        raise UnplannableError(str(problem)) from None
    for part in meant:
        for name in part.phrases:
            if name not in scene.names and name not in situation.facts.joints:
                raise _out_of_view(name, scene)
    return meant


def _out_of_view(name: str, scene: SceneEstimate) -> UnplannableError:
    seen = ", ".join(n.replace("_", " ") for n in scene.names) or "nothing"
    return UnplannableError(f"{name.replace('_', ' ')} is not in view; in view: {seen}")


def _locks(
    hint: Hint, situation: Situation, scene: SceneEstimate, furniture: Mapping[str, KnownFurniture]
) -> list[tuple[str, str]]:
    """What a goal tells of a lock, as pairs of a door and the joint that frees it."""
    doors = [c.subject for c in _meant(Clause("open", hint.what), situation, scene)]
    key = _meant(hint.clause, situation, scene)[0]
    piece = furniture.get(str(key.target))
    plates = [j.name for j in piece.joints if j.role == "plate"] if piece is not None else []
    keys = [key.subject] if key.subject in situation.facts.joints else plates
    if not keys:
        raise UnplannableError(f"'{key.as_text()}' moves no joint that is known, so it can open nothing")
    return [(door, k) for door in doors for k in keys]


def _symbolic_goal(
    clause: Clause,
    scene: SceneEstimate,
    furniture: Mapping[str, KnownFurniture],
    situation: Situation,
    away: Distances,
) -> SymbolicGoal:
    """What one clause with exact names wants."""
    a, b = clause.subject, str(clause.target)
    match clause.kind:
        case "find":
            at = scene.get(a)
            assert at is not None  # names are in view
            x, y, z = at.position
            return SymbolicGoal(f"{a} is in view: centre at x {x:.3f}, y {y:.3f}, z {z:.3f} m")
        case "open" | "pull" | "close":
            fact, how = ("is-closed", "closed") if clause.kind == "close" else ("is-open", "open")
            # How far a plate went down is nothing that a camera can tell.
            judged = situation.facts.joints[a].role != "plate"
            return _with_term(clause.as_text(), ((fact, a),), [("drive", a, how)] if judged else [], away)
        case "reach":
            return _with_term(f"reach {a}", (("palm-at", a),), [("reach", a)], away)
        case "clear":
            loads = situation.facts.on_or_in(a)
            parts = [("away", load, a) for load in loads]
            return _with_term(f"clear {a}", tuple(("is-away", x, y) for _, x, y in parts), parts, away)
    if a in furniture:
        raise UnplannableError(f"{a} is furniture and stays where it is")
    match clause.kind:
        case "lift":
            return _with_term(f"pick up {a}", (("is-up", a),), [("lift", a)], away)
        case "away":
            return _with_term(f"move {a} away from {b}", (("is-away", a, b),), [("away", a, b)], away)
        case "place":
            piece = furniture.get(b)
            if piece is not None and not piece.has_inside and all(j.role != "plate" for j in piece.joints):
                raise UnplannableError(f"nothing can be put on {b}")
            return _with_term(clause.as_text(), (("rests-on", a, b),), [("place", a, b)], away)
    raise UnplannableError(f"no symbolic action is about '{clause.as_text()}'")


def _with_term(text: str, facts: tuple[Fact, ...], skills: list[tuple[str, ...]], away: Distances) -> SymbolicGoal:
    specs = [spec_of(skill, away) for skill in skills]
    return SymbolicGoal(text, facts, tuple(s.primary for s in specs if s is not None))
