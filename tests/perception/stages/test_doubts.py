"""What cannot be right, or says too little to take hold of it, says so and stays in the scene."""

from dataclasses import replace

import numpy as np
import pytest

from perception.detection.given import GivenMasks
from perception.estimates import ObjectEstimate
from perception.geometry.prepared_frame import PreparedFrame
from perception.geometry.solids import Solid
from perception.pipeline import Perception, default_perception
from perception.stages.doubts import with_doubts
from tests.support.scenes.perception_scenes import RED, YELLOW, cube, render


@pytest.fixture(scope="module")
def table() -> PreparedFrame:
    return PreparedFrame.of(render([cube(RED, 0.5, 0.0)]))


def thing(name: str, x: float, bottom: float = 0.0, size: float = 0.06, spread: float = 0.001) -> ObjectEstimate:
    solid = Solid("box", np.array([x, 0.3, bottom + size / 2]), 0.2, np.full(3, size))
    return ObjectEstimate(
        name,
        name.replace("_", " "),
        solid.pose,
        solid.extents,
        "box",
        np.full(3, spread),
        0.01,
        0.9,
        0.0,
        extents_std=np.full(3, 2 * spread),
    )


def doubts_of(frame: PreparedFrame, *things: ObjectEstimate, fixed: tuple[str, ...] = ()) -> dict[str, tuple[str, ...]]:
    return {o.name: o.doubts for o in with_doubts(things, [frame], fixed)}


def test_things_on_the_table_and_on_each_other_are_not_doubted(table):
    found = doubts_of(table, thing("red_cube", 0.5), thing("blue_cube", 0.5, bottom=0.06), thing("green_cube", 0.58))
    assert found == {"red_cube": (), "blue_cube": (), "green_cube": ()}


def test_a_thing_that_nothing_carries_floats(table):
    found = doubts_of(table, thing("red_cube", 0.5, bottom=0.20))
    assert found["red_cube"] == ("nothing carries it: it would float 200 mm above the table",)


def test_what_stands_on_something_that_nobody_named_does_not_float():
    frame = render([cube(YELLOW, 0.5, 0.0, half=0.05), cube(RED, 0.5, 0.0, bottom=0.10)])
    mask = (frame.colour[..., 0] > 60) & (frame.colour[..., 1] < 0.5 * frame.colour[..., 0])
    by_hand = GivenMasks({"red_cube": mask})
    found = Perception(by_hand, by_hand).perceive([frame], ["red_cube"]).get("red_cube")
    assert found is not None
    assert found.position[2] == pytest.approx(0.13, abs=0.01)
    assert found.doubts == ()


def test_two_things_in_one_volume_are_both_doubted(table):
    found = doubts_of(table, thing("red_cube", 0.5), thing("red_cube_2", 0.51))
    assert found["red_cube"] == ("it fills the same place as 'red_cube_2'",)
    assert found["red_cube_2"] == ("it fills the same place as 'red_cube'",)


def test_what_lies_in_a_bowl_or_stands_in_furniture_shares_its_volume_rightly(table):
    assert doubts_of(table, thing("bowl", 0.5, size=0.14), thing("red_cube", 0.5)) == {"bowl": (), "red_cube": ()}
    found = doubts_of(table, thing("cabinet", 0.5, size=0.4), thing("red_cube", 0.5, bottom=0.1), fixed=("cabinet",))
    assert found == {"cabinet": (), "red_cube": ()}


def test_spreads_that_explain_an_overlap_raise_no_doubt(table):
    apart = thing("red_cube", 0.5), thing("blue_cube", 0.53, spread=0.01)
    assert doubts_of(table, *apart) == {"red_cube": (), "blue_cube": ()}


def test_sizes_that_are_not_seen_on_two_sides_are_said_to_be_so(table):
    vague = replace(thing("kettle", 0.5), extents_std=np.array([0.05, 0.04, 0.002]))
    assert doubts_of(table, vague)["kettle"] == ("its sizes are not seen on two sides (60 ± 50 mm and 60 ± 40 mm)",)
    one_side = replace(thing("kettle", 0.5), extents_std=np.array([0.05, 0.004, 0.002]))
    assert doubts_of(table, one_side)["kettle"] == ()


def test_a_place_that_is_hardly_known_is_said_to_be_so(table):
    vague = replace(thing("kettle", 0.5), position_std=np.array([0.03, 0.002, 0.002]))
    assert doubts_of(table, vague)["kettle"] == ("its place is known to ± 30 mm only",)


def test_where_every_other_pixel_has_no_depth_things_are_whole_and_their_score_is_lower():
    frame = render([cube(RED, 0.5, -0.1), cube(YELLOW, 0.5, 0.1)])
    depth = np.where(np.random.default_rng(0).random(frame.depth.shape) < 0.6, np.nan, frame.depth)
    lost = replace(frame, depth=depth.astype(np.float32))
    looker = default_perception()
    names = ["red_cube", "yellow_cube"]
    whole, holed = looker.perceive([frame], names), looker.perceive([lost], names)
    for name in names:
        before, after = whole.get(name), holed.get(name)
        assert before is not None and after is not None
        assert after.extents == pytest.approx((0.06, 0.06, 0.06), abs=0.005)
        assert after.evidence[0].depth_share == pytest.approx(0.4, abs=0.05)
        assert after.score < 0.7 * before.score
        assert np.linalg.norm(after.position_std) > np.linalg.norm(before.position_std)


@pytest.mark.parametrize("scale", [0.98, 1.02])
def test_depth_that_shows_the_table_elsewhere_makes_places_unsure(scale):
    frame = render([cube(RED, 0.5, 0.0)])
    off = replace(frame, depth=(frame.depth * scale).astype(np.float32))
    looker = default_perception()
    sure, unsure = looker.perceive([frame], ["red_cube"]), looker.perceive([off], ["red_cube"])
    before, after = sure.get("red_cube"), unsure.get("red_cube")
    assert before is not None and after is not None
    error = np.abs(after.position - (0.5, 0.0, 0.03))
    assert error.max() > 0.006  # it is elsewhere by about the share of its distance
    assert (error < 2.0 * after.position_std).all()
    assert np.linalg.norm(after.position_std) > 3.0 * np.linalg.norm(before.position_std)
