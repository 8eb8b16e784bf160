"""Twins with furniture for tests of motions, composed by hand: what a good look at it would give."""

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np

from control.limits import REST_Q
from control.twin_model import ARM_JOINTS, FINGER_JOINTS, TwinModel, TwinObject
from sim_check.furniture import furniture_model
from sim_check.furniture_config import CabinetConfig, LeverConfig
from sim_check.furniture_mjcf import add_furniture, set_fractions
from sim_check.furniture_model import FurnitureModel
from sim_check.object_library import ObjectModel
from sim_check.panda_mjcf import panda_spec
from sim_check.scene_mjcf import add_object, add_table

STD = np.full(3, 0.003)


def standing(x: float, y: float, thing: FurnitureModel, yaw: float = 0.0) -> np.ndarray:
    """Pose (4, 4) of furniture on the table with the middle of its front at (x, y) [m]."""
    c, s = np.cos(yaw), np.sin(yaw)
    out = np.eye(4)
    out[:2, :2] = [[c, -s], [s, c]]
    out[:2, 3] = np.array([x, y]) + out[:2, 0] * thing.extents[0] / 2
    out[2, 3] = thing.extents[2] / 2
    return out


def twin_with(
    furniture: list[tuple[FurnitureModel, np.ndarray]],
    things: list[tuple[ObjectModel, np.ndarray]] = [],  # noqa: B006 - never changed
    fractions: dict[str, float] = {},  # noqa: B006
) -> TwinModel:
    """A twin with the arm at rest and the hand open; free things settle for 0.4 s."""
    spec = panda_spec(meshes=False)
    spec.option.timestep = 0.004
    add_table(spec, 0.0)
    for thing, pose in furniture:
        add_furniture(spec, thing, pose, pictures=False)
    for thing, pose in things:
        add_object(spec, thing, pose, pictures=False)
    model = spec.compile()
    qpos = model.qpos0.copy()
    for name, value in zip(ARM_JOINTS, REST_Q, strict=True):
        qpos[model.joint(name).qposadr[0]] = value
    for name in FINGER_JOINTS:
        qpos[model.joint(name).qposadr[0]] = 0.04
    for thing, _ in furniture:
        set_fractions(model, qpos, thing, fractions)
    objects = [TwinObject(f.name, "box", f.extents, False, False, 0.0, 0.0, STD, 0.03) for f, _ in furniture] + [
        TwinObject(t.name, "box", t.extents, t.movable, t.container, t.inner_floor, t.inner_radius, STD, 0.03)
        for t, _ in things
    ]
    twin = TwinModel(
        model,
        qpos,
        np.array(REST_Q),
        0.08,
        None,
        tuple(objects),
        0.0,
        1.0,
        joints=tuple(j for f, _ in furniture for j in f.joints),
        compartments=tuple(c for f, _ in furniture for c in f.compartments),
    )
    data = twin.start()
    for _ in range(100):
        mujoco.mj_step(model, data)
    settled = data.qpos.copy()
    for joint in (*ARM_JOINTS, *FINGER_JOINTS):
        at = model.joint(joint).qposadr[0]
        settled[at] = qpos[at]
    return replace(twin, qpos=settled)


@cache
def cabinet(x: float = 0.62, y: float = 0.0, left: float = 0.0, right: float = 0.0) -> TwinModel:
    """A cabinet with two hinged doors."""
    thing = furniture_model("cabinet", CabinetConfig(kind="cabinet"))
    return twin_with([(thing, standing(x, y, thing))], [], {"cabinet_left_door": left, "cabinet_right_door": right})


@cache
def sliding(x: float = 0.62, y: float = 0.0, opened: float = 0.0) -> TwinModel:
    """A cabinet with a sliding door."""
    thing = furniture_model("cabinet", CabinetConfig(kind="cabinet", opening="sliding"))
    return twin_with([(thing, standing(x, y, thing))], [], {"cabinet_door": opened})


@cache
def lever(x: float = 0.50, y: float = 0.0, opened: float = 0.0) -> TwinModel:
    """A lever on a post."""
    thing = furniture_model("lever", LeverConfig(kind="lever"))
    return twin_with([(thing, standing(x, y, thing))], [], {"lever_rod": opened})
