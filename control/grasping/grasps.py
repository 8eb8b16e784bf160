"""Where fingers could close on an object: poses of the tool centre point, from the object's solid alone.

Frame of the tool centre point: z is the approach direction (out of the hand), y the direction in which the fingers
move. A grasp puts y along a horizontal width of the object and tilts z from straight down (pitch 90 degrees) towards
the horizontal (pitch 25 degrees): hands that face forward near a table drive joint 6 into its limit.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from control.robot.gripper import PANDA_HAND, GripperModel
from control.safety.limits import SafetyLimits
from control.tasks.posed_object import PosedObject

PITCHES = np.radians([90.0, 75.0, 60.0, 45.0, 32.0, 25.0])
LEAST_HOLD = 0.010  # [m] of the object that lies between the pads at least
SHALLOWER = 0.010  # [m]: a second, shallower grasp keeps the hand further from what stands beside the object
ABOVE_TABLE = 0.004  # [m] of room under the fingertips, for errors of perceived heights
TALL = 0.03  # half height in [m] from which grasps further up are offered
LEVEL = 0.35  # largest vertical part of a width direction: fingers close about horizontally
# A round thing that the pads' lower edges hold above its middle is pressed downwards: the tangent of this angle (0.21)
# is less than a third of the least friction of the pads in a perturbed twin (1.0 less 30 %).
STEEPEST_HOLD = np.radians(12.0)


@dataclass(frozen=True)
class Offer:
    """How many grasps are offered.

    Attributes:
        azimuths: Directions in which fingers close on a round thing, over a full turn.
        raises: Grasps of a round thing between its middle and as far above it as the pads still hold it; 0 leaves
            these out.
    """

    azimuths: int = 12
    raises: int = 0


USUAL = Offer()
# Between close walls: finer turns find the gap, and a hand that stays higher has more room where walls lean outwards.
BETWEEN_WALLS = Offer(azimuths=24, raises=4)


@dataclass(frozen=True)
class Grasp:
    """One way to hold an object.

    Attributes:
        world_T_tcp: Pose of the tool centre point at the grasp, shape (4, 4).
        approach: Direction in which the hand comes, in the world, shape (3,).
        width: Distance between the pads when closed in [m].
        pitch: Angle of the approach below the horizontal in [rad].
    """

    world_T_tcp: NDArray[np.float64]
    approach: NDArray[np.float64]
    width: float
    pitch: float

    @property
    def text(self) -> str:
        """For people."""
        return f"pitch {np.degrees(self.pitch):.0f} deg, width {self.width * 1e3:.0f} mm"


def tcp_frame(approach: np.ndarray, closing: np.ndarray) -> np.ndarray:
    """Rotation (3, 3) whose z is `approach` and whose y is `closing` made perpendicular to it."""
    z = approach / np.linalg.norm(approach)
    y = closing - z * (closing @ z)
    y = y / np.linalg.norm(y)
    return np.stack([np.cross(y, z), y, z], axis=1)


def pose(rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Homogeneous pose, shape (4, 4)."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation, position
    return out


def graspable_width(body: PosedObject) -> float:
    """Smallest level width of an object in [m]: what the fingers would have to span."""
    if body.shape == "sphere":
        return float(np.max(body.extents))
    widths = [float(body.extents[axis]) for axis, _ in _level_widths(body)]
    return min(widths, default=float(np.min(body.extents)))


def grasps(
    body: PosedObject,
    safety: SafetyLimits,
    support_height: float,
    offer: Offer = USUAL,
    gripper: GripperModel = PANDA_HAND,
) -> list[Grasp]:
    """All grasps of an object that its width allows, steepest first; reach and collisions are for others to judge.

    Args:
        body: The object where it is.
        safety: For the clearance between open fingers and what they go around.
        support_height: Height of the table top in [m], below which no fingertip goes.
        offer: How many.
        gripper: What takes it.
    """
    widest = gripper.widest(safety.finger_clearance)
    out: list[Grasp] = []
    for closing, width in _closings(body, offer.azimuths):
        if width > widest:
            continue
        for pitch in PITCHES:
            approach = _approach(closing, float(pitch))
            rotation = tcp_frame(approach, closing)
            out += [
                Grasp(pose(rotation, point), approach, width, float(pitch))
                for point in _points(body, approach, closing, gripper, safety, support_height, offer.raises)
            ]
    return sorted(out, key=lambda g: -g.pitch)


def _level_widths(body: PosedObject) -> list[tuple[int, np.ndarray]]:
    """Axes of the object along which fingers could close: index and direction."""
    axes = [(i, body.pose[:3, i]) for i in range(3)]
    return [(i, a) for i, a in axes if abs(a[2]) <= LEVEL]


def _closings(body: PosedObject, azimuths: int) -> list[tuple[np.ndarray, float]]:
    """Directions in which fingers could move, with the width that they meet there in [m]."""
    upright = abs(body.pose[2, 2]) > 1 - LEVEL**2
    if body.shape == "sphere" or (body.shape == "cylinder" and upright):
        diameter = float(np.max(body.extents if body.shape == "sphere" else body.extents[:2]))
        angles = np.arange(azimuths) * 2 * np.pi / azimuths
        return [(np.array([np.cos(a), np.sin(a), 0.0]), diameter) for a in angles]
    out = []
    for i, axis in _level_widths(body):
        flat = np.array([axis[0], axis[1], 0.0])
        flat /= np.linalg.norm(flat)
        out += [(sign * flat, float(body.extents[i])) for sign in (1.0, -1.0)]
    return out


def _approach(closing: np.ndarray, pitch: float) -> np.ndarray:
    """Direction of approach: perpendicular to the closing direction, `pitch` below the horizontal."""
    forward = np.array([-closing[1], closing[0], 0.0])
    return forward * np.cos(pitch) - np.array([0.0, 0.0, np.sin(pitch)])


def _points(
    body: PosedObject,
    approach: np.ndarray,
    closing: np.ndarray,
    gripper: GripperModel,
    safety: SafetyLimits,
    support_height: float,
    raises: int,
) -> list[np.ndarray]:
    """Places of the tool centre point: along the object's length, as deep as fingers, palm and table allow."""
    side = np.array([-closing[1], closing[0], 0.0])
    along = _support(body, side)
    shifts = [0.0] if along < 0.04 or body.shape != "box" else [0.0, 0.5 * along, -0.5 * along]
    depth = _support(body, approach)  # from the middle to the surface that the hand comes to
    shallow = max(0.0, depth - gripper.palm_room)
    backs = {shallow, min(shallow + SHALLOWER, max(shallow, depth - LEAST_HOLD))}
    if raises and body.shape == "sphere":
        # The pads' edges touch a ball of radius r at a height r sin(angle) above its middle.
        highest = max(shallow, gripper.pad_reach + depth * float(np.sin(STEEPEST_HOLD)))
        backs |= set(np.linspace(shallow, highest, raises).tolist())
    lowest = support_height + gripper.fingertip + safety.finger_clearance + ABOVE_TABLE
    points = [body.position - back * approach for back in sorted(backs)]
    if body.half_height > TALL:  # a tall thing can be held higher up as well
        top = body.top - LEAST_HOLD - gripper.fingertip
        points += [
            np.array([*body.position[:2], body.position[2] + share * (top - body.position[2])]) for share in (0.5, 1)
        ]
    out = []
    for point in points:
        height = max(float(point[2]), lowest)
        if height <= body.top - LEAST_HOLD:
            out += [np.array([*(point[:2] + s * side[:2]), height]) for s in shifts]
    return out


def _support(body: PosedObject, direction: np.ndarray) -> float:
    """Distance in [m] from an object's centre to its furthest point along a direction."""
    half = np.asarray(body.extents) / 2
    if body.shape == "sphere":
        return float(half.max())
    return float(np.abs(body.pose[:3, :3].T @ direction) @ half)
