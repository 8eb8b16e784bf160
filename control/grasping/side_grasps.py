"""Grasps that the usual ones leave out: by a handle, and from the side with one finger above and one below.

A hand that faces forward needs 0.1 m of room above and below, so things that lie on the table are not taken like that;
a bar that rests in something is. Frames as in `control.grasping.grasps`.
"""

import numpy as np

from control.grasping.grasps import ABOVE_TABLE, LEAST_HOLD, LEVEL, Grasp, pose, tcp_frame
from control.grasping.handle_grasps import handle_grasps
from control.robot.gripper import GripperModel
from control.safety.limits import SafetyLimits
from control.tasks.posed_object import PosedObject
from control.twin_model import Handle

HEADINGS = 12  # directions in which a level hand comes, over a full turn
PITCHES = np.radians([0.0, 15.0])  # of that hand below the horizontal; more would close askew
FINGER_HALF_WIDTH = 0.010  # [m] of either gripper's fingers, along the object
LEAST_DEPTH = 0.008  # [m] of the object that lies between the pads at least
# [m] that an object is let drop which had to be rolled: deep holds miss it less, and a bar falls without harm.
ROLLED_DROP = 0.008
LEAST_SLANT = 0.5  # of that direction along the object's shorter level axis: hands along a bar meet nothing but its end
ALONG = (0.0, 0.35, -0.35, 0.6, -0.6, 0.8, -0.8)  # points along an object's longest level axis, in half lengths


def grasps_by_handle(handle: Handle, world_T_body: np.ndarray) -> list[Grasp]:
    """All grasps of a loose thing's handle, from wherever the thing stands."""
    out = []
    for held in handle_grasps(handle, world_T_body):
        approach = held.world_T_tcp[:3, 2]
        out.append(Grasp(held.world_T_tcp, approach, held.width, float(np.arcsin(np.clip(-approach[2], -1.0, 1.0)))))
    return out


def grasps_from_the_side(body: PosedObject, safety: SafetyLimits, gripper: GripperModel) -> list[Grasp]:
    """Grasps of a box whose width is spanned vertically, by a hand that comes level; none of round things.

    Args:
        body: The object where it is.
        safety: For the clearance between open fingers and what they go around.
        gripper: What takes it.
    """
    upright = [i for i in range(3) if abs(body.pose[2, i]) > np.sqrt(1.0 - LEVEL**2)]
    if body.shape != "box" or not upright:
        return []
    width = float(body.extents[upright[0]])
    if width > gripper.widest(safety.finger_clearance):
        return []
    half = np.asarray(body.extents) / 2
    level = [i for i in range(3) if i != upright[0]]
    longest = max(level, key=lambda i: half[i])
    across = next(i for i in level if i != longest)
    out = []
    for angle in np.arange(HEADINGS) * 2 * np.pi / HEADINGS:
        forward = np.array([np.cos(angle), np.sin(angle), 0.0])
        slant = abs(float(forward @ body.pose[:3, across]))
        if slant < LEAST_SLANT:
            continue
        depth = half[across] / slant
        # The object will be put down on its far side, by a hand that leans over by this much: fingertips must not reach
        # through it further than it is let drop then.
        corner = gripper.fingertip * slant + FINGER_HALF_WIDTH * np.sqrt(1.0 - min(1.0, slant) ** 2)
        through = (corner + safety.finger_clearance + ABOVE_TABLE - half[across]) / slant
        most = gripper.fingertip + depth - LEAST_DEPTH
        # Deep first; less deep where something stands close behind the object.
        backs = {max(0.0, depth - gripper.palm_room, min(t, most)) for t in (through - ROLLED_DROP / slant, through)}
        for pitch in PITCHES:
            approach = forward * np.cos(pitch) - np.array([0.0, 0.0, np.sin(pitch)])
            for flip in (1.0, -1.0):
                turn = tcp_frame(approach, np.array([0.0, 0.0, flip]))
                for share in ALONG:
                    if share and half[longest] * (1 - abs(share)) < LEAST_HOLD:
                        continue
                    at = body.position + share * half[longest] * body.pose[:3, longest]
                    out += [
                        Grasp(pose(turn, at - back * approach), approach, width, float(pitch)) for back in sorted(backs)
                    ]
    return out
