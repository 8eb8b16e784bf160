"""Whether a reward term is met: one definition for states of the twin and for scenes as perceived.

A term is judged on positions and sizes of objects and on how far joints are open, so the same words mean the same in
both worlds. Each judgement has a residual r >= 0, the distance in [m] that is left to go; a term is met exactly when
r = 0. Tolerances are wide enough that a perception error of 5 mm does not turn a result that is well met.

    minimize_l2_distance(a, b)         a lies at the nearest supported place at b: on top of b, or in a container b
                                       where b is furniture with an inside, in there: on its floor
    minimize_l2_distance(palm, a)      the tool centre point is within `NEAR_PALM` of the surface of a's box
    minimize_l2_distance(a, rest_position)   a's centre (or the palm) is within `NEAR_PALM` of the rest position
    maximize_l2_distance(a, b, d)      the horizontal distance of the centres is at least d and a lies on the support
    maximize_l2_distance(palm, b, d)   the distance of the tool centre point from b's centre is at least d
    set_obj_z_position(a, z)           a's centre is at least at height z
    set_joint_fraction(j, f)           joint j stands within `FRACTION_TOLERANCE` of fraction f; r is a share, not [m]
    set_obj_orientation(a, t)          a is turned by t about its own x axis from how it stood at the start, in whatever
                                       heading, within `TURN_TOLERANCE`; r = angle x half of its length

Opening and closing are one definition: a door counts as closed when it stands closed, not when nothing was done to it.
Where attitudes are tracked (the twin), a turn is judged on them. A camera that fits upright boxes cannot tell which of
a box's faces is up: there a turn is judged on the height that it gives the object, and says so.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Literal

import numpy as np

from control.errors import UnknownObjectError
from control.robot.rotations import rolled, rotation_exp
from control.tasks.reward_spec import PALM, REST_POSITION, RewardTerm

NEAR_PALM = 0.03  # [m]
VERTICAL_TOLERANCE = 0.015  # [m], of a contact between two perceived boxes: two heights with 5 mm error each, and slack
EDGE_MARGIN = 0.005  # [m] by which a centre must lie inside the footprint that carries it: nearer, it would tip
HEIGHT_TOLERANCE = 0.01  # [m], of a lifted object's centre
DISTANCE_TOLERANCE = 0.01  # [m], of a horizontal distance to keep
# Share of a joint's range: 5.4 degrees of a door that turns by 1.9 rad. Perceived doors are off by two or three.
FRACTION_TOLERANCE = 0.05
TURN_TOLERANCE = 0.17  # [rad], of an object's tilt: it lies flat or it does not
SUPPORT = "table"


@dataclass(frozen=True)
class Inside:
    """The inside of furniture, in the furniture's frame.

    Attributes:
        low, high: Corners in [m], shape (3,): low's z is the shelf's surface.
        outward: Unit vector along x or y from the inside through the opening, shape (3,).
    """

    low: np.ndarray
    high: np.ndarray
    outward: np.ndarray


@dataclass(frozen=True)
class PosedObject:
    """An object at a place.

    Attributes:
        name: Name in the scene.
        pose: Pose of its box centre in the world, shape (4, 4).
        extents: Full sizes along its own axes in [m], shape (3,).
        shape: Solid; a cylinder's axis is its z.
        container: Whether things are put into it instead of onto it.
        inner_floor: Height of a container's inner floor above its lowest point in [m].
        inner_radius: Radius of a container's opening in [m].
        inside: Furniture's inside, or None.
        tracked: Whether its pose is followed from the start, so that its faces can be told apart; else it was fitted
            anew to what is seen.
        handles: Middles of the handles of its joints in the world in [m], shape (k, 3): the palm at one of them is at
            the object.
    """

    name: str
    pose: np.ndarray
    extents: np.ndarray
    shape: Literal["box", "cylinder", "sphere"] = "box"
    container: bool = False
    inner_floor: float = 0.0
    inner_radius: float = 0.0
    inside: Inside | None = None
    tracked: bool = True
    handles: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def position(self) -> np.ndarray:
        """Centre in the world in [m], shape (3,)."""
        return self.pose[:3, 3]

    @property
    def half_height(self) -> float:
        """Half of its vertical size as it stands in [m]: the support function of its solid along the world's z."""
        half = np.asarray(self.extents) / 2
        up = self.pose[2, :3]  # the world's z in the object's axes
        if self.shape == "sphere":
            return float(half.max())
        if self.shape == "cylinder":
            radius = max(half[0], half[1])
            return float(abs(up[2]) * half[2] + np.sqrt(max(0.0, 1.0 - up[2] ** 2)) * radius)
        return float(np.abs(up) @ half)

    @property
    def top(self) -> float:
        """Height of its highest point in [m]."""
        return float(self.pose[2, 3]) + self.half_height

    @property
    def bottom(self) -> float:
        """Height of its lowest point in [m]."""
        return float(self.pose[2, 3]) - self.half_height

    def distance_to(self, point: np.ndarray) -> float:
        """Distance in [m] of a point in the world from the object's box or the nearest of its handles; 0 inside."""
        local = self.pose[:3, :3].T @ (np.asarray(point) - self.position)
        box = float(np.linalg.norm(np.maximum(np.abs(local) - np.asarray(self.extents) / 2, 0.0)))
        return min([box, *np.linalg.norm(self.handles - point, axis=1)])

    def beyond_footprint(self, point: np.ndarray, margin: float) -> float:
        """Horizontal distance in [m] of a point from the footprint shrunk by `margin`; 0 inside it."""
        offset = np.asarray(point)[:2] - self.position[:2]
        half = np.asarray(self.extents)[:2] / 2
        if self.shape != "box":
            return float(max(0.0, np.linalg.norm(offset) - max(half.max() - margin, 0.0)))
        yaw = np.arctan2(self.pose[1, 0], self.pose[0, 0])
        c, s = np.cos(yaw), np.sin(yaw)
        local = np.array([c * offset[0] + s * offset[1], -s * offset[0] + c * offset[1]])
        return float(np.linalg.norm(np.maximum(np.abs(local) - np.maximum(half - margin, 0.0), 0.0)))


@dataclass(frozen=True)
class TermJudgement:
    """Whether one term is met.

    Attributes:
        met: Whether it is.
        residual: Distance left to go in [m], of a joint the share of its range; 0 exactly when met.
        text: One sentence for people.
    """

    met: bool
    residual: float
    text: str


def judge_term(
    term: RewardTerm,
    objects: Mapping[str, PosedObject],
    palm_position: np.ndarray,
    rest_palm_position: np.ndarray,
    start_objects: Mapping[str, PosedObject] | None = None,
    support_height: float = 0.0,
    fractions: Mapping[str, float] = MappingProxyType({}),
) -> TermJudgement:
    """Judge one term on a scene.

    Args:
        term: What is wanted.
        objects: Everything in the scene by name.
        palm_position: Tool centre point in the world in [m], shape (3,).
        rest_palm_position: Where the tool centre point is in the rest configuration in [m], shape (3,).
        start_objects: The scene before the motion. Where given, "away from b" is measured from where b stood then, so
            that pushing b away does not count.
        support_height: Height of the table top in [m].
        fractions: How far each joint is open, 0 closed .. 1 open, by name.

    Raises:
        UnknownObjectError: The term names an object that is not in `objects`, or a joint that is not in `fractions`.
    """
    if term.kind == "set_joint_fraction":
        if term.subject not in fractions:
            raise UnknownObjectError(f"no joint named '{term.subject}' in this scene; it has {sorted(fractions)}")
        return _judge_fraction(term, fractions[term.subject])
    for name in term.names:
        if name not in objects:
            raise UnknownObjectError(f"no object named '{name}' in this scene; it has {sorted(objects)}")
    palm, rest = np.asarray(palm_position, float), np.asarray(rest_palm_position, float)
    if term.kind == "set_obj_z_position":
        return _judge_height(objects[term.subject], float(term.value or 0.0))
    if term.kind == "set_obj_orientation":
        a = objects[term.subject]
        return _judge_turn(a, a if start_objects is None else start_objects.get(a.name, a), float(term.value or 0.0))
    if term.kind == "maximize_l2_distance":
        reference = objects if start_objects is None else start_objects
        return _judge_away(term, objects, reference, palm, rest, support_height)
    points = {PALM, REST_POSITION} & {term.subject, str(term.target)}
    if not points:
        return judge_placed(objects[term.subject], objects[str(term.target)])
    return _judge_near(term, objects, palm, rest)


def judge_placed(a: PosedObject, b: PosedObject) -> TermJudgement:
    """Whether `a` rests on top of `b`, or in it when it is a container; r = sqrt(horizontal^2 + vertical^2) in [m]."""
    if b.inside is not None:
        return _judge_inside(a, b, b.inside)
    if b.container:
        horizontal = max(0.0, float(np.linalg.norm(a.position[:2] - b.position[:2])) - b.inner_radius)
        floor = b.bottom + b.inner_floor
        vertical = max(0.0, a.bottom - b.top, floor - VERTICAL_TOLERANCE - a.bottom)
        residual = float(np.hypot(horizontal, vertical))
        if residual == 0.0:
            return TermJudgement(True, 0.0, f"{a.name} is in {b.name}")
        return TermJudgement(
            False,
            residual,
            f"{a.name} is not in {b.name}: {horizontal * 1e3:.0f} mm outside its opening, "
            f"{vertical * 1e3:.0f} mm above its rim or below its floor",
        )
    horizontal = b.beyond_footprint(a.position, EDGE_MARGIN)
    gap = a.bottom - b.top
    residual = float(np.hypot(horizontal, max(0.0, abs(gap) - VERTICAL_TOLERANCE)))
    if residual == 0.0:
        return TermJudgement(True, 0.0, f"{a.name} is on {b.name}")
    return TermJudgement(
        False,
        residual,
        f"{a.name} is not on {b.name}: its centre is {horizontal * 1e3:.0f} mm beyond what can carry it, "
        f"its underside {gap * 1e3:+.0f} mm from the top",
    )


def _judge_inside(a: PosedObject, b: PosedObject, inside: Inside) -> TermJudgement:
    """In upright furniture: the centre between the walls and behind the opening, the underside on the floor."""
    local = b.pose[:3, :3].T @ (a.position - b.position)
    beyond = np.maximum(inside.low - local, 0.0) + np.maximum(local - inside.high, 0.0)
    horizontal = float(np.linalg.norm(beyond[:2]))
    gap = a.bottom - (float(b.position[2]) + float(inside.low[2]))
    residual = float(np.hypot(horizontal, max(0.0, abs(gap) - VERTICAL_TOLERANCE)))
    if residual == 0.0:
        return TermJudgement(True, 0.0, f"{a.name} is in {b.name}")
    return TermJudgement(
        False,
        residual,
        f"{a.name} is not in {b.name}: its centre is {horizontal * 1e3:.0f} mm outside, its underside "
        f"{gap * 1e3:+.0f} mm from the floor",
    )


def _judge_near(
    term: RewardTerm, objects: Mapping[str, PosedObject], palm: np.ndarray, rest: np.ndarray
) -> TermJudgement:
    """The palm or the rest position with something: r = max(0, distance - NEAR_PALM)."""
    first, second = term.subject, str(term.target)
    if first in objects:
        first, second = second, first
    point = palm if first == PALM else rest
    if second in objects:
        # Beside the palm an object counts with its surface; at the rest position, as a place, with its centre.
        body = objects[second]
        distance = body.distance_to(point) if first == PALM else float(np.linalg.norm(body.position - point))
    else:
        distance = float(np.linalg.norm(palm - rest))
    residual = max(0.0, distance - NEAR_PALM)
    return TermJudgement(residual == 0.0, residual, f"{first} is {distance * 1e3:.0f} mm from {second}")


def _judge_away(
    term: RewardTerm,
    objects: Mapping[str, PosedObject],
    reference: Mapping[str, PosedObject],
    palm: np.ndarray,
    rest: np.ndarray,
    support_height: float,
) -> TermJudgement:
    first, second, wanted = term.subject, str(term.target), float(term.value or 0.0)
    if first not in objects:  # the palm or the rest position: only a distance
        if second not in objects:
            points = {PALM: palm, REST_POSITION: rest}
            distance = float(np.linalg.norm(points[first] - points[second]))
        else:
            point = palm if first == PALM else rest
            distance = float(np.linalg.norm(objects[second].position - point))
        residual = max(0.0, wanted - DISTANCE_TOLERANCE - distance)
        return TermJudgement(residual == 0.0, residual, f"{first} is {distance * 1e3:.0f} mm from {second}")
    a = objects[first]
    if second in (PALM, REST_POSITION):
        other = palm if second == PALM else rest
    else:
        other = reference[second].position if second in reference else objects[second].position
    distance = float(np.linalg.norm(a.position[:2] - other[:2]))
    short = max(0.0, wanted - DISTANCE_TOLERANCE - distance)
    height = abs(a.bottom - support_height)
    above = max(0.0, height - VERTICAL_TOLERANCE)
    residual = float(np.hypot(short, above))
    text = f"{a.name} is {distance * 1e3:.0f} mm from {second} (asked for {wanted * 1e3:.0f} mm)"
    if above:
        text += f" and {height * 1e3:.0f} mm off the {SUPPORT}"
    return TermJudgement(residual == 0.0, residual, text)


def _judge_fraction(term: RewardTerm, fraction: float) -> TermJudgement:
    wanted = float(term.value or 0.0)
    residual = max(0.0, abs(fraction - wanted) - FRACTION_TOLERANCE)
    text = f"{term.subject} is {fraction:.0%} open (asked for {wanted:.0%})"
    return TermJudgement(residual == 0.0, residual, text)


def _judge_height(a: PosedObject, wanted: float) -> TermJudgement:
    height = float(a.position[2])
    residual = max(0.0, wanted - HEIGHT_TOLERANCE - height)
    return TermJudgement(
        residual == 0.0, residual, f"the centre of {a.name} is at {height * 1e3:.0f} mm (asked for {wanted * 1e3:.0f})"
    )


def _judge_turn(a: PosedObject, start: PosedObject, angle: float) -> TermJudgement:
    """The direction that is up, in the object's own axes, against where a turn about x by `angle` [rad] takes it."""
    wanted = rotation_exp(np.array([-angle, 0.0, 0.0])) @ start.pose[2, :3]
    half_length = float(np.max(a.extents)) / 2
    if not a.tracked:
        turned = replace(start, pose=rolled(start.pose, 0, angle))
        off = abs(a.half_height - turned.half_height)
        residual = max(0.0, off - VERTICAL_TOLERANCE / 2)
        text = f"{a.name} is {2e3 * a.half_height:.0f} mm high, as far as it can be seen"
        return TermJudgement(
            residual == 0.0, residual, f"{text} (turned as asked it is {2e3 * turned.half_height:.0f})"
        )
    between = float(np.arccos(np.clip(a.pose[2, :3] @ wanted, -1.0, 1.0)))
    residual = max(0.0, between - TURN_TOLERANCE) * half_length
    text = f"{a.name} is {np.degrees(between):.0f} degrees from where a turn by {np.degrees(angle):.0f} would take it"
    return TermJudgement(residual == 0.0, residual, text)
