"""What a run has looked into: depth of its cameras, the robot where it is, and things that fill their place."""

import numpy as np

from benchmarks.scenes.estimates import estimate, scene
from control.robot.limits import REST_Q
from perception.frames import CameraIntrinsics, RgbdFrame
from perception.seen_space import FREE, OCCUPIED, UNSEEN
from replan.run.looked_into import LookedInto
from sim_check.cells.loading import load_cell

LENS = CameraIntrinsics(width=80, height=60, fx=80.0, fy=80.0, cx=39.5, cy=29.5)
REST = np.array(REST_Q)


def from_above(x, y, depth=1.0):
    """A camera 1 m above the table that looks straight down and sees nothing but the table."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = x, y, 1.0
    picture = np.full((LENS.height, LENS.width), depth, np.float32)
    return RgbdFrame(np.zeros((*picture.shape, 3), np.uint8), picture, LENS, pose, 1.0, "above")


def state_at(seen, x, y, z):
    i, j, k = np.floor((np.array([x, y, z]) - seen.low) / seen.step).astype(int)
    return seen.state[i, j, k]


def test_a_look_knows_what_its_cameras_show_where_the_robot_is_and_what_things_fill():
    things = scene(estimate("red_cube", (-0.25, 0.55, 0.05), (0.1, 0.1, 0.1)))
    seen = LookedInto(load_cell("cubes")).after([from_above(0.5, 0.5)], things, REST, 0.08)
    assert state_at(seen, 0.51, 0.51, 0.31) == FREE
    assert state_at(seen, 0.01, 0.01, 0.15) == FREE  # the robot's base, out of the picture
    assert state_at(seen, -0.25, 0.55, 0.05) == OCCUPIED
    assert state_at(seen, 0.5, -0.6, 0.3) == UNSEEN


def test_the_inside_of_furniture_is_not_filled():
    cell = load_cell("cabinet-closed")
    (name,) = [n for n in cell.furniture if "cabinet" in n]
    things = scene(estimate(name, (0.7, -0.3, 0.2), (0.3, 0.4, 0.4)))
    seen = LookedInto(cell).after([from_above(0.2, 0.5)], things, REST, 0.08)
    assert state_at(seen, 0.7, -0.3, 0.2) == UNSEEN


def test_a_further_look_adds_to_the_one_before_only_while_nothing_has_moved():
    looked = LookedInto(load_cell("cubes"))
    first = looked.after([from_above(0.5, 0.5)], scene(), REST, 0.08)
    both = looked.after([from_above(0.5, -0.5)], scene(), REST, 0.08, unchanged=True)
    anew = looked.after([from_above(0.5, -0.5)], scene(), REST, 0.08)
    there, here = (0.51, 0.51, 0.31), (0.51, -0.49, 0.31)
    assert [state_at(s, *there) == FREE for s in (first, both, anew)] == [True, True, False]
    assert [state_at(s, *here) == FREE for s in (first, both, anew)] == [False, True, True]
