"""Estimates for tests of the twin: the truth of a simulated world, or made up by hand."""

import numpy as np

from perception.estimates import ObjectEstimate, SceneEstimate, Shape

_SHAPES: dict[str, Shape] = {"box": "box", "cylinder": "cylinder", "sphere": "sphere", "ellipsoid": "sphere"}


def estimate(name, position, extents, shape: Shape = "box", yaw=0.0, std=0.003):
    """One upright object as perceived."""
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    pose[:3, 3] = position
    return ObjectEstimate(
        name=name,
        phrase=name.replace("_", " "),
        world_T_object=pose,
        extents=np.array(extents, float),
        shape=shape,
        position_std=np.full(3, std),
        yaw_std=0.03 if shape == "box" else np.inf,
        score=0.9,
        stamp=1.0,
    )


def scene(*objects, table=0.0):
    """A scene of these objects."""
    return SceneEstimate(objects=objects, unseen=(), support_height=table, stamp=1.0, source="made up")


def exact_scene(world):
    """What a perfect perception would say of a world."""
    objects = []
    for name in world.object_names:
        thing, pose = world.objects[name], world.object_pose(name)
        shape: Shape = "cylinder" if thing.container else _SHAPES[thing.solids[0].kind]
        yaw = np.arctan2(pose[1, 0], pose[0, 0])
        objects.append(estimate(name, pose[:3, 3], thing.extents, shape, yaw))
    return scene(*objects)
