"""The Robotiq 2F-85 at the flange, from primitives, as linear jaws at their furthest reach (`control.robot.gripper`).

Sizes were measured on Robotiq's public drawings and meshes; z counts from the flange, widths from the middle plane
for what is fixed, and from a pad's face for what moves with it. What the real linkage sweeps from open to closed is
covered: its outer links by two fixed boxes, the rest by boxes that move with the pads.
"""

import mujoco
import numpy as np

from control.robot.gripper import HAND_TURN, ROBOTIQ_COUPLING, ROBOTIQ_TIP, GripperMounting, RigidPart
from control.twin_model import FINGER_BODIES, FINGER_JOINTS, HAND_BODY, TCP_SITE
from sim_check.models.finger_contacts import PAD_NAMES, PICTURE_GROUP, make_pad, make_shell

# Boxes fixed to the flange: half width in x, half width in y, from z to z, in [m].
_BODY = (
    (0.0375, 0.0410, 0.000, 0.052),  # coupling and housing
    (0.0335, 0.0425, 0.052, 0.072),
    (0.0195, 0.0415, 0.072, 0.101),  # up to the palm
    (0.0135, 0.0742, 0.056, 0.115),  # outer links, from open to closed
    (0.0195, 0.0560, 0.066, 0.086),  # inner links, narrower towards the fingers
    (0.0180, 0.0560, 0.086, 0.107),
    (0.0155, 0.0560, 0.107, 0.122),
)
# Boxes that move with a pad: half width in x, from and to behind the pad's face in y, from and to before the tip in z.
_PAD = (0.011, 0.0, 0.0075, 0.0, 0.0375)
_FINGER = (
    (0.0075, 0.0060, 0.0135, 0.000, 0.012),
    (0.0075, 0.0060, 0.0200, 0.012, 0.027),
    (0.0075, 0.0060, 0.0280, 0.027, 0.0385),
    (0.0145, 0.0010, 0.0312, 0.0385, 0.060),
)
_HOUSING, _METAL, _RUBBER = (0.14, 0.14, 0.15, 1.0), (0.45, 0.46, 0.48, 1.0), (0.05, 0.05, 0.05, 1.0)
# Links that are drawn between a knuckle on the hand (y, z) and a finger (y behind the pad's face, z), at +x and -x; the
# width in [m]. The real ones keep their length and swing the finger on an arc; these give way as linear jaws move.
_LINKS = (
    ("outer", (0.0306, 0.0549 + ROBOTIQ_COUPLING), (0.0252, ROBOTIQ_TIP - 0.051), 0.0105, 0.0055),
    ("inner", (0.0132, 0.0609 + ROBOTIQ_COUPLING), (0.0100, ROBOTIQ_TIP - 0.044), 0.0145, 0.0040),
)


def add_robotiq(
    spec: mujoco.MjSpec,
    parent: mujoco.MjsBody,
    pos: np.ndarray,
    quat: np.ndarray,
    mounting: GripperMounting,
    opening: float,
    pictures: bool,
) -> list[mujoco.MjsJoint]:
    """Add hand, fingers and tool site with the names of `control.twin_model`.

    Args:
        spec: What the robot is part of.
        parent: The last link.
        pos, quat: The flange in its frame: [m], shape (3,); (w, x, y, z).
        mounting: Masses and the tool centre point.
        opening: Largest distance between the pads in [m].
        pictures: Whether to add what cameras see.

    Returns:
        Both fingers' joints; 0 is closed.
    """
    turned, turn = np.zeros(4), np.array([np.cos(HAND_TURN / 2), 0.0, 0.0, np.sin(HAND_TURN / 2)])
    mujoco.mju_mulQuat(turned, quat, turn)
    hand = parent.add_body(name=HAND_BODY, pos=pos, quat=turned, gravcomp=1.0)
    hand.add_site(name=TCP_SITE, pos=[0.0, 0.0, mounting.tcp], size=[0.004] * 3, group=4)
    _set_inertia(hand, mounting.base, 1.0)
    for i, (x, y, low, high) in enumerate(_BODY):
        geom = _add_box(hand, (-x, -y, low), (x, y, high), name=f"{HAND_BODY}_box{i}")
        make_shell(geom)
    if pictures:
        _draw_hand(hand)
    joints = []
    for side, name, joint, pad in zip((1.0, -1.0), FINGER_BODIES, FINGER_JOINTS, PAD_NAMES, strict=True):
        finger = hand.add_body(name=name, gravcomp=1.0)
        _set_inertia(finger, mounting.finger, side)
        joints.append(
            finger.add_joint(
                name=joint, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0.0, side, 0.0], range=[0.0, opening / 2]
            )
        )
        make_pad(_add_finger_box(finger, _PAD, side, name=pad))
        for i, box in enumerate(_FINGER):
            make_shell(_add_finger_box(finger, box, side, name=f"{pad.removesuffix('_pad')}_finger{i}"))
        if pictures:
            _draw_finger(finger, side)
            _draw_links(spec, hand, finger, side)
    return joints


def _set_inertia(body: mujoco.MjsBody, part: RigidPart, side: float) -> None:
    body.explicitinertial = True
    body.mass = part.mass
    body.ipos = [part.com[0], side * part.com[1], part.com[2]]
    body.inertia = part.inertia


def _add_box(body: mujoco.MjsBody, low: tuple[float, ...], high: tuple[float, ...], **look) -> mujoco.MjsGeom:
    """A box between two corners in [m]."""
    a, b = np.array(low), np.array(high)
    return body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, pos=(a + b) / 2, size=np.abs(b - a) / 2, **look)


def _add_finger_box(finger: mujoco.MjsBody, box: tuple[float, ...], side: float, **look) -> mujoco.MjsGeom:
    x, near, far, front, back = box
    return _add_box(finger, (-x, side * near, ROBOTIQ_TIP - back), (x, side * far, ROBOTIQ_TIP - front), **look)


def _draw_hand(hand: mujoco.MjsBody) -> None:
    """Coupling and a housing that narrows towards the palm."""
    cylinder = mujoco.mjtGeom.mjGEOM_CYLINDER
    _picture(hand, cylinder, _METAL, fromto=[0, 0, 0, 0, 0, ROBOTIQ_COUPLING], size=[0.0375, 0, 0])
    _picture(hand, cylinder, _HOUSING, fromto=[0, 0, ROBOTIQ_COUPLING, 0, 0, 0.052], size=[0.0375, 0, 0])
    for (x, y, low, high), narrow in zip(_BODY[1:3], (0.004, 0.008), strict=True):
        half = [x - narrow / 2, y - narrow / 2, (high - low) / 2]
        _picture(hand, mujoco.mjtGeom.mjGEOM_BOX, _HOUSING, pos=[0, 0, (low + high) / 2], size=half)


def _draw_finger(finger: mujoco.MjsBody, side: float) -> None:
    """A body that narrows towards the tip, and the rubber pad."""
    for x, near, far, front, back in _FINGER:
        _draw_box(finger, (0.9 * x, near, far, front, back), side, _HOUSING)
    _draw_box(finger, _PAD, side, _RUBBER)


def _draw_links(spec: mujoco.MjSpec, hand: mujoco.MjsBody, finger: mujoco.MjsBody, side: float) -> None:
    """As tendons without any force, which MuJoCo draws as straight rods between two bodies."""
    for kind, (y, z), (behind, height), x, width in _LINKS:
        for across in (x, -x):
            name = f"{finger.name}_{kind}_link{'+' if across > 0 else '-'}"
            hand.add_site(name=f"{name}_knuckle", pos=[across, side * y, z], size=[0.001] * 3, group=4)
            finger.add_site(name=f"{name}_end", pos=[across, side * behind, height], size=[0.001] * 3, group=4)
            rod = spec.add_tendon(name=name, width=width, rgba=_METAL)
            rod.wrap_site(f"{name}_knuckle")
            rod.wrap_site(f"{name}_end")


def _draw_box(finger: mujoco.MjsBody, box: tuple[float, ...], side: float, rgba: tuple[float, ...]) -> None:
    geom = _add_finger_box(finger, box, side, rgba=rgba)
    geom.group, geom.contype, geom.conaffinity, geom.mass = PICTURE_GROUP, 0, 0, 0.0


def _picture(body: mujoco.MjsBody, kind: mujoco.mjtGeom, rgba: tuple[float, ...], **shape) -> None:
    body.add_geom(type=kind, rgba=rgba, group=PICTURE_GROUP, contype=0, conaffinity=0, mass=0.0, **shape)
