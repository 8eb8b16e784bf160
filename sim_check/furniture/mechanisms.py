"""Levers and sprung weight plates. That they may work a lock is the cell's secret, not theirs."""

import numpy as np

from control.twin_model import Handle
from perception.catalogue.catalogue import builtin_catalogue
from sim_check.cells.furniture_config import LeverConfig, WeightPlateConfig
from sim_check.furniture.model import FurnitureModel, MovingPart, box, rod

GRAVITY = 9.81  # [m/s^2]
# A plate is pressed down by this share of its travel by its rated weight, and lifts off its upper end at that share of
# the weight: whatever is a good deal lighter does not move it at all.
RELEASE_SHARE, LIGHT_SHARE = 0.8, 0.6
_POST = 0.04  # thickness of a lever's post
_CLEAR = 0.008  # between post and rod
ALUMINIUM = 2700.0  # density in [kg/m^3]


def build_lever(name: str, config: LeverConfig) -> FurnitureModel:
    """A post with a rod in front of it, upright at fraction 0, pointing to the front at the end of its range."""
    top = config.pivot_height + config.rod_length
    reach = 2 * (config.knob_radius + _CLEAR)  # depth that the rod and knob take in front of the post
    extents = np.array([_POST + reach, _POST + 0.03, top])
    x, y, z = extents / 2
    # The post ends below the knob, so that fingers find nothing behind it.
    post = box((reach - x, -_POST / 2, -z), (x, _POST / 2, config.pivot_height + 0.025 - z), "dark")
    foot = box((0.005 - x, -y, -z), (x, y, 0.012 - z), "dark")
    length, knob, radius = config.rod_length, config.knob_length, config.knob_radius
    anchor = np.array([radius + _CLEAR - x, 0.0, config.pivot_height - z])
    boards = (
        rod((0, 0, 0), (0, 0, length - knob), config.rod_radius, "metal"),
        rod((0, 0, length - knob + radius), (0, 0, length - radius), radius, "accent"),
    )
    volume = sum(b.solid.volume for b in boards)
    handle = Handle(
        body=config.part_names(name)[0],
        shape="capsule",
        centre=np.array([0.0, 0.0, length - knob / 2]),
        axis=np.array([0.0, 0.0, 1.0]),
        outward=np.array([-1.0, 0.0, 0.0]),
        half_length=knob / 2 - radius / 2,
        half_width=radius,
        half_depth=radius,
        clearance=np.inf,
    )
    part = MovingPart(
        name=config.part_names(name)[0],
        kind="hinge",
        anchor=anchor,
        axis=np.array([0.0, -1.0, 0.0]),
        opened=config.lever_range,
        boards=boards,
        mass=ALUMINIUM * volume,
        friction=config.friction,
        damping=config.damping,
        handle=handle,
    )
    rgb = builtin_catalogue().paints[config.colour]
    return FurnitureModel(name, config.kind, extents, (post, foot), (part,), (), rgb, False)


def build_weight_plate(name: str, config: WeightPlateConfig) -> FurnitureModel:
    """A plate above a tray.

    With rated weight m and travel t:

    preload = LIGHT_SHARE m g        stiffness = (1 - LIGHT_SHARE) m g / (RELEASE_SHARE t)
    """
    half = config.width / 2
    extents = np.array([config.width, config.width, config.height])
    z = config.height / 2
    thickness = config.height - config.travel - 0.006
    tray = box((-half, -half, -z), (half, half, -z + 0.004), "dark")
    plate = box((-half, -half, -min(thickness, 0.01)), (half, half, 0.0), "accent")
    weight = config.mass * GRAVITY
    part = MovingPart(
        name=config.part_names(name)[0],
        kind="slide",
        anchor=np.array([0.0, 0.0, z]),
        axis=np.array([0.0, 0.0, -1.0]),
        opened=config.travel,
        boards=(plate,),
        mass=0.05,
        friction=0.0,
        damping=8.0,
        stiffness=(1 - LIGHT_SHARE) * weight / (RELEASE_SHARE * config.travel),
        preload=LIGHT_SHARE * weight,
    )
    rgb = builtin_catalogue().paints[config.colour]
    return FurnitureModel(name, config.kind, extents, (tray,), (part,), (), rgb, False)
