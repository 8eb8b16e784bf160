"""The safety residuals: one table of named definitions that costs the motion search and judges the verdict.

A residual reads a recorded motion of the twin and returns its worst value, when it happened and which bodies took
part; a motion keeps it when the worst value does not exceed the limit. The excess over the limit, divided by the
residual's scale, is what the search pays. A reasoner can neither name, weigh nor remove a residual.

    tracked_hand_speed  |v_tcp| as the twin's arm moves, over 20 ms (the commanded speed is judged sample by sample)
    contact_force       force on arm or hand, fingers apart
    pressing_force      force on fingers or a handled object from what is neither
    unwanted_contact    force of contacts outside {fingers, handled things, supports}
    self_contact        force between two parts of the robot
    tracked_hand_angular_speed  the same for its rotation
    workspace           distance of any point of the hand outside the box
    keep_out            depth of any moving part of the robot inside a zone
    moved               displacement of objects that the subtask does not name
    joint_moved         the same for the handles of joints: doors that were opened stay open
    tipped              tilt of those objects
    self_clearance      lack of distance between parts of the robot that are not neighbours
    arm_clearance       lack of distance between arm or hand and the world
    finger_clearance    the same for the fingers
    held_clearance      the same for a carried object in transit
    held_kept           slip of a held object in the hand
    released            force between fingers and an object that should have been let go, at the end
    settled             speed of any object over the last `settle_time`
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from control.safety.certificate import CheckResult
from control.safety.limits import SafetyLimits
from control.safety.zones import RobotTrack, inside_zone, outside_box
from control.twin_model import ARM_BODIES, FINGER_BODIES, HAND_BODY, TABLE_BODY

SPEED_WINDOW = 0.02  # [s]
# The twin's servo overshoots a commanded speed by up to 15 %; the commanded speed itself is judged exactly.
SPEED_SLACK = 1.2
TOUCH = 1.0  # [N]: below, a contact is two surfaces grazing
SOFT = 0.002  # [m] that fingertips on a table may be below it: simulated contacts give way
HELD_SLIP = 0.02  # [m] that a held object may shift in the hand: fingers that close centre it first
_ARM = frozenset({*ARM_BODIES, HAND_BODY})
_FINGERS = frozenset(FINGER_BODIES)
_ROBOT = _ARM | _FINGERS


@dataclass(frozen=True)
class Contacts:
    """Contacts with force, one row each, in order of time.

    Attributes:
        step: Index of the sample, int, shape (k,).
        pairs: Names of two bodies, the pairs that touch at some time.
        pair: Which of these pairs touches, int, shape (k,).
        force: Magnitude in [N], shape (k,).
    """

    step: NDArray[np.int64]
    pairs: tuple[tuple[str, str], ...]
    pair: NDArray[np.int64]
    force: NDArray[np.float64]


@dataclass(frozen=True)
class Clearances:
    """Least distances at some samples, as far as they were looked for.

    Attributes:
        step: Index of the sample, int, shape (k,).
        lack: For "self" (parts of the robot), "arm" (arm and hand), "finger" and "held" (a carried object in transit):
            the clearance that is asked for minus the distance in [m], shape (k,); negative where there is room, -inf
            where nothing is near.
        bodies: What lacks most of it for each of them, k names.
        distance: The least distance itself in [m] for each of them, shape (k,), negative in overlap; inf where nothing
            is nearer than was looked for. Who is asked for no distance (fingers and what they grasp) is left out.
        nearest: What is at that distance, k names.
    """

    step: NDArray[np.int64]
    lack: dict[str, np.ndarray]
    bodies: dict[str, tuple[str, ...]]
    distance: dict[str, np.ndarray]
    nearest: dict[str, tuple[str, ...]]


@dataclass(frozen=True)
class HeldSpan:
    """An object in the hand from one sample to another: start <= step < stop."""

    name: str
    start: int
    stop: int


@dataclass(frozen=True)
class TwinMotion:
    """A motion as it went in the twin.

    Attributes:
        time: Times of the samples in [s], shape (n,).
        tcp: Pose of the tool centre point, shape (n, 4, 4).
        objects: Pose of each object over time, name -> (n, 4, 4).
        contacts: Contacts with force.
        held: When which object was in the hand.
        named: Objects that the subtask names.
        subject: The object that is handled, or None.
        handled: Objects and joints that may be touched beside it.
        grasped: What the fingers close on in some stretch: the subject, or what is handled on the way to it.
        supports: Bodies that may carry it: those under it at the start, the terms' targets, the table.
        expects_release: Whether the subject has to be let go at the end.
        clearances: Least distances, or None where they were not looked for.
        fractions: How far each joint of furniture is open, 0..1, joint name -> (n,).
        handles: Middle of each joint's handle in the world in [m], joint name -> (n, 3).
        robot: Points of the robot; None leaves the tool centre point alone.
    """

    time: NDArray[np.floating]
    tcp: NDArray[np.float64]
    objects: dict[str, np.ndarray]
    contacts: Contacts
    held: tuple[HeldSpan, ...] = ()
    named: frozenset[str] = frozenset()
    subject: str | None = None
    handled: frozenset[str] = frozenset()
    grasped: frozenset[str] = frozenset()
    supports: frozenset[str] = field(default_factory=lambda: frozenset({TABLE_BODY}))
    expects_release: bool = False
    clearances: Clearances | None = None
    fractions: dict[str, np.ndarray] = field(default_factory=dict)
    handles: dict[str, np.ndarray] = field(default_factory=dict)
    robot: RobotTrack | None = None


@dataclass(frozen=True)
class Worst:
    """The worst moment of a residual."""

    value: float = 0.0
    at: float | None = None
    bodies: tuple[str, ...] = ()


@dataclass(frozen=True)
class SafetyResidual:
    """One row of the table.

    Attributes:
        name: As in reports.
        unit: Of value and limit.
        limit: Largest value that is still safe.
        scale: Excess that costs 1 in the search, in `unit`.
        measure: Finds the worst moment of a motion.
    """

    name: str
    unit: str
    limit: float
    scale: float
    measure: Callable[[TwinMotion], Worst]

    def check(self, motion: TwinMotion) -> CheckResult:
        """Hold a motion against the limit."""
        worst = self.measure(motion)
        ok = bool(np.isfinite(worst.value) and worst.value <= self.limit)
        return CheckResult(self.name, float(worst.value), self.limit, self.unit, ok, worst.at, worst.bodies)

    def cost(self, motion: TwinMotion) -> float:
        """max(0, worst - limit) / scale, at most 10 for one residual."""
        worst = self.measure(motion).value
        return 10.0 if not np.isfinite(worst) else min(10.0, max(0.0, worst - self.limit) / self.scale)


def safety_residuals(safety: SafetyLimits) -> tuple[SafetyResidual, ...]:
    """The table with the numbers of one cell."""
    return (
        SafetyResidual("tracked_hand_speed", "m/s", safety.hand_speed * SPEED_SLACK, 0.5, hand_speed),
        SafetyResidual(
            "tracked_hand_angular_speed", "rad/s", safety.hand_angular_speed * SPEED_SLACK, 2.0, hand_angular_speed
        ),
        SafetyResidual("contact_force", "N", safety.contact_force, 15.0, contact_force),
        SafetyResidual("pressing_force", "N", safety.pressing_force, 15.0, pressing_force),
        SafetyResidual("unwanted_contact", "N", TOUCH, 15.0, unwanted_contact),
        SafetyResidual("self_contact", "N", 0.0, 15.0, self_contact),
        SafetyResidual("workspace", "m", SOFT, 0.05, lambda motion: outside_workspace(motion, safety)),
        SafetyResidual("keep_out", "m", 0.0, 0.05, lambda motion: in_keep_out(motion, safety)),
        SafetyResidual("moved", "m", safety.moved, 0.02, moved),
        SafetyResidual("joint_moved", "m", safety.moved, 0.02, joint_moved),
        SafetyResidual("tipped", "rad", safety.tipped, 0.26, tipped),
        SafetyResidual("self_clearance", "m", 0.0, 0.01, lambda motion: lacking(motion, "self")),
        SafetyResidual("arm_clearance", "m", 0.0, 0.01, lambda motion: lacking(motion, "arm")),
        SafetyResidual("finger_clearance", "m", 0.0, 0.01, lambda motion: lacking(motion, "finger")),
        SafetyResidual("held_clearance", "m", 0.0, 0.01, lambda motion: lacking(motion, "held")),
        SafetyResidual("held_kept", "m", HELD_SLIP, 0.02, held_slip),
        SafetyResidual("released", "N", 0.0, 10.0, still_gripped),
        SafetyResidual(
            "settled", "m/s", safety.settle_speed, 0.05, lambda motion: restless(motion, safety.settle_time)
        ),
    )


def hand_speed(motion: TwinMotion) -> Worst:
    """Speed of the tool centre point in [m/s]: v(t) = |p(t + w) - p(t)| / w with w = 20 ms."""
    span = _window(motion, SPEED_WINDOW)
    if len(motion.time) <= span:
        return Worst()
    p = motion.tcp[:, :3, 3]
    speed = np.linalg.norm(p[span:] - p[:-span], axis=1) / (motion.time[span:] - motion.time[:-span])
    i = int(np.argmax(speed))
    return Worst(float(speed[i]), float(motion.time[i]), (HAND_BODY,))


def hand_angular_speed(motion: TwinMotion) -> Worst:
    """Angular speed of the hand in [rad/s]: the angle between R(t) and R(t + w) over w = 20 ms."""
    span = _window(motion, SPEED_WINDOW)
    if len(motion.time) <= span:
        return Worst()
    r = motion.tcp[:, :3, :3]
    # |R1 - R0|_F = 2 sqrt(2) sin(angle / 2), which keeps its precision for small angles.
    chord = np.sqrt(np.sum((r[span:] - r[:-span]) ** 2, axis=(1, 2))) / (2.0 * np.sqrt(2.0))
    speed = 2.0 * np.arcsin(np.minimum(chord, 1.0)) / (motion.time[span:] - motion.time[:-span])
    i = int(np.argmax(speed))
    return Worst(float(speed[i]), float(motion.time[i]), (HAND_BODY,))


def contact_force(motion: TwinMotion) -> Worst:
    """Largest force in [N] between arm or hand (fingers apart) and anything that is not the robot."""
    return _worst_contact(motion, lambda a, b: (a in _ARM and b not in _ROBOT) or (b in _ARM and a not in _ROBOT))


def pressing_force(motion: TwinMotion) -> Worst:
    """Largest force in [N] between fingers or a handled object and anything that is neither, the robot apart.

    Putting a thing down takes its weight and a little more; a hand that goes on down presses it into what carries it.
    """
    own = _FINGERS | motion.handled | motion.grasped | {s.name for s in motion.held}
    own |= {motion.subject} if motion.subject else set()

    def pressing(a: str, b: str) -> bool:
        return (a in own or b in own) and not (a in own and b in own) and a not in _ARM and b not in _ARM

    return _worst_contact(motion, pressing)


def unwanted_contact(motion: TwinMotion) -> Worst:
    """Largest force in [N] of a contact of robot or handled things outside {fingers, handled things, supports}.

    Contacts between other things (a cube that stands on a crate) are nobody's business here.
    """
    own = motion.handled | ({motion.subject} if motion.subject else set())
    allowed = _FINGERS | motion.supports | own
    acting = _ROBOT | own
    if not own:  # the palm alone: nothing may be touched, but what it holds may stay in the hand
        allowed = _FINGERS | {span.name for span in motion.held}

    def unwanted(a: str, b: str) -> bool:
        if a in _ROBOT and b in _ROBOT:
            return False
        return (a in acting or b in acting) and not (a in allowed and b in allowed)

    return _worst_contact(motion, unwanted)


def self_contact(motion: TwinMotion) -> Worst:
    """Largest force in [N] between two parts of the robot; the two fingers of a closed hand touch by right."""
    return _worst_contact(motion, lambda a, b: a in _ROBOT and b in _ROBOT and not (a in _FINGERS and b in _FINGERS))


def outside_workspace(motion: TwinMotion, safety: SafetyLimits) -> Worst:
    """Furthest distance in [m] of a point of hand or fingers outside the workspace box."""
    track = motion.robot or RobotTrack.of_hand(motion.tcp)
    value, sample, body = outside_box(track, np.asarray(safety.workspace_low), np.asarray(safety.workspace_high))
    return Worst(value, float(motion.time[sample]), (body,))


def in_keep_out(motion: TwinMotion, safety: SafetyLimits) -> Worst:
    """Largest depth in [m] of a point of the arm, the hand or the fingers inside a keep-out zone."""
    track = motion.robot or RobotTrack.of_hand(motion.tcp)
    worst = Worst()
    for low, high in safety.keep_out:
        value, sample, body = inside_zone(track, np.asarray(low), np.asarray(high))
        if value > worst.value:
            worst = Worst(value, float(motion.time[sample]), (body,))
    return worst


def moved(motion: TwinMotion) -> Worst:
    """Largest displacement in [m], from its start, of an object that the subtask does not name."""
    return _worst_unnamed(motion, lambda poses: np.linalg.norm(poses[:, :3, 3] - poses[0, :3, 3], axis=1))


def joint_moved(motion: TwinMotion) -> Worst:
    """Largest displacement in [m], from its start, of the handle of a joint that the subtask does not name."""
    worst = Worst()
    for name, points in motion.handles.items():
        if name in motion.named:
            continue
        way = np.linalg.norm(points - points[0], axis=1)
        i = int(np.argmax(way))
        if way[i] > worst.value:
            worst = Worst(float(way[i]), float(motion.time[i]), (name,))
    return worst


def tipped(motion: TwinMotion) -> Worst:
    """Largest change in [rad] of the direction of an unnamed object's z axis; a turn about the vertical is none."""

    def tilt(poses: np.ndarray) -> np.ndarray:
        return np.arccos(np.clip(poses[:, :3, 2] @ poses[0, :3, 2], -1.0, 1.0))

    return _worst_unnamed(motion, tilt)


def lacking(motion: TwinMotion, part: str) -> Worst:
    """Largest lack of distance in [m] of "self", "arm", "finger" or "held"; 0 where all keep their distance."""
    c = motion.clearances
    if c is None or not len(c.step):
        return Worst()
    i = int(np.argmax(c.lack[part]))
    value = float(c.lack[part][i])
    if value <= 0.0:
        return Worst()
    if part == "self":
        return Worst(value, float(motion.time[c.step[i]]), (c.bodies[part][i],))
    own = HAND_BODY
    if part == "held":
        own = next((s.name for s in motion.held if s.start <= c.step[i] < s.stop), motion.subject or "")
    return Worst(value, float(motion.time[c.step[i]]), (own, c.bodies[part][i]))


def held_slip(motion: TwinMotion) -> Worst:
    """Largest shift in [m] of a held object in the hand, against where it was when the hold began."""
    worst = Worst()
    for span in motion.held:
        poses, tcp = motion.objects[span.name][span.start : span.stop], motion.tcp[span.start : span.stop]
        if len(poses) < 2:
            continue
        local = np.einsum("nji,nj->ni", tcp[:, :3, :3], poses[:, :3, 3] - tcp[:, :3, 3])
        slip = np.linalg.norm(local - local[0], axis=1)
        i = int(np.argmax(slip))
        if slip[i] > worst.value:
            worst = Worst(float(slip[i]), float(motion.time[span.start + i]), (span.name,))
    return worst


def still_gripped(motion: TwinMotion) -> Worst:
    """Force in [N] between robot and subject at the end, where the subject had to be let go."""
    if not motion.expects_release or motion.subject is None:
        return Worst()
    late = motion.time[-1] - 0.1
    subject = motion.subject

    def gripping(a: str, b: str) -> bool:
        return subject in (a, b) and bool({a, b} & _ROBOT)

    return _worst_contact(motion, gripping, late)


def restless(motion: TwinMotion, settle_time: float) -> Worst:
    """Largest speed in [m/s] of any object or handle over the last `settle_time` [s], measured over 20 ms."""
    span = _window(motion, SPEED_WINDOW)
    first = int(np.searchsorted(motion.time, motion.time[-1] - settle_time))
    worst = Worst()
    places = {name: poses[:, :3, 3] for name, poses in motion.objects.items()} | motion.handles
    for name, points in places.items():
        p = points[first:]
        if len(p) <= span:
            continue
        speed = np.linalg.norm(p[span:] - p[:-span], axis=1) / (motion.time[first + span] - motion.time[first])
        i = int(np.argmax(speed))
        if speed[i] > worst.value:
            worst = Worst(float(speed[i]), float(motion.time[first + i]), (name,))
    return worst


def _window(motion: TwinMotion, seconds: float) -> int:
    step = float(motion.time[1] - motion.time[0]) if len(motion.time) > 1 else seconds
    return max(1, round(seconds / step))


def _worst_contact(motion: TwinMotion, counts: Callable[[str, str], bool], since: float = -np.inf) -> Worst:
    """Largest force over the contacts that count; forces of one pair of bodies at one time add up."""
    c = motion.contacts
    counted = np.array([counts(*pair) for pair in c.pairs], bool)
    if not counted.any():
        return Worst()
    rows = np.flatnonzero(counted[c.pair] & (motion.time[c.step] >= since))
    if not len(rows):
        return Worst()
    keys, key = np.unique(c.step[rows] * len(c.pairs) + c.pair[rows], return_inverse=True)
    sums = np.bincount(key, c.force[rows])
    worst = int(np.argmax(sums))
    step, pair = divmod(int(keys[worst]), len(c.pairs))
    return Worst(float(sums[worst]), float(motion.time[step]), c.pairs[pair])


def _worst_unnamed(motion: TwinMotion, measure: Callable[[np.ndarray], np.ndarray]) -> Worst:
    worst = Worst()
    for name, poses in motion.objects.items():
        if name in motion.named:
            continue
        values = measure(poses)
        i = int(np.argmax(values))
        if values[i] > worst.value:
            worst = Worst(float(values[i]), float(motion.time[i]), (name,))
    return worst
