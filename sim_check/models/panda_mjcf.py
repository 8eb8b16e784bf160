"""The Panda as a MuJoCo model, built from the URDF of example-robot-data: the one source for Pinocchio and the twin.

`panda_spec` returns a `mujoco.MjSpec` that a scene is built around (`spec.worldbody.add_body(...)`). Kinematics,
masses, inertias, joint limits, efforts and the fingers' collision boxes are read from the URDF; the arm's collision
bodies are the capsules of `sim_check.models.capsules`. What a URDF cannot say (servo gains, friction of the pads,
solver) is stated here with its source.

Groups of geoms: 3 = collision, 2 = pictures (no contacts). The pads' geoms are named `left_pad` and `right_pad`.
"""

from itertools import combinations, pairwise
from pathlib import Path

import mujoco
import numpy as np

from control.errors import ConfigError
from control.robot.description import FLANGE_FRAME
from control.robot.description_files import panda_urdf
from control.robot.gripper import PANDA_HAND, GripperModel
from control.twin_model import (
    ARM_BODIES,
    ARM_JOINTS,
    FINGER_BODIES,
    FINGER_JOINTS,
    GRIPPER_ACTUATOR,
    HAND_BODY,
    TCP_SITE,
)
from sim_check.models.capsules import stored_boxes, stored_capsules
from sim_check.models.finger_contacts import (
    COLLISION_GROUP,
    FINGER_RGBA,
    PAD_NAMES,
    PICTURE_GROUP,
    make_pad,
    make_shell,
)
from sim_check.models.robot_meshes import add_pictures
from sim_check.models.robotiq_mjcf import add_robotiq
from sim_check.models.urdf import UrdfLink, child, number, numbers, origin, read_links

__all__ = ["COLLISION_GROUP", "PAD_NAMES", "PICTURE_GROUP", "SERVO_LEAD", "STIFFNESS", "panda_spec"]

TCP_LINK = "panda_hand_tcp"

# Joint stiffness of Franka's internal controller in [Nm/rad]: libfranka, examples/examples_common.cpp,
# setJointImpedance.
STIFFNESS = (3000.0, 3000.0, 3000.0, 2500.0, 2500.0, 2000.0, 2000.0)
# Damping over stiffness in [s], the same for all joints so that a lagging arm stays on its path. A servo told only
# where to be trails by this time; command q + SERVO_LEAD * qd to be there on time. 0.05 s damps the stretched arm
# (about 2.5 kg m^2 at the shoulder) with a ratio of 0.87.
SERVO_LEAD = 0.05
# Reflected inertia of motors and gears in [kg m^2]; it also keeps the wrist's servo well below the step frequency.
ARM_ARMATURE = 0.1
# Servo of the mean finger position: full force from 10 mm of error on, [N/m] and [N s/m]. A step of the command would
# slam the fingers shut at over 1 m/s: ramp it at the real hand's speed.
FINGER_STIFFNESS = 8000.0
FINGER_SERVO_DAMPING = 100.0
FINGER_DAMPING = 5.0
# Reflected inertia of one finger's drive in [kg]. A lighter finger (0.01) lets a slammed cube jump out at a step of
# 4 ms, a much higher damping instead makes contacts soft: the contact solver does not see damping.
FINGER_ARMATURE = 0.1
JUDGE_STEP = 0.002


def panda_spec(
    meshes: bool = True, mesh_cache: Path | None = None, gripper: GripperModel = PANDA_HAND
) -> mujoco.MjSpec:
    """The Panda at the world's origin, with actuators, sites, exclusions and the physics options that grasping needs.

    Bodies, joints, site and actuators carry the names of `control.twin_model`. To stand the robot elsewhere set `pos`
    and `quat` of the body `panda_link0`. All parts of the robot are gravity compensated, as Franka's control box does.
    The time step is `JUDGE_STEP`; a search may set 0.004 s.

    Args:
        meshes: Whether to add the visual meshes (group 2); without them the model compiles in milliseconds.
        mesh_cache: Folder in which converted meshes are kept between runs; none by default.
        gripper: What hangs at the flange.

    Raises:
        ConfigError: example-robot-data is not installed, or its URDF lacks a link or joint that the stack names.
    """
    described = read_links(panda_urdf())
    links = described if gripper.mounting is None else _without_hand(described)
    spec = mujoco.MjSpec()
    spec.modelname = "panda"
    _set_physics(spec)
    capsules, boxes = stored_capsules(), stored_boxes()
    frames = {"": (spec.worldbody, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))}
    for link in links:
        parent, offset, turn = frames[link.parent or ""]
        pos, quat = (np.zeros(3), np.array([1.0, 0, 0, 0])) if link.joint is None else origin(link.joint)
        pos, quat = _compose(offset, turn, pos, quat)
        if link.name == TCP_LINK:
            parent.add_site(name=TCP_SITE, pos=pos, quat=quat, size=[0.004] * 3, group=4)
        if link.joint is not None and link.joint.get("type") == "fixed" and link.mass == 0.0:
            frames[link.name] = (parent, pos, quat)  # a frame without substance
            continue
        body = parent.add_body(name=link.name, pos=pos, quat=quat, gravcomp=1.0)
        frames[link.name] = (body, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
        _add_inertia(body, link)
        _add_joint(body, link)
        if link.name in FINGER_BODIES:
            _add_finger_boxes(body, link)
        else:
            _add_solids(body, capsules.get(link.name, np.zeros((0, 7))), boxes.get(link.name, np.zeros((0, 6))))
    if gripper.mounting is not None:
        fingers = add_robotiq(spec, *frames[FLANGE_FRAME], gripper.mounting, gripper.opening, meshes)
        for joint in fingers:
            joint.armature, joint.damping = FINGER_ARMATURE, [FINGER_DAMPING, 0.0, 0.0]
    _require(spec)
    _add_servos(spec, links, gripper)
    _add_exclusions(spec)
    if meshes:
        add_pictures(spec, links, PICTURE_GROUP, mesh_cache)
    return spec


def _without_hand(links: list[UrdfLink]) -> list[UrdfLink]:
    """Without the hand and what hangs on it; parents come before their children."""
    gone = {HAND_BODY}
    for link in links:
        if link.parent in gone:
            gone.add(link.name)
    return [link for link in links if link.name not in gone]


def _set_physics(spec: mujoco.MjSpec) -> None:
    """Options under which a grasp holds: fewer line-search steps than 50 throw a cube out of the hand."""
    spec.compiler.degree = False
    spec.compiler.autolimits = True
    option = spec.option
    option.timestep = JUDGE_STEP
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = 10.0
    option.iterations = 20
    option.ls_iterations = 50
    option.ls_tolerance = 1e-3


def _compose(
    pos_a: np.ndarray, quat_a: np.ndarray, pos_b: np.ndarray, quat_b: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    pos, quat = np.zeros(3), np.zeros(4)
    mujoco.mju_mulPose(pos, quat, pos_a, quat_a, pos_b, quat_b)
    return pos, quat


def _add_inertia(body: mujoco.MjsBody, link: UrdfLink) -> None:
    inertial = child(link.element, "inertial")
    tensor = child(inertial, "inertia")
    pos, quat = origin(inertial)
    body.explicitinertial = True
    body.mass = link.mass
    body.ipos = pos
    body.iquat = quat
    body.fullinertia = [number(tensor, k) for k in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")]


def _add_joint(body: mujoco.MjsBody, link: UrdfLink) -> None:
    if link.joint is None or link.joint.get("type") == "fixed":
        return
    limit = child(link.joint, "limit")
    slides = link.joint.get("type") == "prismatic"
    damping = FINGER_DAMPING if slides else number(child(link.joint, "dynamics"), "damping")
    body.add_joint(
        name=str(link.joint.get("name")),
        type=mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE,
        axis=numbers(child(link.joint, "axis").get("xyz")),
        range=[number(limit, "lower"), number(limit, "upper")],
        armature=FINGER_ARMATURE if slides else ARM_ARMATURE,
        damping=[damping, 0.0, 0.0],
    )


def _add_solids(body: mujoco.MjsBody, capsules: np.ndarray, boxes: np.ndarray) -> None:
    for i, row in enumerate(capsules):
        geom = body.add_geom(name=f"{body.name}_capsule{i}", type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=row[:6])
        geom.size = [row[6], 0.0, 0.0]
        make_shell(geom)
    for i, row in enumerate(boxes):
        geom = body.add_geom(name=f"{body.name}_box{i}", type=mujoco.mjtGeom.mjGEOM_BOX, pos=row[:3], size=row[3:])
        make_shell(geom)


def _add_finger_boxes(body: mujoco.MjsBody, link: UrdfLink) -> None:
    """The URDF's collision boxes; the one farthest from the hand is the pad, with the contact that holds things."""
    side = "left" if link.name == FINGER_BODIES[0] else "right"
    boxes = link.element.findall("collision")
    places = [origin(box) for box in boxes]
    tip = int(np.argmax([pos[2] for pos, _ in places]))
    for i, (box, (pos, quat)) in enumerate(zip(boxes, places, strict=True)):
        size = numbers(child(child(box, "geometry"), "box").get("size")) / 2
        geom = body.add_geom(
            name=f"{side}_pad" if i == tip else f"{side}_finger{i}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=pos,
            quat=quat,
            size=size,
        )
        if i == tip:
            make_pad(geom)
        else:
            make_shell(geom, FINGER_RGBA)


def _require(spec: mujoco.MjSpec) -> None:
    """Raise ConfigError unless the URDF had everything that the rest of the stack names."""
    bodies = {b.name for b in spec.bodies}
    joints = {j.name for j in spec.joints}
    sites = {s.name for s in spec.sites}
    missing = sorted({*ARM_BODIES, HAND_BODY, *FINGER_BODIES} - bodies)
    missing += sorted({*ARM_JOINTS, *FINGER_JOINTS} - joints) + sorted({TCP_SITE} - sites)
    if missing:
        raise ConfigError(f"the Panda's URDF lacks {missing}; install the locked version of example-robot-data")


def _add_servos(spec: mujoco.MjSpec, links: list[UrdfLink], gripper: GripperModel) -> None:
    joints = {str(link.joint.get("name")): link.joint for link in links if link.joint is not None}
    for name, stiffness in zip(ARM_JOINTS, STIFFNESS, strict=True):
        limit = child(joints[name], "limit")
        effort = number(limit, "effort")
        servo = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_position(kp=stiffness, kv=SERVO_LEAD * stiffness)
        servo.forcerange = [-effort, effort]
    # The servo pulls on the mean of both fingers: were it to drive one finger alone, the coupling would have to carry
    # the whole grasp force of the other and would yield by millimetres.
    mean = spec.add_tendon(name="half_width")
    for finger in FINGER_JOINTS:
        mean.wrap_joint(finger, 0.5)
    servo = spec.add_actuator(name=GRIPPER_ACTUATOR, target="half_width", trntype=mujoco.mjtTrn.mjTRN_TENDON)
    servo.set_to_position(kp=FINGER_STIFFNESS, kv=FINGER_SERVO_DAMPING)
    servo.forcerange = [-2 * gripper.pad_force, 2 * gripper.pad_force]  # shared by both pads
    servo.ctrlrange = [0.0, gripper.opening / 2]
    # The second finger mirrors the first (the URDF's <mimic>).
    coupling = spec.add_equality(
        name="fingers", type=mujoco.mjtEq.mjEQ_JOINT, name1=FINGER_JOINTS[0], name2=FINGER_JOINTS[1]
    )
    coupling.data[:5] = [0.0, 1.0, 0.0, 0.0, 0.0]
    coupling.solref = [0.005, 1.0]


def _add_exclusions(spec: mujoco.MjSpec) -> None:
    """Switch off contacts of links that are joined: their capsules overlap by construction."""
    chain = [*ARM_BODIES, HAND_BODY]
    pairs = list(pairwise(chain))
    pairs += [(HAND_BODY, finger) for finger in FINGER_BODIES] + list(combinations(FINGER_BODIES, 2))
    for a, b in pairs:
        spec.add_exclude(bodyname1=a, bodyname2=b)
