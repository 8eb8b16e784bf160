"""A perceived scene as a symbolic problem: what stands where, what is open, and what a hand can do about it.

Facts come from estimates alone. What is seen while the doors of a piece are closed is not behind them. What nobody sees
(bolts, what a bar behind handles does) is not in it unless it was told. One thing has room on another one, furniture
has room for any number.

    rests-on x y     is-empty y      nothing rests on y          is-away x y   x is on the table at a distance from y
    is-open j        is-closed j     can-move j   nothing was told that holds the joint
    other-than y x   y is not x      hand-free    nothing is held; the last action of a plan may end otherwise

Own words have hyphens, names of scenes have not, so none is taken for the other.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from control.tasks.reward_spec import PALM, RewardSpec, RewardTerm
from perception.estimates import ObjectEstimate, SceneEstimate
from planning.baselines.strips import Action, Fact, Schema, State, SymbolicProblem
from planning.baselines.told import Told
from planning.language.furnishings import KnownFurniture
from planning.language.relations import find_relations
from planning.language.scene_facts import WIDE

TABLE = "the-table"
AWAY_DISTANCE = 0.2  # [m] between centres; leaves a hand's width (0.2 m) for the next grasp and stays in reach
LIFT_HEIGHT = 0.25  # [m], of a lifted thing's centre: clear of table-top things, far from the arm's own limits
LOOSE, ONE_PLACE, INSIDE, PLATE = "loose-thing", "place-for-one", "furniture-inside", "furniture-plate"
DOOR, LEVER, PLATE_JOINT = "door-joint", "lever-joint", "plate-joint"
TYPES: Mapping[str, str | None] = {
    "any-body": None,
    "any-place": "any-body",
    ONE_PLACE: "any-place",
    LOOSE: ONE_PLACE,
    INSIDE: "any-place",
    PLATE: "any-place",
    "furniture-fixture": "any-body",
    "any-joint": None,
    DOOR: "any-joint",
    LEVER: "any-joint",
    PLATE_JOINT: "any-joint",
}
PREDICATES: Mapping[str, tuple[str, ...]] = {
    "rests-on": (LOOSE, "any-place"),
    "is-empty": ("any-place",),
    "other-than": ("any-body", LOOSE),
    "is-away": (LOOSE, "any-body"),
    "is-open": ("any-joint",),
    "is-closed": ("any-joint",),
    "can-move": ("any-joint",),
    "hand-free": (),
    "is-up": (LOOSE,),
    "palm-at": ("any-body",),
    "looked-into": (INSIDE,),
}
HAND: Fact = ("hand-free",)
_X, _FROM = ("?x", LOOSE), ("?from", ONE_PLACE)
_LIFTABLE: tuple[Fact, ...] = (("rests-on", "?x", "?from"), ("is-empty", "?x"), HAND)


@dataclass(frozen=True)
class Distances:
    """How far things are put from others that they shall be away from.

    Attributes:
        of: Horizontal distance between centres in [m], by the name of the other one.
    """

    of: Mapping[str, float]


def symbolic_problem(
    scene: SceneEstimate, furniture: Mapping[str, KnownFurniture], told: Told, goal: State = frozenset()
) -> SymbolicProblem:
    """What is known of a scene, and what can be done in it.

    Args:
        scene: What is seen.
        furniture: What is known of the cell's furniture, by name; pieces out of view are left out.
        told: Facts that nobody sees.
        goal: What shall be true.
    """
    pieces = {n: f for n, f in furniture.items() if scene.get(n) is not None}
    objects: dict[str, str] = {TABLE: ONE_PLACE}
    for thing in scene.objects:
        piece = pieces.get(thing.name)
        objects[thing.name] = LOOSE if piece is None else _piece_type(piece)
    for piece in pieces.values():
        for joint in piece.joints:
            objects[joint.name] = {"door": DOOR, "lever": LEVER, "plate": PLATE_JOINT}[joint.role]
    schemas = [*_GENERAL]
    for piece in pieces.values():
        schemas += _of_inside(piece) if piece.has_inside else []
        schemas += [s for j in piece.joints if j.role == "plate" for s in _of_plate(piece.name, j.name)]
        for joint in (j for j in piece.joints if j.by_hand):
            schemas += _of_held_joint(joint.name, joint.role == "lever", piece.name, told, scene)
    initial = _facts(scene, pieces, told)
    return SymbolicProblem(TYPES, objects, PREDICATES, tuple(schemas), initial, goal)


def _piece_type(piece: KnownFurniture) -> str:
    if piece.has_inside:
        return INSIDE
    return PLATE if any(j.role == "plate" for j in piece.joints) else "furniture-fixture"


def _facts(scene: SceneEstimate, pieces: Mapping[str, KnownFurniture], told: Told) -> State:
    facts: set[Fact] = {HAND, ("is-empty", TABLE)}
    is_open = {j.name: _is_open(scene, p.name, j.name) for p in pieces.values() for j in p.joints}
    loose = [o.name for o in scene.objects if o.name not in pieces]
    places: dict[str, str] = dict.fromkeys(loose, TABLE)
    for relation in find_relations(scene):
        a, b = relation.a, relation.b
        if relation.kind not in ("on", "in") or a not in places:
            continue
        piece = pieces.get(b)
        if piece is not None and piece.has_inside:
            holds = relation.kind == "in" and any(is_open[j.name] for j in piece.joints)
        else:
            holds = piece is None or _piece_type(piece) == PLATE
        if holds:
            places[a] = b
    facts |= {("rests-on", a, b) for a, b in places.items()}
    plates = [n for n, piece in pieces.items() if _piece_type(piece) == PLATE]
    facts |= {("is-empty", n) for n in (*loose, *plates) if n not in places.values()}
    facts |= {("other-than", b, a) for a in loose for b in scene.names if a != b}
    facts |= {("is-open" if opened else "is-closed", j) for j, opened in is_open.items()}
    held = {j for j, _ in (*told.locks, *told.blocks)}
    facts |= {("can-move", j) for j in is_open if j not in held}
    away = distances(scene, pieces)
    for a in (scene.get(n) for n in loose if places[n] == TABLE):
        for b in scene.objects:
            if a is not None and a.name != b.name and _apart(a, b) >= away.of[b.name]:
                facts.add(("is-away", a.name, b.name))
    return frozenset(facts)


def _is_open(scene: SceneEstimate, owner: str, joint: str) -> bool:
    seen = scene.get(owner)
    return seen is not None and seen.joint_fractions.get(joint, 0.0) >= WIDE


def _apart(a: ObjectEstimate, b: ObjectEstimate) -> float:
    return float(np.linalg.norm(a.position[:2] - b.position[:2]))


def distances(scene: SceneEstimate, furniture: Mapping[str, KnownFurniture]) -> Distances:
    """How far "away" is from each thing of a scene: beyond the corners of furniture, whose doors need room."""
    return Distances(
        {
            o.name: AWAY_DISTANCE + (float(np.hypot(*o.extents[:2])) / 2 if o.name in furniture else 0.0)
            for o in scene.objects
        }
    )


# -- what can be done --------------------------------------------------------------------------------------------------

_GENERAL: tuple[Schema, ...] = (
    Schema(
        "pick-and-place",
        (_X, _FROM, ("?to", ONE_PLACE)),
        (*_LIFTABLE, ("is-empty", "?to"), ("other-than", "?to", "?x")),
        (("rests-on", "?x", "?to"), ("is-empty", "?from")),
        (("rests-on", "?x", "?from"), ("is-empty", "?to"), ("is-away", "?x", "?to")),
        ("place", "?x", "?to"),
    ),
    Schema(
        "take-off",
        (_X, ("?under", LOOSE)),
        (("rests-on", "?x", "?under"), ("is-empty", "?x"), HAND, ("other-than", "?under", "?x")),
        (("rests-on", "?x", TABLE), ("is-empty", "?under"), ("is-away", "?x", "?under")),
        (("rests-on", "?x", "?under"),),
        ("away", "?x", "?under"),
    ),
    Schema(
        "move-aside",
        (_X, ("?body", "any-body")),
        (("rests-on", "?x", TABLE), ("is-empty", "?x"), ("other-than", "?body", "?x"), HAND),
        (("is-away", "?x", "?body"),),
        (),
        ("away", "?x", "?body"),
    ),
    Schema(
        "lift-up",
        (_X, _FROM),
        _LIFTABLE,
        (("is-up", "?x"), ("is-empty", "?from")),
        (("rests-on", "?x", "?from"), HAND),
        ("lift", "?x"),
    ),
    Schema("reach-for", (("?body", "any-body"),), (HAND,), (("palm-at", "?body"),), (HAND,), ("reach", "?body")),
    Schema(
        "open-door",
        (("?door", DOOR),),
        (("is-closed", "?door"), ("can-move", "?door"), HAND),
        (("is-open", "?door"),),
        (("is-closed", "?door"),),
        ("drive", "?door", "open"),
    ),
    Schema(
        "close-door",
        (("?door", DOOR),),
        (("is-open", "?door"), ("can-move", "?door"), HAND),
        (("is-closed", "?door"),),
        (("is-open", "?door"),),
        ("drive", "?door", "closed"),
    ),
    Schema(
        "pull-lever",
        (("?lever", LEVER),),
        (("is-closed", "?lever"), ("can-move", "?lever"), HAND),
        (("is-open", "?lever"),),
        (("is-closed", "?lever"),),
        ("drive", "?lever", "open"),
    ),
)


def _of_inside(piece: KnownFurniture) -> list[Schema]:
    """Into a piece of furniture, out of it, and a look inside: all of its doors must be open."""
    name = piece.name
    doors: tuple[Fact, ...] = tuple(("is-open", j.name) for j in piece.joints)
    in_it: tuple[Fact, ...] = (("rests-on", "?x", name), ("is-empty", "?x"), HAND, *doors)
    return [
        Schema(
            f"put-in-{name}",
            (_X, _FROM),
            (*_LIFTABLE, *doors),
            (("rests-on", "?x", name), ("is-empty", "?from")),
            (("rests-on", "?x", "?from"), ("is-away", "?x", name)),
            ("place", "?x", name),
        ),
        Schema(
            f"take-out-of-{name}",
            (_X, ("?to", ONE_PLACE)),
            (*in_it, ("is-empty", "?to"), ("other-than", "?to", "?x")),
            (("rests-on", "?x", "?to"),),
            (("rests-on", "?x", name), ("is-empty", "?to"), ("is-away", "?x", "?to")),
            ("place", "?x", "?to"),
        ),
        Schema(
            f"clear-out-of-{name}",
            (_X,),
            in_it,
            (("rests-on", "?x", TABLE), ("is-away", "?x", name)),
            (("rests-on", "?x", name),),
            ("away", "?x", name),
        ),
        Schema(f"look-inside-{name}", (), doors, (("looked-into", name),), (), ("look", name)),
    ]


def _of_plate(name: str, joint: str) -> list[Schema]:
    """On a plate that goes down under a weight, and off it."""
    return [
        Schema(
            f"put-on-{name}",
            (_X, _FROM),
            (*_LIFTABLE, ("is-empty", name)),
            (("rests-on", "?x", name), ("is-open", joint), ("is-empty", "?from")),
            (("rests-on", "?x", "?from"), ("is-empty", name), ("is-closed", joint), ("is-away", "?x", name)),
            ("place", "?x", name),
        ),
        Schema(
            f"take-off-{name}",
            (_X,),
            (("rests-on", "?x", name), ("is-empty", "?x"), HAND),
            (("rests-on", "?x", TABLE), ("is-empty", name), ("is-closed", joint), ("is-away", "?x", name)),
            (("rests-on", "?x", name), ("is-open", joint)),
            ("away", "?x", name),
        ),
    ]


def _of_held_joint(joint: str, lever: bool, owner: str, told: Told, scene: SceneEstimate) -> list[Schema]:
    """A joint of which something was told moves by actions of its own, with conditions."""
    keys, blockers = told.keys_of(joint), told.blockers_of(joint)
    if not keys and not blockers:
        return []
    unlocked: tuple[Fact, ...] = tuple(("is-open", k) for k in keys)
    # A thing that is not in view can be moved by nobody; it counts as gone.
    clear: tuple[Fact, ...] = tuple(("is-away", x, owner) for x in blockers if scene.get(x) is not None)
    opened, closed = ("is-open", joint), ("is-closed", joint)
    verb = "pull" if lever else "open"
    found = [
        Schema(f"{verb}-{joint}", (), (closed, HAND, *unlocked, *clear), (opened,), (closed,), ("drive", joint, "open"))
    ]
    if not lever:
        skill = ("drive", joint, "closed")
        found.append(Schema(f"close-{joint}", (), (opened, HAND, *clear), (closed,), (opened,), skill))
    return found


# -- what a robot does for it ------------------------------------------------------------------------------------------


def sentence(action: Action) -> str:
    """An action as a step of a plan, for people."""
    match action.skill:
        case ("place", x, y):
            return f"place {x} {'in' if action.name.startswith('put-in') else 'on'} {y}"
        case ("away", x, y):
            return f"move {x} away from {y}"
        case ("drive", joint, "open"):
            return f"{'pull' if action.name.startswith('pull') else 'open'} {joint}"
        case ("drive", joint, _):
            return f"close {joint}"
        case ("lift", x):
            return f"pick up {x}"
        case ("look", place):
            return f"look inside {place}"
        case _:
            return f"reach {action.skill[1]}"


def spec_of(skill: Fact, away: Distances) -> RewardSpec | None:
    """The reward spec of a skill; None for a look.

    Args:
        skill: Of an action, or of a clause.
        away: How far "away" is from each thing.
    """
    match skill:
        case ("place", x, y):
            return _with_palm(RewardTerm("minimize_l2_distance", x, y))
        case ("away", x, y):
            return _with_palm(RewardTerm("maximize_l2_distance", x, y, away.of[y]))
        case ("lift", x):
            return _with_palm(RewardTerm("set_obj_z_position", x, value=LIFT_HEIGHT))
        case ("drive", joint, how):
            term = RewardTerm("set_joint_fraction", joint, value=1.0 if how == "open" else 0.0, primary=True)
            return RewardSpec((term,))
        case ("reach", x):
            return RewardSpec((RewardTerm("minimize_l2_distance", PALM, x, primary=True),))
    return None


def _with_palm(term: RewardTerm) -> RewardSpec:
    return RewardSpec((RewardTerm("minimize_l2_distance", PALM, term.subject), replace(term, primary=True)))
