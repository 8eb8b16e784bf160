"""Where fingers could close on an object: poses of the tool centre point, from the object's solid alone.

Frame of the tool centre point: z is the approach direction (out of the hand), y the direction in which the fingers
move. A grasp puts y along a horizontal width of the object and tilts z from straight down (pitch 90 degrees) towards
the horizontal (pitch 25 degrees): hands that face forward near a table drive joint 6 into its limit.
"""

from dataclasses import dataclass

import numpy as np

from control.goal_predicates import PosedObject
from control.safety import SafetyLimits

MAX_OPENING = 0.08  # [m] between the pads of the Franka hand
PITCHES = np.radians([90.0, 75.0, 60.0, 45.0, 32.0, 25.0])
ROUND_AZIMUTHS = 12
FINGER_BEYOND_TCP = 0.0095  # [m] that the fingertips reach past the tool centre point (Franka hand)
FINGER_DEPTH = 0.034  # [m] of the fingers that is free in front of the hand's palm, less a few mm of room
LEVEL = 0.35  # largest vertical part of a width direction: fingers close about horizontally


@dataclass(frozen=True)
class Grasp:
    """One way to hold an object.

    Attributes:
        world_T_tcp: Pose of the tool centre point at the grasp, shape (4, 4).
        approach: Direction in which the hand comes, in the world, shape (3,).
        width: Distance between the pads when closed in [m].
        pitch: Angle of the approach below the horizontal in [rad].
    """

    world_T_tcp: np.ndarray
    approach: np.ndarray
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


def grasps(body: PosedObject, safety: SafetyLimits, support_height: float) -> list[Grasp]:
    """All grasps of an object that its width allows, steepest first; reach and collisions are for others to judge.

    Args:
        body: The object where it is.
        safety: For the clearance between open fingers and what they go around.
        support_height: Height of the table top in [m], below which no fingertip goes.
    """
    widest = MAX_OPENING - 2 * safety.finger_clearance
    out: list[Grasp] = []
    for closing, width in _closings(body):
        if width > widest:
            continue
        for pitch in PITCHES:
            approach = _approach(closing, float(pitch))
            rotation = tcp_frame(approach, closing)
            out += [
                Grasp(pose(rotation, point), approach, width, float(pitch))
                for point in _points(body, approach, closing, safety, support_height)
            ]
    return sorted(out, key=lambda g: -g.pitch)


def _level_widths(body: PosedObject) -> list[tuple[int, np.ndarray]]:
    """Axes of the object along which fingers could close: index and direction."""
    axes = [(i, body.pose[:3, i]) for i in range(3)]
    return [(i, a) for i, a in axes if abs(a[2]) <= LEVEL]


def _closings(body: PosedObject) -> list[tuple[np.ndarray, float]]:
    """Directions in which fingers could move, with the width that they meet there in [m]."""
    upright = abs(body.pose[2, 2]) > 1 - LEVEL**2
    if body.shape == "sphere" or (body.shape == "cylinder" and upright):
        diameter = float(np.max(body.extents if body.shape == "sphere" else body.extents[:2]))
        angles = np.arange(ROUND_AZIMUTHS) * 2 * np.pi / ROUND_AZIMUTHS
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
    body: PosedObject, approach: np.ndarray, closing: np.ndarray, safety: SafetyLimits, support_height: float
) -> list[np.ndarray]:
    """Places of the tool centre point: along the object's length, as deep as fingers, hand and table allow."""
    side = np.array([-closing[1], closing[0], 0.0])
    half = np.asarray(body.extents) / 2
    along = float(np.abs(body.pose[:3, :3].T @ side) @ half) if body.shape == "box" else float(half.max())
    shifts = [0.0] if along < 0.04 or body.shape != "box" else [0.0, 0.5 * along, -0.5 * along]
    # The fingertips stay above the table; the palm stays above the object's top.
    dip = abs(approach[2]) * FINGER_BEYOND_TCP + (1 - abs(approach[2])) * FINGER_BEYOND_TCP
    lowest = support_height + dip + safety.finger_clearance + 0.004
    low = max(lowest, body.top - FINGER_DEPTH) if abs(approach[2]) > 0.7 else lowest
    centre = float(body.position[2])
    heights = {round(max(centre, low), 4)}
    if body.half_height > 0.03:  # a tall thing can be held higher up as well
        heights.add(round(max(low, body.top - 0.02), 4))
        heights.add(round(max(low, 0.5 * (centre + body.top - 0.02)), 4))
    heights = {h for h in heights if h <= body.top - 0.006}
    return [np.array([*(body.position[:2] + s * side[:2]), h]) for s in shifts for h in sorted(heights)]
