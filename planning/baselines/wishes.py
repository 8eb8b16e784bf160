"""What a goal wants, in facts and in terms that a judge can look at."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from control.rewards import RewardTerm
from perception.estimates import SceneEstimate
from planning.baselines.domain import Distances, distances, spec_of
from planning.baselines.strips import Fact, State
from planning.furnishings import KnownFurniture
from planning.goal_language import Clause, parse_goal
from planning.names import MissingName, NameProblem, as_name, resolve


class UnplannableError(ValueError):
    """A goal that the symbols have no words for; the message is the reason, for people."""


@dataclass(frozen=True)
class Wish:
    """What one clause of a goal wants.

    Attributes:
        text: In plain words.
        facts: What shall be true; none for a thing that only had to be seen.
        terms: What a judge shall see, in the same order.
    """

    text: str
    facts: tuple[Fact, ...]
    terms: tuple[RewardTerm, ...]


def read_wishes(goal: str, scene: SceneEstimate, furniture: Mapping[str, KnownFurniture]) -> tuple[Wish, ...]:
    """The wishes of a goal in the small language of goals, one per clause.

    Raises:
        GoalError: The goal is empty or not of that language.
        UnplannableError: A name that is not in view or not unique, or a wish that no symbol stands for.
    """
    away = distances(scene, furniture)
    return tuple(wish_of(clause, scene, furniture, away) for clause in parse_goal(goal))


def goal_of(wishes: tuple[Wish, ...]) -> State:
    """All that shall be true at the end: of two wishes about the same thing, the later one."""
    return frozenset(f for w in lasting(wishes) for f in w.facts)


def lasting(wishes: tuple[Wish, ...]) -> tuple[Wish, ...]:
    """Wishes that no later one about the same thing replaces."""
    last: dict[str, Wish] = {}
    for wish in wishes:
        if wish.facts:
            subject = wish.facts[0][1]
            last.pop(subject, None)
            last[subject] = wish
    return tuple(last.values())


def wish_of(clause: Clause, scene: SceneEstimate, furniture: Mapping[str, KnownFurniture], away: Distances) -> Wish:
    """What one clause wants of a scene.

    Raises:
        UnplannableError: See `read_wishes`.
    """
    kind = str(clause.kind)
    if kind == "find":
        name = _resolved(clause.subject, scene.names)
        position = scene.get(name)
        assert position is not None
        x, y, z = position.position
        return Wish(f"{name} is in view: centre at x {x:.3f}, y {y:.3f}, z {z:.3f} m", (), ())
    if kind in ("open", "close", "pull"):
        return _of_joints(kind, clause.subject, scene, furniture, away)
    a = _resolved(clause.subject, scene.names)
    if kind == "reach":
        return _wish(f"reach {a}", ("palm-at", a), ("reach", a), away)
    if a in furniture:
        raise UnplannableError(f"{a} is furniture and stays where it is")
    if kind == "lift":
        return _wish(f"pick up {a}", ("is-up", a), ("lift", a), away)
    if kind not in ("place", "away"):
        raise UnplannableError(f"no symbolic action is about '{clause.as_text()}'")
    b = _resolved(str(clause.target), scene.names)
    if a == b:
        raise UnplannableError(f"'{clause.subject}' and '{clause.target}' both mean {a}; name two things")
    if kind == "away":
        return _wish(f"move {a} away from {b}", ("is-away", a, b), ("away", a, b), away)
    piece = furniture.get(b)
    if piece is not None and not piece.has_inside and all(j.role != "plate" for j in piece.joints):
        raise UnplannableError(f"nothing can be put on {b}")
    return _wish(f"place {a} on {b}", ("rests-on", a, b), ("place", a, b), away)


def _of_joints(
    kind: str, phrase: str, scene: SceneEstimate, furniture: Mapping[str, KnownFurniture], away: Distances
) -> Wish:
    """A joint by its own name, or all joints of a piece that a hand can drive."""
    by_hand = {n: [j.name for j in f.joints if j.by_hand] for n, f in furniture.items() if scene.get(n)}
    joints = [j for js in by_hand.values() for j in js]
    name = _resolved(phrase, [*(n for n, js in by_hand.items() if js), *joints])
    fact, how = ("is-closed", "closed") if kind == "close" else ("is-open", "open")
    parts = [_wish("", (fact, j), ("drive", j, how), away) for j in by_hand.get(name, [name])]
    return Wish(
        f"{kind} {name}",
        tuple(f for p in parts for f in p.facts),
        tuple(t for p in parts for t in p.terms),
    )


def _wish(text: str, fact: Fact, skill: Fact, away: Distances) -> Wish:
    spec = spec_of(skill, away)
    assert spec is not None  # only looks have none
    return Wish(text, (fact,), (spec.primary,))


def _resolved(phrase: str, names: Iterable[str]) -> str:
    names = list(names)
    try:
        return resolve(phrase, names)
    except MissingName:
        seen = ", ".join(n.replace("_", " ") for n in names) or "nothing"
        what = as_name(phrase).replace("_", " ")
        raise UnplannableError(f"{what} is not in view; in view: {seen}") from None
    except NameProblem as problem:
        raise UnplannableError(str(problem)) from None
