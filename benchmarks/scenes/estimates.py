"""Estimates without perception: from the truth of a simulated world, with errors if wanted, or made up by hand."""

from dataclasses import replace

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


def seen_in(world, name):
    """What a perfect perception would say of one object or piece of furniture of a world."""
    pose = world.object_pose(name)
    yaw = np.arctan2(pose[1, 0], pose[0, 0])
    if name in world.furniture:
        thing = world.furniture[name]
        fractions = {j.name: world.joint_fraction(j.name) for j in thing.joints}
        return replace(estimate(name, pose[:3, 3], thing.extents, "box", yaw), joint_fractions=fractions)
    thing = world.objects[name]
    shape: Shape = "cylinder" if thing.container else _SHAPES[thing.solids[0].kind]
    if thing.handle is not None:
        shape = "box"  # a kettle has a direction
    return estimate(name, pose[:3, 3], thing.extents, shape, yaw)


def exact_scene(world, without=()):
    """What a perfect perception would say of a world.

    Args:
        world: The truth; so this is for tests and benchmarks alone.
        without: Names of things that are out of sight.
    """
    return scene(*(seen_in(world, n) for n in (*world.object_names, *world.furniture_names) if n not in without))


def noisy_scene(world, rng, position=0.005, yaw_deg=2.0, fraction=0.01, without=()):
    """What an imperfect perception might say; see `with_errors`.

    Args:
        world: The truth; so this is for tests and benchmarks alone.
        rng: Source of randomness.
        position: Spread along each of the world's axes in [m].
        yaw_deg: Spread of yaws in [degrees].
        fraction: Spread of joint fractions.
        without: Names of things that are out of sight.
    """
    return with_errors(exact_scene(world, without), rng, position, yaw_deg, fraction)


def with_errors(seen, rng, position=0.005, yaw_deg=2.0, fraction=0.01, by_size=False):
    """A scene with normal errors, cut at twice their spread.

    Args:
        seen: What a perfect perception would say.
        rng: Source of randomness.
        position: Spread along each of the world's axes in [m].
        yaw_deg: Spread of yaws in [degrees].
        fraction: Spread of joint fractions, which stay within 0 and 1.
        by_size: Whether large things' yaws err less: as position errors at the ends of their longest level side turn
            them, `yaw_deg` at most.
    """

    def error(spread, count=None):
        return spread * np.clip(rng.standard_normal(count), -2, 2)

    objects = []
    for e in seen.objects:
        spread = np.deg2rad(yaw_deg)
        if by_size:
            spread = min(spread, position / (np.max(e.extents[:2]) / 2))
        pose, yaw = np.array(e.world_T_object), error(spread)
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        pose[:2, :3] = turn @ pose[:2, :3]
        pose[:3, 3] += error(position, 3)
        fractions = {n: float(np.clip(f + error(fraction), 0, 1)) for n, f in e.joint_fractions.items()}
        objects.append(
            replace(e, world_T_object=pose, position_std=np.full(3, max(position, 0.001)), joint_fractions=fractions)
        )
    return scene(*objects)
