"""Bowls: a foot, a leaning wall and a floor that things lie on."""

import numpy as np

from sim_check.objects.solids import Built, SolidShape

SEGMENTS = 16  # boards of the wall
# Shares of a bowl's outer radius (wall, foot) and of its height (floor); a soup bowl's proportions.
WALL, FOOT, FLOOR = 0.065, 0.66, 0.11
# Gap under the wall in [m], so that a bowl stands on its foot alone.
LIFT = 0.0015


def bowl_profile(extents: np.ndarray) -> np.ndarray:
    """Outline of a bowl's wall, in the plane of radius and height above its lowest point.

    The outer face runs from the foot (radius 0.66 R) to the rim; the wall has the same thickness t all along. With
    the lean a of the wall against the vertical and the length L of its faces, the rim's highest point is the inner
    face's end, and the outer face's end is the widest point:

        lift + L cos(a) + t sin(a) = height        0.66 R + L sin(a) = R

    Args:
        extents: Full sizes in [m], shape (3,).

    Returns:
        Foot and rim of the outer face, then rim and foot of the inner face: (radius, height) in [m], shape (4, 2).
    """
    radius, height = (extents[0] + extents[1]) / 4, extents[2]
    thickness, foot = WALL * radius, FOOT * radius
    lean = 0.0
    for _ in range(20):  # a fixed point: thickness is small against the height
        lean = np.arctan2(radius - foot, height - LIFT - thickness * np.sin(lean))
    length = (radius - foot) / np.sin(lean)
    along, inwards = np.array([np.sin(lean), np.cos(lean)]), np.array([-np.cos(lean), np.sin(lean)])
    low = np.array([foot, LIFT])
    high = low + length * along
    return np.stack([low, high, high + thickness * inwards, low + thickness * inwards])


def bowl(_name: str, sizes: np.ndarray) -> Built:
    """A floor and a ring of leaning boards, in full sizes in [m], shape (3,)."""
    radius = (sizes[0] + sizes[1]) / 4
    sizes = np.array([2 * radius, 2 * radius, sizes[2]])
    low, high, inner_high, inner_low = bowl_profile(sizes)
    centre = (low + high + inner_high + inner_low) / 4
    length, thickness = np.linalg.norm(high - low), np.linalg.norm(inner_low - low)
    lean = np.arctan2(*(high - low))
    floor = max(FLOOR * sizes[2], 2 * LIFT)
    # Boards meet at the rim; further down they overlap.
    half = np.array([thickness, 2 * np.tan(np.pi / SEGMENTS) * high[0], length]) / 2
    solids = [SolidShape("cylinder", np.array([low[0], low[0], floor / 2]), np.array([0, 0, (floor - sizes[2]) / 2]))]
    for angle in 2 * np.pi * np.arange(SEGMENTS) / SEGMENTS:
        position = np.array([centre[0] * np.cos(angle), centre[0] * np.sin(angle), centre[1] - sizes[2] / 2])
        turn, tilt = np.array([angle, lean]) / 2
        # About z by the segment's angle, then about its y by the lean.
        quat = np.array(
            [
                np.cos(turn) * np.cos(tilt),
                -np.sin(turn) * np.sin(tilt),
                np.cos(turn) * np.sin(tilt),
                np.sin(turn) * np.cos(tilt),
            ]
        )
        solids.append(SolidShape("box", half, position, quat))
    return Built(tuple(solids), sizes, float(floor), float(inner_high[0]))
