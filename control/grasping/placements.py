"""Where an object could be put: poses of the object that would meet a reward term, from sizes and places alone."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from control.grasping.door_swings import Swing
from control.safety.limits import SafetyLimits
from control.tasks.posed_object import EDGE_MARGIN, Inside, PosedObject

RELEASE_GAP = 0.004  # [m] between the object's underside and what will carry it when the fingers open
TURNS = 12  # turns about the vertical that are offered
DROPS = (0.0, 0.015, 0.03, 0.045)  # [m] above the lowest place in a container, for hands that cannot reach down into it
QUARTERS = np.array([0.0, np.pi / 2, -np.pi / 2])
DEPTHS = (0.12, 0.09, 0.15)  # [m] behind an opening that are offered, for the object's centre
WALL_GAP = 0.03  # [m] between an object put into furniture and its walls, for the fingers
AHEAD = np.radians(65.0)  # to either side of the arm's front, where cameras look and the hand sees
BESIDE = 6  # places beside the centre that are offered


@dataclass(frozen=True)
class Placement:
    """A pose in which the object is let go.

    Attributes:
        world_T_object: Pose at release, shape (4, 4).
        preference: Lower is better: metres from the best place.
        text: For people.
    """

    world_T_object: NDArray[np.float64]
    preference: float
    text: str


def turned(world_T_object: np.ndarray, angle: float, position: np.ndarray) -> np.ndarray:
    """The same attitude turned by `angle` [rad] about the world's z, at another position; shape (4, 4)."""
    c, s = np.cos(angle), np.sin(angle)
    out = np.eye(4)
    out[:3, :3] = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ world_T_object[:3, :3]
    out[:3, 3] = position
    return out


def on_or_in(a: PosedObject, b: PosedObject, rng: np.random.Generator) -> list[Placement]:
    """Poses of `a` on top of `b`, or in `b` when it is a container or has an inside; the middle first."""
    if b.inside is not None:
        return _behind_opening(a, b, b.inside, rng)
    return _inside(a, b, rng) if b.container else _on_top(a, b, rng)


def away_from(
    a: PosedObject,
    other: np.ndarray,
    distance: float,
    obstacles: list[PosedObject],
    safety: SafetyLimits,
    support_height: float,
    rng: np.random.Generator,
    count: int = 24,
    turns: np.ndarray = QUARTERS,
    swings: Sequence[Swing] = (),
    owner: str | None = None,
) -> list[Placement]:
    """Free places of `a` on the table at a horizontal `distance` [m] or more from `other`, nearest to `a` first.

    Places before the arm where it stands in no door's way are preferred to those in the way of other furniture's doors
    than `owner`'s, and these to the rest: things put beside or behind the arm are hard to see again.

    Args:
        a: Object to be moved, where it is now.
        other: Position to keep away from, shape (3,).
        distance: Horizontal distance to keep in [m].
        obstacles: Everything else that stands around.
        safety: For the workspace.
        support_height: Height of the table top in [m].
        rng: Source of randomness.
        count: Most spots to return.
        turns: Turns about the vertical at each spot in [rad], shape (n,), on top of the arm's own swing.
        swings: Where doors swing.
        owner: Furniture whose doors matter most, or None.
    """
    radius = float(np.hypot(*_level_sizes(a))) / 2
    low = np.asarray(safety.workspace_low)[:2] + radius
    high = np.asarray(safety.workspace_high)[:2] - radius
    spots = rng.uniform(low, high, (400, 2))
    # The base itself stands at the origin; things within its reach of 0.3 m cannot be handled with the hand down.
    ok = (np.linalg.norm(spots, axis=1) > 0.3) & (np.linalg.norm(spots, axis=1) < 0.75)
    ok &= np.linalg.norm(spots - np.asarray(other)[:2], axis=1) >= distance + 0.02
    for thing in obstacles:
        reach = float(np.hypot(*np.asarray(thing.extents)[:2])) / 2
        ok &= np.linalg.norm(spots - thing.position[:2], axis=1) >= reach + radius + 0.06
    spots = spots[ok]
    ahead = np.abs(np.arctan2(spots[:, 1], spots[:, 0])) <= AHEAD
    own = np.ones(len(spots), bool)
    free = np.ones(len(spots), bool)
    for swing in swings:
        missed = ~swing.reaches(spots, radius)
        free &= missed
        own &= missed | (swing.owner != owner)
    preferred = next((p for p in (ahead & free, ahead & own, own) if p.any()), None)
    spots = spots if preferred is None else spots[preferred]
    order = np.argsort(np.linalg.norm(spots - a.position[:2], axis=1))
    height = support_height + a.half_height + RELEASE_GAP
    out = []
    for i in order[:: max(1, len(order) // count)][:count]:
        position = np.array([*spots[i], height])
        # The hand turns with the arm, so the object may as well.
        swing = np.arctan2(position[1], position[0]) - np.arctan2(a.position[1], a.position[0])
        far = float(np.linalg.norm(spots[i] - a.position[:2]))
        for turn in (swing + turns[0], 0.0, *(swing + turns[1:])):
            out.append(Placement(turned(a.pose, float(turn), position), far, f"{far:.2f} m away"))
    return out


def _level_sizes(a: PosedObject) -> np.ndarray:
    """Full sizes along the object's two most level axes in [m], shape (2,)."""
    upright = int(np.argmax(np.abs(a.pose[2, :3])))
    return np.delete(np.asarray(a.extents, float), upright)


def _turns(a: PosedObject, position: np.ndarray) -> np.ndarray:
    """Turns about the vertical, the one that the arm would bring along first."""
    swing = np.arctan2(position[1], position[0]) - np.arctan2(a.position[1], a.position[0])
    steps = np.arange(TURNS) * 2 * np.pi / TURNS
    return swing + np.where(steps > np.pi, steps - 2 * np.pi, steps)


def _on_top(a: PosedObject, b: PosedObject, rng: np.random.Generator) -> list[Placement]:
    """On a flat top: with its whole base carried where b is larger, over b's middle where it is smaller."""
    base = float(np.min(_level_sizes(a))) / 2
    room = np.maximum(np.asarray(b.extents)[:2] / 2 - max(base, EDGE_MARGIN), 0.0)
    height = b.top + a.half_height + RELEASE_GAP
    axes = b.pose[:2, :2]
    offsets = (
        [np.zeros(2)]
        + [rng.uniform(-room, room) for _ in range(BESIDE)]
        + [np.array([i, j]) * room for i in (-1, 1) for j in (-1, 1) if room.max() > base / 2]
    )
    out = []
    for offset in offsets:
        if b.shape != "box" and np.linalg.norm(offset) > room.max():
            continue
        position = np.array([*(b.position[:2] + axes @ offset), height])
        aside = float(np.linalg.norm(offset))
        out += [
            Placement(turned(a.pose, float(turn), position), aside, f"on {b.name}, {aside * 1e3:.0f} mm off its middle")
            for turn in _turns(a, position)
        ]
    return out


def _behind_opening(a: PosedObject, b: PosedObject, inside: Inside, rng: np.random.Generator) -> list[Placement]:
    """On the floor of furniture, a hand's depth behind its opening, all along it; the middle first."""
    along = int(np.argmax(np.abs(inside.outward)))
    across = 1 - along
    edge = inside.low[along] if inside.outward[along] < 0 else inside.high[along]
    radius = float(np.hypot(*_level_sizes(a))) / 2
    middle = (inside.low[across] + inside.high[across]) / 2
    room = max(0.0, (inside.high[across] - inside.low[across]) / 2 - radius - WALL_GAP)
    height = float(b.position[2]) + float(inside.low[2]) + a.half_height + RELEASE_GAP
    deepest = max(0.0, inside.high[along] - inside.low[along] - radius - WALL_GAP)
    out = []
    for depth in DEPTHS:
        if depth > deepest or depth < radius:
            continue
        for offset in (0.0, *rng.uniform(-room, room, BESIDE)):
            local = np.zeros(3)
            local[along] = edge - depth * inside.outward[along]
            local[across] = middle + offset
            position = np.array([*(b.position + b.pose[:3, :3] @ local)[:2], height])
            aside = float(abs(offset)) / 3 + abs(depth - DEPTHS[0])
            text = f"in {b.name}, {depth * 1e3:.0f} mm behind its opening"
            out += [Placement(turned(a.pose, float(t), position), aside, text) for t in _turns(a, position)]
    return out


def _inside(a: PosedObject, b: PosedObject, rng: np.random.Generator) -> list[Placement]:
    """In a container: as low as its floor, or let go higher up where hand and rim would meet."""
    radius = float(np.min(_level_sizes(a))) / 2
    room = max(0.0, b.inner_radius - radius - 0.005)
    offsets = [np.zeros(2)]
    for _ in range(BESIDE):
        angle, r = rng.uniform(0, 2 * np.pi), room * np.sqrt(rng.uniform(0.1, 1.0))
        offsets.append(r * np.array([np.cos(angle), np.sin(angle)]))
    floor = b.bottom + b.inner_floor + a.half_height + RELEASE_GAP
    out = []
    for drop in DROPS:
        if floor + drop - a.half_height > b.top:
            continue
        for offset in offsets:
            position = np.array([*(b.position[:2] + offset), floor + drop])
            aside = float(np.linalg.norm(offset))
            out += [
                Placement(
                    turned(a.pose, float(turn), position), drop + aside, f"in {b.name}, dropped {drop * 1e3:.0f} mm"
                )
                for turn in _turns(a, position)
            ]
    return out
