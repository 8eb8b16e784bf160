"""A table in a room whose surfaces and lights change from scene to scene."""

from dataclasses import dataclass

import cv2
import mujoco
import numpy as np

from sim_check.models.panda_mjcf import PICTURE_GROUP
from sim_check.models.render import Offscreen

SURFACES = 4
TEXTURE = 128  # side in [px]
FLOOR = -0.74  # height of the floor in [m]


@dataclass(frozen=True)
class RoomNames:
    """Names of what changes.

    Attributes:
        geoms: Surfaces.
        materials: Theirs; each has a texture of the same name.
        lights: Lamps.
    """

    geoms: tuple[str, ...]
    materials: tuple[str, ...]
    lights: tuple[str, ...]


def add_random_room(spec: mujoco.MjSpec, rng: np.random.Generator) -> RoomNames:
    """Add a table, a floor, walls, a sky and two lamps to an empty scene."""
    materials = []
    for i in range(SURFACES):
        name = f"surface{i}"
        spec.add_texture(
            name=name,
            type=mujoco.mjtTexture.mjTEXTURE_2D,
            builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
            rgb1=[1.0, 1.0, 1.0],
            width=TEXTURE,
            height=TEXTURE,
        )
        repeat = float(rng.uniform(1.0, 5.0))
        material = spec.add_material(
            name=name, texrepeat=[repeat, repeat], texuniform=bool(rng.random() < 0.7), specular=0.2, shininess=0.3
        )
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
        materials.append(name)
    half = (float(rng.uniform(0.5, 0.9)), float(rng.uniform(0.5, 1.0)), 0.02)
    parts = [
        ("table", mujoco.mjtGeom.mjGEOM_BOX, half, (0.42, 0.0, -half[2]), 0),
        ("floor", mujoco.mjtGeom.mjGEOM_BOX, (6.0, 6.0, 0.02), (0.0, 0.0, FLOOR - 0.02), 1),
    ]
    for i, (x, y) in enumerate(((2.6, 0.0), (-1.9, 0.0), (0.0, 2.4), (0.0, -2.4))):
        size = (0.05, 4.0, 2.2) if x else (4.0, 0.05, 2.2)
        parts.append((f"wall{i}", mujoco.mjtGeom.mjGEOM_BOX, size, (x + 0.4, y, 1.4), 2 + i % 2))
    names = []
    for name, kind, size, position, surface in parts:
        spec.worldbody.add_geom(
            name=f"room_{name}",
            type=kind,
            size=list(size),
            pos=list(position),
            material=materials[surface],
            group=PICTURE_GROUP,
            contype=0,
            conaffinity=0,
        )
        names.append(f"room_{name}")
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=list(rng.uniform(0.2, 0.95, 3)),
        rgb2=list(rng.uniform(0.1, 0.8, 3)),
        width=32,
        height=32,
    )
    for i in range(2):
        spec.worldbody.add_light(
            name=f"lamp{i}",
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL if rng.random() < 0.5 else mujoco.mjtLightType.mjLIGHT_SPOT,
            pos=[0.0, 0.0, 2.0],
            dir=[0.0, 0.0, -1.0],
            castshadow=i == 0,
            cutoff=70.0,
        )
    return RoomNames(tuple(names), tuple(materials), ("lamp0", "lamp1"))


class Room:
    """The room of one compiled model."""

    def __init__(self, model: mujoco.MjModel, names: RoomNames, rng: np.random.Generator) -> None:
        self._model, self._names, self._rng = model, names, rng

    def renew(self, renderer: Offscreen) -> None:
        """Draw new surfaces and lights, in place."""
        rng, model = self._rng, self._model
        for name in self._names.materials:
            material = model.material(name).id
            # Rooms are mostly light and dull.
            tone = rng.uniform(0.1, 1.0, 3) ** 0.7
            model.mat_rgba[material, :3] = tone.mean() + rng.choice([0.12, 0.3, 0.8]) * (tone - tone.mean())
            model.mat_specular[material] = rng.uniform(0.0, 0.5)
            if rng.random() < 0.5:
                texture = model.texture(name).id
                at = model.tex_adr[texture]
                model.tex_data[at : at + TEXTURE * TEXTURE * 3] = random_texture(rng).ravel()
                renderer.upload_texture(texture)
        for k, name in enumerate(self._names.lights):
            light = model.light(name).id
            place = np.array([0.45 + rng.uniform(-1.5, 1.5), rng.uniform(-1.5, 1.5), rng.uniform(1.0, 2.2)])
            towards = np.array([0.45 + rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2), 0.0]) - place
            model.light_pos[light], model.light_dir[light] = place, towards / np.linalg.norm(towards)
            tint = rng.normal(0.0, 0.03, 3)
            model.light_diffuse[light] = np.clip((rng.uniform(0.2, 0.75), rng.uniform(0.0, 0.5))[k] + tint, 0.0, 1.0)
            model.light_specular[light] = rng.uniform(0.0, 0.5)
        model.light_castshadow[model.light(self._names.lights[0]).id] = rng.random() < 0.75
        head = model.vis.headlight
        head.ambient[:] = rng.uniform(0.15, 0.45)
        head.diffuse[:] = rng.uniform(0.05, 0.4)
        head.specular[:] = rng.uniform(0.0, 0.3)


def random_texture(rng: np.random.Generator) -> np.ndarray:
    """A surface: plain, cloudy, striped or grainy; uint8, shape (TEXTURE, TEXTURE, 3)."""
    kind = int(rng.integers(4))
    side = TEXTURE
    if kind == 0:
        picture = np.full((side, side, 3), rng.uniform(150, 255), np.float32)
    elif kind == 1:
        cells = int(rng.integers(2, 24))
        coarse = rng.uniform(140, 220, 3) + rng.uniform(5, 55) * rng.normal(size=(cells, cells, 3))
        picture = cv2.resize(coarse.astype(np.float32), (side, side), interpolation=cv2.INTER_CUBIC)
    elif kind == 2:
        dark, light = rng.uniform(80, 255, (2, 3))
        rows, columns = np.mgrid[:side, :side] / side
        bend = cv2.resize(rng.normal(size=(6, 6)), (side, side))
        wave = np.sin(2 * np.pi * rng.integers(1, 9) * (columns * rng.random() + rows) + 3 * bend) / 2 + 0.5
        picture = dark + (light - dark) * wave[..., None]
    else:
        grain = cv2.GaussianBlur(rng.normal(0, 80, (side, side)), (0, 0), float(rng.uniform(0.5, 3)))
        picture = rng.uniform(120, 255) + np.repeat(grain[..., None], 3, axis=2)
    return np.clip(picture + rng.normal(0, 4, picture.shape), 0, 255).astype(np.uint8)
