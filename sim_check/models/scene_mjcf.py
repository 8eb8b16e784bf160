"""Puts robot, table, objects, lights and cameras into one MuJoCo model.

Groups of geoms, as in `sim_check.models.panda_mjcf`: 3 = collision, 2 = pictures without contacts.
"""

from collections.abc import Sequence

import mujoco
import numpy as np

from control.twin_model import ARM_BODIES, HAND_BODY, TABLE_BODY
from sim_check.cells.cell_config import CameraConfig, RobotConfig
from sim_check.models.object_visuals import object_pictures
from sim_check.models.panda_mjcf import COLLISION_GROUP, PICTURE_GROUP
from sim_check.objects.library import ObjectModel
from sim_check.objects.solids import SolidShape

_GEOMS = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "ellipsoid": mujoco.mjtGeom.mjGEOM_ELLIPSOID,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
}
TABLE_FRICTION = (0.6, 0.005, 0.0001)
# Time constant of object contacts in [s]: as stiff as a 4 ms step allows (two steps and a little).
CONTACT_SOLREF = (0.01, 1.0)


def pose_of(position: np.ndarray, quat: np.ndarray) -> np.ndarray:
    """Transform, shape (4, 4), of a position in [m] and a quaternion (w, x, y, z)."""
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, np.asarray(quat, float))
    pose = np.eye(4)
    pose[:3, :3] = rotation.reshape(3, 3)
    pose[:3, 3] = position
    return pose


def quat_of(pose: np.ndarray) -> np.ndarray:
    """Quaternion (w, x, y, z) of a transform or rotation."""
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(pose[:3, :3], dtype=float).ravel())
    return quat


def place_robot(spec: mujoco.MjSpec, robot: RobotConfig) -> None:
    """Stand the robot where the cell says."""
    base = spec.body(ARM_BODIES[0])
    base.pos = robot.world_T_base[:3, 3]
    base.quat = quat_of(robot.world_T_base)


def add_table(spec: mujoco.MjSpec, height: float = 0.0) -> mujoco.MjsBody:
    """The table's surface at a height in [m]: an infinite plane to contacts, so nothing falls off its edge."""
    table = spec.worldbody.add_body(name=TABLE_BODY, pos=[0.0, 0.0, height])
    table.add_geom(
        name=TABLE_BODY,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[1.0, 1.0, 0.05],
        pos=[0.4, 0.0, 0.0],
        friction=TABLE_FRICTION,
        group=COLLISION_GROUP,
        rgba=[0.72, 0.72, 0.70, 1.0],
    )
    return table


def add_object(spec: mujoco.MjSpec, thing: ObjectModel, pose: np.ndarray, pictures: bool) -> mujoco.MjsBody:
    """Add a body named as the object, free if it is movable.

    Args:
        spec: Scene to add to.
        thing: What to build.
        pose: Its frame in the world, shape (4, 4).
        pictures: Whether to add what cameras see; without them the collision body is all there is.
    """
    body = spec.worldbody.add_body(name=thing.name, pos=pose[:3, 3], quat=quat_of(pose))
    if thing.movable:
        body.add_freejoint(name=thing.name)
    volume = sum(s.volume for s in thing.solids)
    for i, solid in enumerate(thing.solids):
        geom = add_solid(body, solid)
        geom.name = f"{thing.name}_{i}"
        geom.mass = thing.mass * solid.volume / volume
        geom.friction = thing.friction
        geom.condim = 6 if thing.rolls else 4
        geom.solref = CONTACT_SOLREF
        geom.group = COLLISION_GROUP
        geom.rgba = [*thing.rgb, 1.0]
    if pictures:
        object_pictures(spec, body, thing)
    return body


def add_solid(body: mujoco.MjsBody, solid: SolidShape, **geom) -> mujoco.MjsGeom:
    """Add a primitive to a body, with further attributes of the geom."""
    size = [solid.half[0], solid.half[2], 0.0] if solid.kind in ("cylinder", "capsule") else solid.half
    return body.add_geom(type=_GEOMS[solid.kind], size=size, pos=solid.position, quat=solid.quat, **geom)


def add_camera(spec: mujoco.MjSpec, camera: CameraConfig) -> None:
    """Add a camera with the cell's intrinsics, in the world or on the hand."""
    body = spec.worldbody if camera.mounting == "static" else spec.body(HAND_BODY)
    mount_T_camera = camera.mount_T_camera
    lens = camera.intrinsics
    # MuJoCo's cameras look along -z with y up; their principal point is the way from it to the picture's centre.
    body.add_camera(
        name=camera.name,
        pos=mount_T_camera[:3, 3],
        quat=quat_of(mount_T_camera[:3, :3] @ np.diag([1.0, -1.0, -1.0])),
        resolution=[lens.width, lens.height],
        sensor_size=[lens.width * 1e-5, lens.height * 1e-5],
        focal_pixel=[lens.fx, lens.fy],
        principal_pixel=[(lens.width - 1) / 2 - lens.cx, (lens.height - 1) / 2 - lens.cy],
    )


def add_lights(spec: mujoco.MjSpec) -> None:
    """A lamp with shadows above the table, a weaker one beside it, and soft light all around."""
    spec.visual.headlight.ambient = [0.36, 0.36, 0.36]
    spec.visual.headlight.diffuse = [0.18, 0.18, 0.18]
    spec.visual.headlight.specular = [0.05, 0.05, 0.05]
    lamps = (((0.9, -0.7, 1.9), 0.50, True), ((0.2, 1.2, 1.6), 0.22, False))
    for position, strength, shadow in lamps:
        spec.worldbody.add_light(
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            pos=position,
            dir=np.subtract((0.45, 0.0, 0.0), position),
            diffuse=[strength] * 3,
            specular=[0.15] * 3,
            castshadow=shadow,
        )


def set_rendering(spec: mujoco.MjSpec, width: int, height: int) -> None:
    """Sizes and planes of the offscreen picture; software rendering wants small shadow maps and few samples.

    MuJoCo's near and far planes are shares of the scene's extent; with an extent of 1 m they are in [m].
    """
    spec.stat.extent = 1.0
    spec.stat.center = [0.45, 0.0, 0.1]
    spec.visual.map.znear = 0.02
    spec.visual.map.zfar = 12.0
    spec.visual.quality.shadowsize = 2048
    spec.visual.quality.offsamples = 4
    spec.visual.global_.offwidth = width
    spec.visual.global_.offheight = height


def add_sky(spec: mujoco.MjSpec) -> None:
    """The light of a bright room behind everything, and the same colour where the floor fades into it."""
    spec.visual.rgba.haze = [0.62, 0.64, 0.66, 1.0]
    spec.add_texture(
        name="room",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.80, 0.82, 0.84],
        rgb2=[0.45, 0.47, 0.50],
        width=64,
        height=64,
    )


def add_room(spec: mujoco.MjSpec, table: mujoco.MjsBody) -> None:
    """What stands around, as pictures only: a laminate table top on legs and a floor."""
    _add_material(spec, "laminate", [0.66, 0.66, 0.64], [0.58, 0.58, 0.57], 6.0, 0.25)
    _add_material(spec, "concrete", [0.40, 0.41, 0.43], [0.36, 0.37, 0.39], 3.0, 0.05)
    half = (0.72, 0.85, 0.018)
    centre = np.array([0.42, 0.0, -half[2]])
    _add_picture(table, half, centre, material="laminate")
    for x in (-1, 1):
        for y in (-1, 1):
            leg = centre + np.array([x * (half[0] - 0.06), y * (half[1] - 0.06), -0.36])
            _add_picture(table, (0.025, 0.025, 0.35), leg, rgba=[0.25, 0.26, 0.28, 1.0])
    table.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0.0, 0.0, 0.05],
        pos=[0.0, 0.0, -0.74],
        material="concrete",
        group=PICTURE_GROUP,
        contype=0,
        conaffinity=0,
    )


def _add_material(
    spec: mujoco.MjSpec, name: str, rgb: list[float], speckle: list[float], repeat: float, shine: float
) -> None:
    """A speckled surface, `repeat` textures a metre."""
    spec.add_texture(
        name=name,
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        rgb1=rgb,
        rgb2=rgb,
        mark=mujoco.mjtMark.mjMARK_RANDOM,
        markrgb=speckle,
        random=0.08,
        width=256,
        height=256,
    )
    material = spec.add_material(name=name, texrepeat=[repeat, repeat], texuniform=True, specular=shine, shininess=0.3)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name


def _add_picture(body: mujoco.MjsBody, half: Sequence[float], position: np.ndarray, **look) -> None:
    """A box that only cameras see; half sizes and centre in the body's frame in [m]."""
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=half,
        pos=position,
        group=PICTURE_GROUP,
        contype=0,
        conaffinity=0,
        mass=0.0,
        **look,
    )
