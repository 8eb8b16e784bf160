"""Where things stand, as a person measured and wrote it down: a scene without a camera.

It stands in a cell file under `poses`, or in a scene file of its own with the keys `table` and `poses`. Only the
validation of motions reads it: a run looks for itself. It is not the `simulation` block, which is a simulated cell's
truth and which nothing but that cell may read.
"""

import numpy as np

from control.errors import ConfigError
from perception.estimates import ObjectEstimate, SceneEstimate, Shape
from sim_check.cells.furniture_config import FurnitureConfig
from sim_check.cells.poses_config import PoseConfig
from sim_check.furniture.build import furniture_model
from sim_check.models.scene_mjcf import pose_of
from sim_check.objects.library import object_model

MEASURED = "written down by a person"


def fixed_scene(
    poses: dict[str, PoseConfig], furniture: dict[str, FurnitureConfig], table: float, stamp: float
) -> SceneEstimate:
    """What was written down, in the form in which perception speaks.

    Args:
        poses: What stands where.
        furniture: Furniture of the cell, which has its sizes there.
        table: Height of the table top in the world in [m].
        stamp: Time in [s] that the scene counts as seen at.

    Raises:
        ConfigError: A noun is unknown and has no sizes, a support or a joint does not exist; names the object.
    """
    solids = {name: _solid(name, pose, furniture) for name, pose in poses.items()}
    estimates = []
    for name, p in poses.items():
        extents, shape = solids[name]
        yaw = np.deg2rad(p.yaw_deg)
        middle = np.array([p.position[0], p.position[1], _height(name, poses, solids, table, ())])
        estimates.append(
            ObjectEstimate(
                name=name,
                phrase=name.replace("_", " "),
                world_T_object=pose_of(middle, np.array([np.cos(yaw / 2), 0.0, 0.0, np.sin(yaw / 2)])),
                extents=extents,
                shape=shape,
                position_std=np.full(3, 1e-3 * p.spread_mm),
                yaw_std=float(np.deg2rad(p.yaw_spread_deg)) if shape == "box" else np.inf,
                score=1.0,
                stamp=stamp,
                joint_fractions=dict(p.joints),
            )
        )
    return SceneEstimate(tuple(estimates), (), table, stamp, MEASURED)


def _solid(name: str, pose: PoseConfig, furniture: dict[str, FurnitureConfig]) -> tuple[np.ndarray, Shape]:
    """Full sizes in [m], shape (3,), and the solid that perception would fit."""
    if name in furniture:
        if pose.extents is not None or pose.shape is not None:
            raise ConfigError(f"poses.{name}: furniture has its sizes under `furniture`; leave out extents and shape")
        thing = furniture_model(name, furniture[name])
        joints = [j.name for j in thing.joints]
        for joint in pose.joints:
            if joint not in joints:
                raise ConfigError(f"poses.{name}: there is no joint '{joint}'; it has {joints or 'none'}")
        return thing.extents, "box"
    if pose.joints:
        raise ConfigError(f"poses.{name}: only furniture has joints; furniture here is {sorted(furniture) or 'none'}")
    try:
        model = object_model(name, None if pose.extents is None else np.asarray(pose.extents), pose.shape)
    except ConfigError as error:
        raise ConfigError(f"poses.{name}: {error}; or give both extents and shape") from error
    return model.extents, pose.shape or model.shape


def _height(
    name: str,
    poses: dict[str, PoseConfig],
    solids: dict[str, tuple[np.ndarray, Shape]],
    table: float,
    above: tuple[str, ...],
) -> float:
    """Height of a thing's middle in the world in [m]."""
    p = poses[name]
    if len(p.position) == 3:
        return float(p.position[2])
    half = float(solids[name][0][2]) / 2
    if p.stands_on is None:
        return table + half
    if p.stands_on not in poses:
        raise ConfigError(f"poses.{name}: stands_on names '{p.stands_on}', which has no pose; {sorted(poses)} have")
    if p.stands_on in (*above, name):
        raise ConfigError(f"poses.{name}: stands_on goes round in a circle: {' on '.join((*above, name, p.stands_on))}")
    support = _height(p.stands_on, poses, solids, table, (*above, name))
    return support + float(solids[p.stands_on][0][2]) / 2 + half
