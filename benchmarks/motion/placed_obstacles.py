"""Obstacles beside a motion, placed so that it comes exactly as near to them as is wanted.

Distances are computed here from the geometry of robot, held object and obstacle along the motion's states in the twin,
by MuJoCo's distance between two geoms and by nothing that the verdict measures with.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from benchmarks.motion.base_motions import Base
from benchmarks.scenes.estimates import estimate
from control.errors import StackError
from control.twin_model import ARM_BODIES, FINGER_BODIES, HAND_BODY, TCP_SITE, TwinModel

NAME = "obstacle"
TRIES = 45  # places that are tried
BESIDE = 0.03  # [m] beside the way of the tool centre point at which they may lie
UNDER_HAND = 0.05  # [m] that the obstacle's top may be above or below the tool centre point
ROUNDS = 6  # of correcting its height
EXACT = 1e-4  # [m]
FREE = 0.008  # [m] that it keeps from everything but robot and held object
FAR = 0.5  # [m] up to which distances are looked for
LOWEST, SLENDER = 0.03, 6.0  # least height in [m], most height over width
MOVING = (*ARM_BODIES[1:], HAND_BODY, *FINGER_BODIES)


@dataclass(frozen=True)
class Wanted:
    """How near the motion should come.

    Attributes:
        gap: Least distance in [m] beyond what is asked for, of any part; negative in overlap.
        arm, finger, held: Distance in [m] that is asked for, of arm and hand, of the fingers, and of a held object.
        width: Range of the obstacle's widths in [m].
        speed: Least level speed in [m/s] of the hand above it.
        height: Least height in [m].
    """

    gap: float
    arm: float = 0.0
    finger: float = 0.0
    held: float = 0.0
    width: tuple[float, float] = (0.04, 0.08)
    speed: float = 0.0
    height: float = LOWEST


def obstacle_below(base: Base, wanted: Wanted, rng: np.random.Generator) -> TwinModel | None:
    """A twin in which a box stands under the way, as high as the wanted gap demands; None where none fits."""
    model, data = base.twin.model, mujoco.MjData(base.twin.model)
    hand = np.empty((len(base.rollout.qpos), 3))
    for row in range(0, len(hand), 4):
        data.qpos[:] = base.rollout.qpos[row]
        mujoco.mj_kinematics(model, data)
        hand[row : row + 4] = data.site(TCP_SITE).xpos
    speed_there = np.linalg.norm(np.gradient(hand[::4, :2], 0.008, axis=0), axis=1)
    above = hand[::4, 2] - base.twin.support_height
    fits = (above > wanted.height - UNDER_HAND) & (above < SLENDER * wanted.width[1] + UNDER_HAND)
    places = np.flatnonzero((speed_there >= wanted.speed) & fits) * 4
    for _ in range(TRIES if len(places) else 0):
        x, y = hand[rng.choice(places), :2] + rng.uniform(-BESIDE, BESIDE, 2)
        width = rng.uniform(*wanted.width)
        found = _as_high_as(base, wanted, float(x), float(y), width)
        if found is not None:
            return found
    return None


def _as_high_as(base: Base, wanted: Wanted, x: float, y: float, width: float) -> TwinModel | None:
    height, table = LOWEST, base.twin.support_height
    twin = None
    for attempt in range(ROUNDS):
        thing = estimate(NAME, (x, y, table + height / 2), (width, width, height), std=0.001)
        try:
            twin = base.with_things(thing)
        except StackError:
            return None
        if attempt == 0 and not _stands_free(base, twin):
            return None
        gap = least_gap(base, twin, wanted)
        if abs(gap - wanted.gap) < EXACT:
            break
        height += gap - wanted.gap
        if not LOWEST <= height <= SLENDER * width:
            return None
    else:
        return None
    return twin if height >= wanted.height and _stands_free(base, twin) else None


def least_gap(base: Base, twin: TwinModel, wanted: Wanted) -> float:
    """Least distance of robot and held object from the obstacle, beyond what is asked for, along the motion in [m]."""
    coarse = np.arange(0, len(base.rollout.qpos), 10)
    gaps = _gaps(base, twin, wanted, coarse)
    nearest = coarse[np.argsort(gaps)[:8]]
    fine = np.unique(np.concatenate([np.arange(max(r - 10, 0), min(r + 11, len(base.rollout.qpos))) for r in nearest]))
    return float(min(gaps.min(), _gaps(base, twin, wanted, fine).min()))


def _gaps(base: Base, twin: TwinModel, wanted: Wanted, rows: np.ndarray) -> np.ndarray:
    model, data = twin.model, mujoco.MjData(twin.model)
    asked = {name: wanted.finger if name in FINGER_BODIES else wanted.arm for name in MOVING}
    moving = [(int(g), asked[model.body(int(model.geom_bodyid[g])).name]) for g in _geoms(model, MOVING)]
    (box,) = _geoms(model, (NAME,))
    out = np.empty(len(rows))
    segment = np.zeros(6)
    for k, (row, qpos) in enumerate(zip(rows, base.states_in(twin, rows), strict=True)):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        now = list(moving)
        for span in base.rollout.commands.held:
            if span.start <= row < span.stop:
                now += [(int(g), wanted.held) for g in _geoms(model, (span.name,))]
        out[k] = min(mujoco.mj_geomDistance(model, data, g, int(box), FAR, segment) - clear for g, clear in now)
    return out


def _stands_free(base: Base, twin: TwinModel) -> bool:
    """Whether the obstacle keeps away from everything else, wherever that is moved to."""
    model, data = twin.model, mujoco.MjData(twin.model)
    (box,) = _geoms(model, (NAME,))
    others = [
        g
        for g in range(model.ngeom)
        if g != box
        and (model.geom_contype[g] or model.geom_conaffinity[g])
        and model.body(int(model.geom_bodyid[g])).name not in ("table", *MOVING)
    ]
    rows = np.arange(0, len(base.rollout.qpos), 50)
    segment = np.zeros(6)
    for row, qpos in zip(rows, base.states_in(twin, rows), strict=True):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        carried = {s.name for s in base.rollout.commands.held if s.start <= row < s.stop}
        for g in others:
            if model.body(int(model.geom_bodyid[g])).name in carried:
                continue
            if mujoco.mj_geomDistance(model, data, g, int(box), FREE, segment) < FREE:
                return False
    return True


def _geoms(model: mujoco.MjModel, bodies: tuple[str, ...]) -> np.ndarray:
    """Geoms of some bodies that can touch anything."""
    ids = [model.body(name).id for name in bodies]
    return np.flatnonzero(np.isin(model.geom_bodyid, ids) & ((model.geom_contype | model.geom_conaffinity) != 0))
