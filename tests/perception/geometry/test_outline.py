"""Round or angular, where something nearer or the picture's border cuts what is seen."""

import cv2
import numpy as np
import pytest

from perception.geometry.outline import Outline, measure_outline

SHAPE = (80, 80)
FAR, NEAR = 1.65, 0.98  # [m], the thing and what is before it


def disc(x: float = 40.0, y: float = 40.0, radius: float = 11.0) -> np.ndarray:
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    return (u - x) ** 2 + (v - y) ** 2 < radius**2


def square(half: float = 10.0, turn: float = 20.0) -> np.ndarray:
    corners = cv2.boxPoints(((40.0, 40.0), (2 * half, 2 * half), turn)).astype(np.int32)
    filled = np.zeros(SHAPE, np.uint8)
    cv2.fillConvexPoly(filled, corners, 1)
    return filled > 0


def behind_a_finger(thing: np.ndarray) -> Outline:
    """A finger that reaches in from above, somewhat left of the middle, hides part of the thing."""
    finger = np.zeros(SHAPE, bool)
    finger[:40, 33:42] = True
    depth = np.where(finger, NEAR, np.where(thing, FAR, FAR + 0.1))
    outline = measure_outline(thing & ~finger, depth)
    assert outline is not None
    return outline


def test_a_ball_behind_a_finger_is_round():
    assert behind_a_finger(disc()).roundness > 0.62


@pytest.mark.parametrize("turn", [0.0, 20.0, 45.0])
def test_a_cube_behind_a_finger_is_angular(turn):
    assert behind_a_finger(square(turn=turn)).roundness < 0.5


def test_what_a_finger_hides_of_a_thing_is_not_missing_from_it():
    assert behind_a_finger(disc()).fill > 0.9


def test_what_is_open_to_something_farther_is_missing_from_a_thing():
    gap = np.zeros(SHAPE, bool)
    gap[:40, 33:42] = True
    thing = disc() & ~gap
    outline = measure_outline(thing, np.where(thing, FAR, FAR + 0.1))
    assert outline is not None and outline.fill < 0.85


def test_a_stem_at_the_border_of_the_picture_does_not_make_a_ball_angular():
    ball = disc(y=25.0, radius=28.0)
    ball[:2, 39:42] = False
    outline = measure_outline(ball, np.where(ball, FAR, FAR + 0.1))
    assert outline is not None and outline.roundness > 0.75
