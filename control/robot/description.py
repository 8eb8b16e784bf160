"""The Panda with its gripper as a Pinocchio model, be it the hand of its URDF or another one in its place."""

import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np

from control.errors import ConfigError
from control.robot.description_files import panda_urdf
from control.robot.gripper import HAND_TURN, GripperModel, GripperMounting, RigidPart

FLANGE_FRAME = "panda_link8"
HAND_FRAME = "panda_hand"
TCP_FRAME = "panda_hand_tcp"


def arm_model(gripper: GripperModel, finger_width: float) -> Any:
    """The seven joints of the arm with the gripper as a part of the last link; frame `TCP_FRAME` is its tool.

    Args:
        gripper: What hangs at the flange.
        finger_width: Distance between the pads in [m] at which the fingers are locked.

    Raises:
        ConfigError: The description is not installed, or has no flange.
    """
    import pinocchio  # pyright: ignore[reportMissingImports] -- its path is added by a .pth file

    if gripper.mounting is not None:
        return _mounted(panda_urdf(), gripper.mounting, finger_width)
    full = pinocchio.buildModelFromUrdf(str(panda_urdf()))
    fingers = [name for name in full.names if "finger" in name]
    reference = pinocchio.neutral(full)
    for name in fingers:
        reference[full.joints[full.getJointId(name)].idx_q] = finger_width / 2
    return pinocchio.buildReducedModel(full, [full.getJointId(name) for name in fingers], reference)


def without_hand(path: Path) -> str:
    """A URDF's text without the hand and everything that hangs on it.

    Raises:
        ConfigError: It has no hand that could be replaced.
    """
    root = ElementTree.parse(path).getroot()
    links = {str(e.get("name")): e for e in root.findall("link")}
    if FLANGE_FRAME not in links or HAND_FRAME not in links:
        raise ConfigError(f"{path.name} has no links '{FLANGE_FRAME}' and '{HAND_FRAME}', between which to mount")
    gone, grew = {HAND_FRAME}, True
    while grew:
        below = {_end(j, "child") for j in root.findall("joint") if _end(j, "parent") in gone}
        grew = not below <= gone
        gone |= below
    for joint in root.findall("joint"):
        if _end(joint, "child") in gone:
            root.remove(joint)
    for name in gone:
        root.remove(links[name])
    return ElementTree.tostring(root, encoding="unicode")


def _mounted(path: Path, mounting: GripperMounting, finger_width: float) -> Any:
    import pinocchio  # pyright: ignore[reportMissingImports]

    model = pinocchio.buildModelFromXML(without_hand(path))
    number = model.getFrameId(FLANGE_FRAME)
    flange = model.frames[number]
    turn = np.array(
        [[np.cos(HAND_TURN), -np.sin(HAND_TURN), 0.0], [np.sin(HAND_TURN), np.cos(HAND_TURN), 0.0], [0, 0, 1]]
    )
    hand = flange.placement * pinocchio.SE3(turn, np.zeros(3))
    for part, side in ((mounting.base, 0.0), (mounting.finger, 1.0), (mounting.finger, -1.0)):
        model.inertias[flange.parentJoint] += hand.act(_inertia(part, side, finger_width))
    tool = hand * pinocchio.SE3(np.eye(3), np.array([0.0, 0.0, mounting.tcp]))
    for name, placement in ((HAND_FRAME, hand), (TCP_FRAME, tool)):
        model.addFrame(
            pinocchio.Frame(name, flange.parentJoint, number, placement, pinocchio.FrameType.OP_FRAME), False
        )
    return model


def _inertia(part: RigidPart, side: float, width: float) -> Any:
    """Of a part in the hand frame: the base (side 0), the finger at +y (1) or its mirror image (-1), pads apart [m]."""
    import pinocchio  # pyright: ignore[reportMissingImports]

    x, y, z = part.com
    com = np.array([x, side * (y + width / 2) if side else y, z])
    return pinocchio.Inertia(part.mass, com, np.diag(part.inertia))


def _end(joint: ElementTree.Element, which: str) -> str:
    end = joint.find(which)
    return "" if end is None else str(end.get("link"))
