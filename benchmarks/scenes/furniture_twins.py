"""Twins with furniture: what a good look at it would give."""

from dataclasses import replace
from functools import cache

import numpy as np

from benchmarks.scenes.estimates import estimate, scene
from benchmarks.scenes.tabletop_twins import carrying
from control.robot.limits import REST_Q
from control.twin_model import TwinModel
from perception.estimates import ObjectEstimate
from sim_check.cells.furniture_config import CabinetConfig, FurnitureConfig, LeverConfig
from sim_check.cells.loading import load_cell
from sim_check.furniture.build import furniture_model
from sim_check.twin.twin import build_twin

CABINET = CabinetConfig(kind="cabinet")
SLIDING = CabinetConfig(kind="cabinet", opening="sliding")
LEVER = LeverConfig(kind="lever")


def furnished(
    name: str, config: FurnitureConfig, x: float, y: float, yaw: float, fractions, *things, gripper: str = "panda_hand"
) -> TwinModel:
    """A twin of one piece of furniture with the middle of its front at (x, y) [m], and of loose things."""
    extents = furniture_model(name, config).extents
    centre = np.array([x, y]) + np.array([np.cos(yaw), np.sin(yaw)]) * extents[0] / 2
    seen: ObjectEstimate = estimate(name, (*centre, extents[2] / 2), extents, yaw=yaw)
    cell = carrying(load_cell("cubes"), gripper).model_copy(update={"furniture": {name: config}})
    whole = scene(replace(seen, joint_fractions=fractions), *things)
    return build_twin(cell, whole, np.array(REST_Q), cell.robot.gripper_model.opening)


@cache
def cabinet(
    x: float = 0.62,
    y: float = 0.0,
    left: float = 0.0,
    right: float = 0.0,
    yaw: float = 0.0,
    gripper: str = "panda_hand",
) -> TwinModel:
    """A cabinet with two hinged doors."""
    fractions = {"cabinet_left_door": left, "cabinet_right_door": right}
    return furnished("cabinet", CABINET, x, y, yaw, fractions, gripper=gripper)


@cache
def sliding(x: float = 0.62, y: float = 0.0, opened: float = 0.0, yaw: float = 0.0) -> TwinModel:
    """A cabinet with a sliding door."""
    return furnished("cabinet", SLIDING, x, y, yaw, {"cabinet_door": opened})


@cache
def lever(
    x: float = 0.50, y: float = 0.0, opened: float = 0.0, yaw: float = 0.0, gripper: str = "panda_hand"
) -> TwinModel:
    """A lever on a post."""
    return furnished("lever", LEVER, x, y, yaw, {"lever_rod": opened}, gripper=gripper)


def barred(x: float = 0.62, y: float = 0.0, wrong: float = 0.0) -> TwinModel:
    """A cabinet whose handles hold a bar, perceived `wrong` [m] off towards the robot; a cube stands aside."""
    bar = estimate("bar", (x - 0.0395 - wrong, y, 0.296), (0.28, 0.018, 0.02), yaw=np.pi / 2)
    cube = estimate("cube", (0.38, 0.0, 0.025), (0.05, 0.05, 0.05))
    return furnished("cabinet", CABINET, x, y, 0.0, {}, bar, cube)


def with_cube(left: float, right: float, x: float = 0.62, cube: tuple[float, float] = (0.38, 0.0)) -> TwinModel:
    """A cabinet with its doors at these fractions, and a cube in front of it."""
    thing = estimate("cube", (*cube, 0.025), (0.05, 0.05, 0.05), yaw=0.2)
    return furnished("cabinet", CABINET, x, 0.0, 0.0, {"cabinet_left_door": left, "cabinet_right_door": right}, thing)
