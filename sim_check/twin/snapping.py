"""Snapping a thing that was perceived in or on the fittings of furniture to the nearest pose in which it can rest.

A bar behind two handles has millimetres of room, less than perception errs by: as perceived it would lie inside a door
or hang in the air. So poses around the perceived one are tried, nearest first: moved in the plane, turned parallel to
the furniture, set down on what is below. Those that touch nothing but what carries them are simulated for a moment;
the first in which the thing stays is taken. The furniture counts as known, the thing's size too.
"""

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from sim_check.furniture.mjcf import add_furniture, set_fractions
from sim_check.models.scene_mjcf import add_object, pose_of, quat_of
from sim_check.objects.library import ObjectModel
from sim_check.twin.placed import Fixed, Standing

FURTHEST = 0.036  # along each axis in [m]
GRID = 0.004  # [m]
TURN = np.deg2rad(20.0)  # a thing that is nearly parallel to the furniture may be meant to be
TURN_COST = 0.1  # a turn by 1 rad counts like this many [m]
_AIR = 2e-4  # under the thing, in [m]
_OVERLAP = 1e-4  # [m]
_MOMENT = 0.4  # simulated time in [s]
_DRIFT = 0.004  # [m] that a thing may move meanwhile
_TILT = 0.1  # [rad] that it may tilt meanwhile
_LOOK = 0.02  # [s] between looks at whether it has moved; most that falls is given up at the first of them
_TRIALS = 500  # poses that are simulated


def snap(thing: ObjectModel, pose: np.ndarray, furniture: Sequence[Fixed], heights: Sequence[float]) -> Standing | None:
    """The nearest pose in which a thing rests, or None.

    Args:
        thing: What it is, in its perceived size.
        pose: As perceived, upright, shape (4, 4).
        furniture: Where furniture stands, and how far it is open.
        heights: Heights in the world in [m] of what might carry it.
    """
    scratch = _Scratch(thing, furniture)
    options = []
    steps = np.arange(-FURTHEST, FURTHEST + GRID / 2, GRID)
    for turn in _turns(pose, furniture):
        for height in heights:
            up = height + _AIR - (pose[2, 3] - thing.extents[2] / 2)
            if abs(up) > FURTHEST:
                continue
            for dx in steps:
                for dy in steps:
                    cost = float(np.sqrt(dx**2 + dy**2 + up**2)) + TURN_COST * abs(turn)
                    options.append((cost, dx, dy, up, turn))
    trials = 0
    for _, dx, dy, up, turn in sorted(options):
        candidate = pose.copy()
        candidate[:3, :3] = (
            pose_of(np.zeros(3), np.array([np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2)]))[:3, :3] @ pose[:3, :3]
        )
        candidate[:3, 3] += [dx, dy, up]
        if scratch.overlaps(candidate):
            continue
        if scratch.stays(candidate):
            return Standing(thing, candidate)
        trials += 1
        if trials == _TRIALS:
            return None
    return None


def _turns(pose: np.ndarray, furniture: Sequence[Fixed]) -> list[float]:
    """Turns about z in [rad] that are tried: none, and into line with furniture."""
    turns = [0.0]
    for f in furniture:
        between = np.arctan2(f.pose[1, 0], f.pose[0, 0]) - np.arctan2(pose[1, 0], pose[0, 0])
        quarter = float((between + np.pi / 4) % (np.pi / 2) - np.pi / 4)
        if abs(quarter) < TURN:
            turns.append(quarter)
    return turns


class _Scratch:
    """A model of the furniture and the thing alone."""

    def __init__(self, thing: ObjectModel, furniture: Sequence[Fixed]) -> None:
        spec = mujoco.MjSpec()
        spec.compiler.degree = False
        spec.option.timestep = 0.004
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        for f in furniture:
            add_furniture(spec, f.thing, f.pose, pictures=False)
        add_object(spec, replace(thing, movable=True), np.eye(4), pictures=False)
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        for f in furniture:
            set_fractions(self._model, self._data.qpos, f.thing, f.fractions)
        self._start = self._data.qpos.copy()
        self._at = int(self._model.joint(thing.name).qposadr[0])
        self._body = self._model.body(thing.name).id

    def _put(self, pose: np.ndarray) -> None:
        self._data.qpos[:] = self._start
        self._data.qpos[self._at : self._at + 3] = pose[:3, 3]
        self._data.qpos[self._at + 3 : self._at + 7] = quat_of(pose)
        self._data.qvel[:] = 0.0

    def overlaps(self, pose: np.ndarray, depth: float = _OVERLAP) -> bool:
        """Whether the thing is deeper than `depth` [m] inside furniture."""
        self._put(pose)
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_collision(self._model, self._data)
        contacts = self._data.contact
        for i in range(self._data.ncon):
            bodies = self._model.geom_bodyid[contacts.geom[i]]
            if self._body in bodies and contacts.dist[i] < -depth:
                return True
        return False

    def stays(self, pose: np.ndarray) -> bool:
        """Whether the thing is still there after a moment."""
        self._put(pose)
        mujoco.mj_forward(self._model, self._data)
        look = round(_LOOK / self._model.opt.timestep)
        for _ in range(round(_MOMENT / _LOOK)):
            mujoco.mj_step(self._model, self._data, nstep=look)
            moved = np.linalg.norm(self._data.xpos[self._body] - pose[:3, 3])
            tilted = np.arccos(np.clip(self._data.xmat[self._body].reshape(3, 3)[:, 2] @ pose[:3, 2], -1.0, 1.0))
            if not (moved < _DRIFT and tilted < _TILT):
                return False
        return True
