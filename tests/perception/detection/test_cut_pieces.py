"""Things that something nearer cuts into pieces."""

import numpy as np
import pytest

from perception.detection.cut_pieces import join_cut
from perception.pipeline import perception_from_options
from tests.support.scenes.perception_scenes import GREEN, RED, Thing, render


def blob(*columns: tuple[int, int]) -> np.ndarray:
    pixels = np.zeros((60, 120), bool)
    for first, last in columns:
        pixels[20:32, first:last] = True
    return pixels


def depth_with(post: float) -> np.ndarray:
    depth = np.full((60, 120), 1.0)
    depth[:, 50:60] = post
    return depth


def test_pieces_on_both_sides_of_something_nearer_are_one_thing():
    left, right, whole = join_cut([blob((10, 50)), blob((60, 100))], depth_with(0.9))
    assert left.behind is None and right.behind is None
    assert whole.behind is not None
    assert np.array_equal(whole.pixels, blob((10, 50), (60, 100)))
    assert np.array_equal(whole.whole, blob((10, 100)))


def test_three_pieces_become_one():
    depth = np.full((60, 120), 1.0)
    depth[:, 40:50] = depth[:, 70:80] = 0.9
    found = join_cut([blob((10, 40)), blob((50, 70)), blob((80, 110))], depth)
    assert len(found) == 4
    assert np.array_equal(found[-1].whole, blob((10, 110)))


@pytest.mark.parametrize("between", [1.0, 1.1])
def test_two_things_with_nothing_nearer_between_them_stay_two(between):
    assert len(join_cut([blob((10, 50)), blob((60, 100))], depth_with(between))) == 2


def test_what_a_wide_thing_hides_is_not_guessed():
    depth = np.full((60, 120), 1.0)
    depth[:, 30:90] = 0.9
    assert len(join_cut([blob((10, 30)), blob((90, 110))], depth)) == 2


def test_a_bar_behind_a_post_is_one_bar():
    bar = Thing("box", (0.12, 0.012, 0.02), (0.45, 0.0, 0.02), RED, yaw=np.pi / 2)
    post = Thing("box", (0.006, 0.006, 0.05), (0.52, 0.02, 0.05), GREEN)
    (seen,) = perception_from_options("colour").perceive([render([bar, post])], ["red_bar"]).objects
    assert max(seen.extents) == pytest.approx(0.24, abs=0.015)
    assert seen.position == pytest.approx(bar.position, abs=0.01)
