"""How objects look to a camera: pictures without contacts, laid over the collision bodies.

A picture never reaches beyond its object's box, so that depth shows the true sizes.
"""

from collections.abc import Callable, Mapping

import mujoco
import numpy as np

from perception.catalogue.entries import VisualName
from sim_check.models.panda_mjcf import PICTURE_GROUP
from sim_check.objects.bowl import bowl_profile
from sim_check.objects.library import ObjectModel

_TURNS = 48  # facets of a surface of revolution
_STEM = (0.30, 0.20, 0.10)


def object_pictures(spec: mujoco.MjSpec, body: mujoco.MjsBody, thing: ObjectModel) -> None:
    """Add what cameras see of an object to its body."""
    material = f"{thing.name}_look"
    gloss = 0.5 if thing.rolls or thing.container else 0.15
    spec.add_material(name=material, rgba=[*thing.rgb, 1.0], specular=gloss, shininess=0.4)
    if thing.visual is not None:
        VISUALS[thing.visual](spec, body, thing, material)
    elif thing.container:
        _turned(spec, body, thing, _bowl_outline(thing), material)
    else:
        for solid in thing.solids:
            _show(
                body,
                type=getattr(mujoco.mjtGeom, f"mjGEOM_{solid.kind.upper()}"),
                size=[solid.half[0], solid.half[2], 0.0] if solid.kind in ("cylinder", "capsule") else solid.half,
                pos=solid.position,
                quat=solid.quat,
                material=material,
            )


def _show(body: mujoco.MjsBody, **geom) -> None:
    body.add_geom(group=PICTURE_GROUP, contype=0, conaffinity=0, mass=0.0, **geom)


def _boards(_spec: mujoco.MjSpec, body: mujoco.MjsBody, thing: ObjectModel, _material: str) -> None:
    """Boards on all sides with dark gaps between them."""
    half = thing.extents / 2
    gap = 0.0025  # depth of the gaps between boards in [m]
    dark, light = np.array(thing.rgb) * 0.55, np.array(thing.rgb)
    box = mujoco.mjtGeom.mjGEOM_BOX
    _show(body, type=box, size=half - gap, rgba=[*dark, 1.0])
    rows = 3
    pitch = 2 * half[2] / rows
    for i in range(rows):
        z = -half[2] + (i + 0.5) * pitch
        shade = light * (0.94 + 0.06 * (i % 2))
        for axis in (0, 1):
            size = half.copy()
            size[axis], size[2] = gap, pitch / 2 - 0.0012
            for side in (-1, 1):
                place = np.array([0.0, 0.0, z])
                place[axis] = side * (half[axis] - gap)
                _show(body, type=box, size=size, pos=place, rgba=[*shade, 1.0])
    boards = 4
    pitch = 2 * half[1] / boards
    for i in range(boards):
        place = np.array([0.0, -half[1] + (i + 0.5) * pitch, half[2] - gap])
        shade = light * (1.0 if i % 2 else 0.93)
        _show(body, type=box, size=[half[0], pitch / 2 - 0.001, gap], pos=place, rgba=[*shade, 1.0])


def _turned(spec: mujoco.MjSpec, body: mujoco.MjsBody, thing: ObjectModel, outline: np.ndarray, material: str) -> None:
    """A surface of revolution about z through an outline (radius, height in the object's frame), shape (n, 2).

    The outline runs so that the outside lies on its right hand when radius points right and height up.
    """
    angles = 2 * np.pi * np.arange(_TURNS) / _TURNS
    points = np.stack(
        [
            np.outer(outline[:, 0], np.cos(angles)),
            np.outer(outline[:, 0], np.sin(angles)),
            np.repeat(outline[:, 1:], _TURNS, axis=1),
        ],
        axis=-1,
    )
    here = np.arange(_TURNS)
    there = (here + 1) % _TURNS
    faces = []
    for row in range(len(outline) - 1):
        a, b = row * _TURNS + here, row * _TURNS + there
        c, d = a + _TURNS, b + _TURNS
        faces += [np.stack([a, b, d], axis=1), np.stack([a, d, c], axis=1)]
    spec.add_mesh(
        name=thing.name,
        uservert=points.reshape(-1).astype(np.float32),
        userface=np.concatenate(faces).reshape(-1).astype(np.int32),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        smoothnormal=True,
    )
    _show(body, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=thing.name, material=material)


def _bowl_outline(thing: ObjectModel) -> np.ndarray:
    """Under the foot, up the outside, over the rim, down the inside, over the inner floor."""
    low, high, inner_high, inner_low = bowl_profile(thing.extents)
    floor = thing.inner_floor
    share = (floor - inner_low[1]) / (inner_high[1] - inner_low[1])
    corner = inner_low + share * (inner_high - inner_low)
    foot = np.array([low[0], 0.0])
    tiny = 1e-4
    outline = np.array(
        [
            [tiny, 0.0],
            foot - [1e-3, 0.0],
            foot,
            low,
            high - 0.03 * (high - low),
            high,
            inner_high,
            inner_high - 0.03 * (inner_high - inner_low),
            corner,
            corner - [1e-3, 0.0],
            [tiny, floor],
        ]
    )
    outline[:, 1] -= thing.extents[2] / 2
    return outline


def _apple(spec: mujoco.MjSpec, body: mujoco.MjsBody, thing: ObjectModel, material: str) -> None:
    _turned(spec, body, thing, _apple_outline(thing.extents), material)
    _stem(body, thing)


def _apple_outline(extents: np.ndarray) -> np.ndarray:
    """A circle with a dimple at the top and a smaller one at the bottom."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 33)
    radius, height = extents[0] / 2 * np.cos(angle), extents[2] / 2 * np.sin(angle)
    share = radius / (extents[0] / 2)
    depth = np.where(angle > 0, 0.22, 0.08) * extents[2] / 2
    height -= np.sign(angle) * depth * np.exp(-((share / 0.28) ** 2))
    radius[[0, -1]] = 1e-4
    return np.stack([radius, height], axis=1)


def _stem(body: mujoco.MjsBody, thing: ObjectModel) -> None:
    half = thing.extents[2] / 2
    _show(
        body,
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[0.0, 0.0, 0.74 * half, 0.05 * half, 0.03 * half, 0.97 * half],
        size=[0.0015, 0.0, 0.0],
        rgba=[*_STEM, 1.0],
    )


# What draws the things that do not look like their solids, by the catalogue's name.
VISUALS: Mapping[VisualName, Callable[[mujoco.MjSpec, mujoco.MjsBody, ObjectModel, str], None]] = {
    "boards": _boards,
    "apple": _apple,
}
