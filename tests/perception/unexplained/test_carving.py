"""What a depth picture shows to be free is what lies before its surfaces, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from perception.errors import FrameError
from perception.frames import CameraIntrinsics, RgbdFrame
from perception.seen_space import FREE, OCCUPIED, UNSEEN, SeenSpace
from perception.unexplained.carving import POOL, below, filled, look_into
from perception.unexplained.regions import PlacedSolid

LENS = CameraIntrinsics(width=160, height=120, fx=150.0, fy=150.0, cx=79.5, cy=59.5)
HEIGHT = 0.6  # [m] of the camera, which looks straight down; its picture spans 64 x 48 cm of the table
BOX = SeenSpace.unseen(np.array([-0.5, -0.5, 0.0]), np.array([0.5, 0.5, 0.5]))


def looking_down(depth):
    """A frame from above; right in the picture is the world's x, down its -y."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = HEIGHT
    colour = np.zeros((LENS.height, LENS.width, 3), np.uint8)
    return RgbdFrame(colour, depth.astype(np.float32), LENS, pose, 1.0, "above")


def table(block=0.0):
    """Depth of the table, with a block of this height in the middle 40 x 40 pixels."""
    depth = np.full((LENS.height, LENS.width), HEIGHT)
    depth[40:80, 60:100] = HEIGHT - block
    return depth


def state_at(space, x, y, z):
    i, j, k = np.floor((np.array([x, y, z]) - space.low) / space.step).astype(int)
    return space.state[i, j, k]


def test_space_is_free_before_a_surface_and_not_seen_behind_it_or_beside_the_picture():
    seen = look_into(BOX, [looking_down(table(block=0.2))])
    assert state_at(seen, 0.01, 0.01, 0.31) == FREE
    assert state_at(seen, 0.01, 0.01, 0.21) == OCCUPIED
    assert state_at(seen, 0.01, 0.01, 0.11) == UNSEEN
    assert state_at(seen, 0.25, 0.01, 0.11) == FREE
    assert state_at(seen, 0.25, 0.01, 0.01) == OCCUPIED
    assert state_at(seen, 0.45, 0.01, 0.11) == UNSEEN
    assert np.count_nonzero(BOX.state) == 0


def test_where_depth_is_unknown_nothing_is_seen():
    depth = table()
    depth[:, :80] = np.nan
    seen = look_into(BOX, [looking_down(depth)])
    assert state_at(seen, -0.15, 0.01, 0.11) == UNSEEN and state_at(seen, 0.15, 0.01, 0.11) == FREE
    blind = look_into(BOX, [looking_down(np.full_like(depth, np.nan))])
    assert blind.share_seen == 0.0


def test_a_thing_that_the_ray_through_a_voxels_middle_misses_keeps_it_from_being_free():
    depth = table()
    row, column = POOL * 7, POOL * 12
    depth[row, column] = HEIGHT - 0.3  # one pixel of a thin pole
    beside = (column + 4 - LENS.cx) / LENS.fx * 0.4
    across = -(row + 4 - LENS.cy) / LENS.fy * 0.4
    without, with_pole = (look_into(BOX, [looking_down(d)]) for d in (table(), depth))
    assert state_at(without, beside, across, 0.21) == FREE
    assert state_at(with_pole, beside, across, 0.21) == UNSEEN


def test_noise_of_far_depth_widens_the_margin_before_a_surface():
    wide = SeenSpace.unseen(np.array([-0.5, -0.5, -1.5]), np.array([0.5, 0.5, 0.5]))
    deep = look_into(wide, [looking_down(np.full((LENS.height, LENS.width), 2.0))])
    # At 2 m through this lens one spread of the depth is 106 mm.
    assert state_at(deep, 0.01, 0.01, -1.05) == FREE
    assert state_at(deep, 0.01, 0.01, -1.15) == OCCUPIED


def test_two_looks_have_seen_what_either_has_seen():
    left, right = table(), table()
    left[:, :80] = np.nan
    right[:, 80:] = np.nan
    one, two = (look_into(BOX, [looking_down(d)]) for d in (left, right))
    both = one.united(two)
    assert both.share_seen > max(one.share_seen, two.share_seen)
    assert np.array_equal(both.state, look_into(one, [looking_down(right)]).state)
    with pytest.raises(FrameError, match="two looks can be united only over one box"):
        one.united(replace(two, low=two.low + 0.1))


def test_what_a_solid_fills_is_known_and_so_is_what_lies_below_the_table():
    turned = np.eye(4)
    turned[:3, :3] = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    turned[:3, 3] = 0.0, 0.0, 0.2
    solid = PlacedSolid("box", np.array([0.2, 0.06, 0.1]), turned)
    space = filled(BOX, [solid], FREE)
    assert np.count_nonzero(space.state) * space.step**3 == pytest.approx(8 * 0.2 * 0.06 * 0.1)
    assert state_at(space, 0.01, 0.15, 0.21) == FREE and state_at(space, 0.15, 0.01, 0.21) == UNSEEN
    outside = PlacedSolid("sphere", np.full(3, 0.1), np.eye(4) + np.array([0.0, 0.0, 0.0, 1.0]) * 5)
    assert np.array_equal(filled(BOX, [outside], FREE).state, BOX.state)
    low = below(space, 0.1)
    assert (low.state[:, :, :5] == OCCUPIED).all() and np.array_equal(low.state[:, :, 5:], space.state[:, :, 5:])
