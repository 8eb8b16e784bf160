"""What in furniture things can lie on: the upper sides of its boards and of the stand-offs of its handles."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim_check.objects.solids import SolidShape
from sim_check.twin.placed import Fixed, Standing

BOTTOM_SLACK = 0.012  # [m] that a perceived bottom may be below what carries it
LEAST_ABOVE = 0.01  # [m] that a thing's top is above what carries it
LEAST_LEDGE = 0.003  # [m]: narrower ones carry nothing


@dataclass(frozen=True)
class Ledge:
    """Upper side of a solid.

    Attributes:
        top: Its height in the world in [m].
        centre: Middle of the solid's footprint in [m], shape (2,).
        sides: Half sides of the footprint as columns in [m], shape (2, 3): the solid's axes seen from above.
    """

    top: float
    centre: NDArray[np.float64]
    sides: NDArray[np.float64]


def furniture_ledges(furniture: Fixed) -> list[Ledge]:
    """Ledges of furniture as it stands, its parts opened."""
    frames = [(furniture.pose, furniture.thing.boards)]
    for part in furniture.thing.parts:
        value = furniture.fractions.get(part.name, 0.0) * part.opened
        move = np.eye(4)
        move[:3, 3] = part.anchor
        if part.kind == "hinge":
            quat = np.zeros(4)
            mujoco.mju_axisAngle2Quat(quat, part.axis, value)
            move[:3, :3] = _rotation(quat)
        else:
            move[:3, 3] += value * part.axis
        frames.append((furniture.pose @ move, part.boards))
    return [_ledge(b.solid, frame) for frame, boards in frames for b in boards if b.solid_to_touch]


def carried_at(s: Standing, ledges: Sequence[Ledge]) -> tuple[float, float]:
    """Heights in [m] at which furniture carries a thing; minus infinity where it does not.

    Returns:
        The highest ledge under the thing's middle that is below its top: a shelf, a cabinet's top. Its bottom is not
        asked, for a camera does not see it. And the highest ledge under any part of the thing, if that ends at its
        bottom, errors of the bottom allowed: stand-offs on which a bar lies.
    """
    middle = s.pose[:2, 3], np.zeros((2, 3))
    outline = s.pose[:2, 3], s.pose[:2, :3] * (s.thing.extents / 2)
    under, hung = -np.inf, -np.inf
    for ledge in ledges:
        theirs = ledge.centre, ledge.sides
        if ledge.top < s.top - LEAST_ABOVE and _overlap(middle, theirs):
            under = max(under, ledge.top)
        if ledge.top <= s.bottom + BOTTOM_SLACK and _overlap(outline, theirs):
            hung = max(hung, ledge.top)
    return under, hung


def _ledge(solid: SolidShape, frame: np.ndarray) -> Ledge:
    local = np.eye(4)
    local[:3, :3], local[:3, 3] = _rotation(np.asarray(solid.quat, float)), solid.position
    pose = frame @ local
    half = np.array(solid.half, float)
    if solid.kind == "capsule":
        top = abs(pose[2, 2]) * half[2] + half[0]
        half[2] += half[0]
    else:
        top = float(np.abs(pose[2, :3]) @ half)
    return Ledge(float(pose[2, 3] + top), pose[:2, 3], pose[:2, :3] * half)


def _rotation(quat: np.ndarray) -> np.ndarray:
    out = np.zeros(9)
    mujoco.mju_quat2Mat(out, quat)
    return out.reshape(3, 3)


def _overlap(a: tuple[np.ndarray, np.ndarray], b: tuple[np.ndarray, np.ndarray]) -> bool:
    """Whether two footprints (centre, half sides as columns) overlap: no side's direction separates them."""
    between = b[0] - a[0]
    for side in (*a[1].T, *b[1].T):
        length = np.linalg.norm(side)
        if length < LEAST_LEDGE:
            continue
        axis = side / length
        if abs(float(axis @ between)) > np.abs(axis @ a[1]).sum() + np.abs(axis @ b[1]).sum():
            return False
    return True
