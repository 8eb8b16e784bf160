"""Which part of the space that a motion sweeps nobody has seen.

Robot and held object are known by points in their collision bodies, at most `SPACING` apart, looked at every `EVERY`
seconds; a voxel is swept when such a point lies in it. With V the swept voxels:

    hidden = |{v in V: hidden}| / |V|,   overhead = |{v in V: overhead}| / |V|

What hides nothing counts as known: the robot where it stands at the start, the table, and everything in the twin.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from control.safety.certificate import CheckResult
from control.safety.limits import SafetyLimits
from control.safety.residuals import HeldSpan
from control.seen_volume import HIDDEN, OVERHEAD, SeenVolume
from control.twin_model import ARM_BODIES, FINGER_BODIES, HAND_BODY

SPACING = 0.025  # [m] between points of a body: with voxels of 20 mm a body at rest leaves one in ten out
EVERY = 0.05  # [s]: a hand at 0.5 m/s moves 25 mm


UNIT = "of the way"


@dataclass(frozen=True)
class Patch:
    """Space that hangs together.

    Attributes:
        low, high: Corners of the box around it in the world in [m], shape (3,).
        litres: Its volume.
    """

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    litres: float

    @property
    def centre(self) -> np.ndarray:
        """Middle of the box in the world in [m], shape (3,)."""
        return (self.low + self.high) / 2


@dataclass(frozen=True)
class SweptUnseen:
    """What of a motion's way nobody has seen.

    Attributes:
        hidden: Share of the swept volume that nobody saw and where something that stands could be, 0..1.
        overhead: Share that nobody saw above space that was seen to be free, 0..1.
        litres: The swept volume.
        patch: The largest part of the hidden share that hangs together, or None.
        at: When the motion first enters it, in [s].
        bodies: Parts of the robot, and what it holds, that sweep hidden space.
        points: Middles of the hidden voxels that are swept in the world in [m], shape (n, 3).
        above: The same of those that are overhead, shape (m, 3).
    """

    hidden: float
    overhead: float
    litres: float
    patch: Patch | None
    at: float | None
    bodies: tuple[str, ...]
    points: NDArray[np.float64]
    above: NDArray[np.float64]

    @property
    def record(self) -> dict[str, object]:
        """For the log of a run."""
        patch = self.patch and {"centre": self.patch.centre, "size": self.patch.high - self.patch.low}
        shares = {"hidden": self.hidden, "overhead": self.overhead, "litres": self.litres}
        return {**shares, "bodies": self.bodies, "at": self.at, "largest": patch}

    def checks(self, safety: SafetyLimits) -> tuple[CheckResult, CheckResult]:
        """Both shares against the limits, which hold where the cell refuses what nobody saw; else any share passes."""
        refuses = safety.unseen == "refuse"
        most = (safety.unseen_volume, safety.unseen_overhead) if refuses else (1.0, 1.0)
        return (
            CheckResult("unseen_volume", self.hidden, most[0], UNIT, self.hidden <= most[0], self.at, self.bodies),
            CheckResult("unseen_overhead", self.overhead, most[1], UNIT, self.overhead <= most[1]),
        )


def unseen_on_the_way(
    seen: SeenVolume, model: mujoco.MjModel, qpos: np.ndarray, times: np.ndarray, held: Sequence[HeldSpan] = ()
) -> SweptUnseen:
    """What of a motion's way nobody has seen.

    Args:
        seen: What was seen.
        model: Of a twin.
        qpos: The motion's configurations in this model, shape (n, nq).
        times: Of the rows in [s], shape (n,), evenly spaced.
        held: What is in the hand and when, by row.
    """
    stride = max(1, round(EVERY / float(times[1] - times[0]))) if len(times) > 1 else 1
    rows = np.unique(np.append(np.arange(0, len(times), stride), len(times) - 1))
    positions, turns = _poses(model, qpos[rows])
    spans = {b: slice(0, len(rows)) for b in (*ARM_BODIES[1:], HAND_BODY, *FINGER_BODIES)}
    spans |= {s.name: slice(*np.searchsorted(rows, (s.start, s.stop))) for s in held}
    first = np.full(seen.voxels, len(rows), np.int32)  # row at which each voxel is first swept
    bodies: list[str] = []
    for name, span in spans.items():
        hides = False
        for geom in _geoms(model, name):
            points = _points(model, geom)
            # The latest row first, so that the earliest is written last.
            at = np.stack([turns[span, geom, a] @ points.T + positions[span, geom, a, None] for a in range(3)])
            index = seen.index(at[:, ::-1].reshape(3, -1))
            row = np.repeat(np.arange(len(rows), dtype=np.int32)[span][::-1], len(points))
            first[index] = np.minimum(first[index], row)
            hides = hides or bool((seen.states(index) == HIDDEN).any())
        if hides:
            bodies.append(name)
    swept = np.flatnonzero(first < len(rows))
    states = seen.states(swept)
    hidden = swept[states == HIDDEN]
    patch, at = _largest(seen, hidden, first)
    count = max(1, len(swept))
    return SweptUnseen(
        hidden=len(hidden) / count,
        overhead=float(np.count_nonzero(states == OVERHEAD) / count),
        litres=len(swept) * seen.step**3 * 1e3,
        patch=patch,
        at=None if at is None else float(times[rows[at]]),
        bodies=tuple(bodies),
        points=seen.middles(hidden),
        above=seen.middles(swept[states == OVERHEAD]),
    )


def _geoms(model: mujoco.MjModel, body: str) -> list[int]:
    """Geoms of a body that can touch anything."""
    own = np.flatnonzero(model.geom_bodyid == model.body(body).id)
    return [int(g) for g in own if model.geom_contype[g] or model.geom_conaffinity[g]]


def _poses(model: mujoco.MjModel, qpos: np.ndarray) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Positions in [m], shape (n, geoms, 3), and rotations, shape (n, geoms, 3, 3), of all geoms."""
    data = mujoco.MjData(model)
    positions = np.empty((len(qpos), model.ngeom, 3), np.float32)
    turns = np.empty((len(qpos), model.ngeom, 9), np.float32)
    for k, row in enumerate(qpos):
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        positions[k], turns[k] = data.geom_xpos, data.geom_xmat
    return positions, turns.reshape(len(qpos), -1, 3, 3)


def _points(model: mujoco.MjModel, geom: int) -> NDArray[np.float32]:
    """Points in a geom, in its own frame in [m], at most `SPACING` apart, shape (k, 3)."""
    middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    axes = [(np.arange(n) + 0.5) * 2 * h / n - h for h in half for n in [max(1, int(np.ceil(2 * h / SPACING)))]]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3) + middle
    kind, size = model.geom_type[geom], model.geom_size[geom]
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        along = points[:, 2] - np.clip(points[:, 2], -size[1], size[1])
        points = points[points[:, 0] ** 2 + points[:, 1] ** 2 + along**2 <= size[0] ** 2]
    elif kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        points = points[points[:, 0] ** 2 + points[:, 1] ** 2 <= size[0] ** 2]
    elif kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        points = points[np.sum((points / half) ** 2, axis=1) <= 1.0]
    return points.astype(np.float32)


def _largest(seen: SeenVolume, hidden: np.ndarray, first: np.ndarray) -> tuple[Patch | None, int | None]:
    """The largest connected part of some voxels, and the row at which it is first swept."""
    if not len(hidden):
        return None, None
    grid = seen.grid(hidden)
    cells = np.argwhere(grid)
    low, high = cells.min(axis=0), cells.max(axis=0) + 1
    box = np.s_[low[0] : high[0], low[1] : high[1], low[2] : high[2]]
    labels: np.ndarray = ndimage.label(grid[box])[0]  # type: ignore[index]
    own = labels[grid[box]]
    mine = own == np.argmax(np.bincount(own))
    low, high = seen.corner(cells[mine].min(axis=0)), seen.corner(cells[mine].max(axis=0) + 1)
    litres = float(np.count_nonzero(mine) * seen.step**3 * 1e3)
    return Patch(low, high, litres), int(first[hidden[mine]].min())
