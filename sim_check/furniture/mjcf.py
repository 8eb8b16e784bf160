"""Puts furniture into a MuJoCo model: the same bodies, joints and contacts for the simulated cell and for the twin.

The fixed body carries the furniture's name, every moving body and its joint the part's name.
"""

from collections.abc import Mapping
from itertools import combinations

import mujoco
import numpy as np

from sim_check.furniture.model import Board, FurnitureModel, MovingPart
from sim_check.models.panda_mjcf import COLLISION_GROUP, PICTURE_GROUP
from sim_check.models.scene_mjcf import CONTACT_SOLREF, add_solid, quat_of

FRICTION = (0.5, 0.005, 0.0001)
DOOR_ARMATURE = 0.01  # [kg m^2] or [kg]
# Time constant in [s] of dry friction, as stiff as a 4 ms step allows: softer, doors creep under light pulls.
DRY_SOLREF = (0.01, 1.0)
_GRAIN = 0.10  # how much darker the grain of wood is


def add_furniture(spec: mujoco.MjSpec, thing: FurnitureModel, pose: np.ndarray, pictures: bool) -> mujoco.MjsBody:
    """Add fixed furniture with its moving parts, all of them closed.

    Args:
        spec: Scene to add to.
        thing: What to build.
        pose: Its frame in the world, shape (4, 4).
        pictures: Whether to add what cameras see; without them the collision bodies are all there is.

    Returns:
        The fixed body.
    """
    looks = _materials(spec, thing) if pictures else {}
    body = spec.worldbody.add_body(name=thing.name, pos=pose[:3, 3], quat=quat_of(pose))
    _add_boards(body, thing.name, thing.boards, None, looks, thing.rgb)
    for part in thing.parts:
        moving = body.add_body(name=part.name, pos=part.anchor)
        _add_joint(moving, part)
        _add_boards(moving, part.name, part.boards, part.mass, looks, thing.rgb)
        # Gaps around doors are smaller than what contacts need.
        spec.add_exclude(bodyname1=thing.name, bodyname2=part.name)
    for a, b in combinations(thing.parts, 2):
        spec.add_exclude(bodyname1=a.name, bodyname2=b.name)
    return body


def set_fractions(
    model: mujoco.MjModel, qpos: np.ndarray, thing: FurnitureModel, fractions: Mapping[str, float]
) -> None:
    """Open parts in a configuration, in place.

    Args:
        model: Compiled model.
        qpos: Configuration, shape (nq,).
        thing: Furniture in the model.
        fractions: 0 closed .. 1 open, by part; parts that are not named stay as they are.
    """
    for part in thing.parts:
        if part.name in fractions:
            qpos[model.joint(part.name).qposadr[0]] = np.clip(fractions[part.name], 0.0, 1.0) * part.opened


def _add_joint(body: mujoco.MjsBody, part: MovingPart) -> None:
    slides = part.kind == "slide"
    joint = body.add_joint(
        name=part.name,
        type=mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE,
        axis=part.axis,
        range=[0.0, part.opened],
        frictionloss=part.friction,
        damping=[part.damping, 0.0, 0.0],
        armature=DOOR_ARMATURE,
    )
    joint.solref_friction = DRY_SOLREF
    if part.stiffness > 0:
        joint.stiffness = [part.stiffness, 0.0, 0.0]
        # A spring at rest beyond the end of the range presses the part against that end; the part's own weight, which
        # acts along the axis of a plate, is carried as well.
        carried = part.preload + part.mass * 9.81 * float(-part.axis[2])
        joint.springref = -carried / part.stiffness


def _add_boards(
    body: mujoco.MjsBody,
    name: str,
    boards: tuple[Board, ...],
    mass: float | None,
    looks: dict[str, str],
    rgb: tuple[float, float, float],
) -> None:
    volume = sum(b.solid.volume for b in boards if b.solid_to_touch)
    for i, board in enumerate(boards):
        if board.solid_to_touch:
            geom = add_solid(body, board.solid, name=f"{name}_{i}", group=COLLISION_GROUP, rgba=[*rgb, 1.0])
            geom.friction = FRICTION
            geom.condim = 4
            geom.solref = CONTACT_SOLREF
            if mass is not None:
                geom.mass = mass * board.solid.volume / volume
        if looks and board.look != "hidden":
            add_solid(
                body,
                board.solid,
                group=PICTURE_GROUP,
                contype=0,
                conaffinity=0,
                mass=0.0,
                material=looks[board.look],
            )


def _materials(spec: mujoco.MjSpec, thing: FurnitureModel) -> dict[str, str]:
    """One material per look; names begin with the furniture's."""
    rgb = np.array(thing.rgb)
    looks = {
        "shell": (0.88 * rgb, 0.1),
        "front": (rgb, 0.15),
        "metal": (np.array([0.62, 0.63, 0.65]), 0.8),
        "glass": (np.array([0.05, 0.06, 0.07]), 0.9),
        "dark": (np.array([0.17, 0.17, 0.18]), 0.2),
        "accent": (rgb, 0.4),
    }
    names = {}
    for look, (colour, shine) in looks.items():
        name = names[look] = f"{thing.name}_{look}"
        material = spec.add_material(name=name, rgba=[*colour, 1.0], specular=shine, shininess=0.5)
        if thing.wooden and look in ("shell", "front"):
            spec.add_texture(
                name=name,
                type=mujoco.mjtTexture.mjTEXTURE_2D,
                builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
                rgb1=[1.0, 1.0, 1.0],
                mark=mujoco.mjtMark.mjMARK_RANDOM,
                markrgb=[1 - _GRAIN] * 3,
                random=0.2,
                width=16,
                height=512,
            )
            material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
            material.texuniform = True
            material.texrepeat = [6.0, 1.0]
    return names
