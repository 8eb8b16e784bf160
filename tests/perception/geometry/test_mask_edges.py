"""Where a mask ends, and whether the thing does: what lies beyond its edge, and what that does to spreads."""

from dataclasses import replace

import numpy as np
import pytest

from perception.detection.given import GivenMasks
from perception.frames import RgbdFrame
from perception.geometry.free_form import with_unseen_rest
from perception.geometry.mask_edges import MaskEdges, mask_edges
from perception.geometry.outline import longest_contour
from perception.geometry.prepared_frame import PreparedFrame
from perception.geometry.refinement import Refined
from perception.geometry.shape_choice import Kind, with_others
from perception.geometry.solids import Solid
from perception.pipeline import Perception
from tests.support.scenes.perception_scenes import RED, Thing, cube, render


@pytest.fixture(scope="module")
def frame() -> RgbdFrame:
    return render([cube(RED, 0.5, 0.0, half=0.04)])


@pytest.fixture(scope="module")
def cube_mask(frame) -> np.ndarray:
    return (frame.colour[..., 0] > 60) & (frame.colour[..., 1] < 0.5 * frame.colour[..., 0])


def edges_of(frame: RgbdFrame, mask: np.ndarray) -> MaskEdges:
    return mask_edges(PreparedFrame.of(frame), longest_contour(mask), mask, 0.0)


def seen_as(frame: RgbdFrame, mask: np.ndarray, name: str = "red_block"):
    by_hand = GivenMasks({name: mask})
    found = Perception(by_hand, by_hand).perceive([frame], [name]).get(name)
    assert found is not None
    return found


def test_a_whole_cube_on_a_table_ends_where_its_mask_does(frame, cube_mask):
    edges = edges_of(frame, cube_mask)
    assert edges.ends.mean() > 0.85
    assert edges.unseen_share < 0.15


def test_a_mask_that_stops_halfway_down_touches_the_rest_of_the_thing(frame, cube_mask):
    upper = cube_mask.copy()
    upper[np.flatnonzero(cube_mask.any(1)).mean().astype(int) :] = False
    contour = longest_contour(upper)
    lower_edge = contour[:, 1] == contour[:, 1].max()
    assert edges_of(frame, upper).touching[lower_edge].mean() > 0.7


def test_a_mask_spilt_over_the_table_does_not_end_there(frame, cube_mask):
    spilt = cube_mask.copy()
    rows, columns = np.flatnonzero(cube_mask.any(1)), np.flatnonzero(cube_mask.any(0))
    spilt[rows[-1] - 10 : rows[-1] + 30, columns[0] : columns[-1]] = True
    contour = longest_contour(spilt)
    lower_edge = contour[:, 1] == contour[:, 1].max()
    assert edges_of(frame, spilt).spilt[lower_edge].mean() > 0.7


def test_beyond_an_edge_without_depth_nothing_is_known(frame, cube_mask):
    depth = np.where(cube_mask, frame.depth, np.nan).astype(np.float32)
    edges = edges_of(replace(frame, depth=depth), cube_mask)
    assert edges.unknown.all()
    assert edges.unseen_share == pytest.approx(0.3)


def test_half_a_cube_behind_a_board_is_longer_than_it_looks_or_says_so():
    board = Thing("box", (0.005, 0.10, 0.08), (0.56, 0.10, 0.08), (0.3, 0.3, 0.8))
    hidden = render([Thing("box", (0.03, 0.06, 0.03), (0.5, 0.0, 0.03), RED), board])
    mask = (hidden.colour[..., 0] > 60) & (hidden.colour[..., 1] < 0.5 * hidden.colour[..., 0])
    mask &= hidden.colour[..., 2] < 0.5 * hidden.colour[..., 0]
    found = seen_as(hidden, mask)
    side = int(np.argmax(np.abs(found.world_T_object[1, :3])))  # the axis along which it goes on behind the board
    missing = 0.12 - found.extents[side]
    assert missing > 0.02
    assert found.extents_std is not None and found.extents_std[side] > missing / 2.0
    assert abs(found.position[1]) < 2.0 * found.position_std[1]


def test_a_foot_out_of_sight_makes_the_height_unsure(frame, cube_mask):
    rail = Thing("box", (0.005, 0.12, 0.035), (0.59, 0.0, 0.035), (0.3, 0.3, 0.8))
    hidden = render([cube(RED, 0.5, 0.0, half=0.04), rail])
    mask = (hidden.colour[..., 0] > 60) & (hidden.colour[..., 1] < 0.5 * hidden.colour[..., 0])
    open_foot, hidden_foot = seen_as(frame, cube_mask), seen_as(hidden, mask)
    assert open_foot.extents_std is not None and hidden_foot.extents_std is not None
    assert hidden_foot.extents_std[2] > 0.004 > open_foot.extents_std[2]


def refined(extents: tuple[float, float, float], yaw: float = 0.0) -> Refined:
    solid = Solid("box", np.array([0.5, 0.0, extents[2] / 2]), yaw, np.array(extents))
    return Refined(solid, np.full(3, 0.001), 0.01, 1.0, np.full(3, 0.001))


def test_a_thing_of_any_form_of_which_a_third_of_the_outline_is_hidden_may_be_two_thirds_longer():
    wider = with_unseen_rest(refined((0.10, 0.05, 0.08)), 1 / 3)
    assert wider.extents_std == pytest.approx((0.0667, 0.0667, 0.001), abs=1e-4)
    assert wider.position_std[:2] == pytest.approx(wider.extents_std[:2] / 2, abs=1e-4)
    assert with_unseen_rest(refined((0.10, 0.05, 0.08)), 0.05).extents_std == pytest.approx(0.001)


def test_a_box_that_may_as_well_be_a_lying_can_has_the_spread_between_both():
    both: dict[Kind, Refined] = {
        "box": refined((0.05, 0.13, 0.06)),
        "lying cylinder": refined((0.13, 0.07, 0.07), np.pi / 2),
    }
    chosen = with_others("box", {"box": 0.75, "lying cylinder": 0.25}, both)
    assert chosen.extents_std == pytest.approx(np.hypot(0.001, 0.5 * np.array([0.02, 0.0, 0.01])))
    assert chosen.position_std[2] == pytest.approx(np.hypot(0.001, 0.5 * 0.005))
