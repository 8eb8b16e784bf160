"""Things of one colour that stand on each other: cut where a level carries something narrower, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest

from perception.detection.colour_shape import ColourShapeDetector
from perception.frames import RgbdFrame
from perception.geometry.prepared_frame import PreparedFrame
from perception.geometry.stacks import Ground, StackPart, filled_share, own_pixels, split_stack, whole_stack
from perception.interfaces import Detection
from perception.pipeline import perception_from_options
from planning.language.relations import find_relations
from tests.support.scenes.perception_scenes import BLUE, GREEN, RED, Thing, cube, render

CRATE = Thing("box", (0.055, 0.055, 0.03), (0.5, 0.0, 0.03), RED, 0.3)
ON_CRATE = cube(RED, 0.51, 0.005, bottom=0.06, yaw=1.0, half=0.025)
ABOVE = {"eye": (0.56, 0.0, 0.75), "target": (0.5, 0.0, 0.0)}


def parts_in(frame: RgbdFrame) -> list[StackPart]:
    """Parts of everything in a picture that is not grey."""
    ground = Ground(PreparedFrame.of(frame))
    coloured = np.ptp(frame.colour.astype(int), axis=-1) > 60
    return split_stack(coloured & ~(ground.heights < 0.006), ground)


@pytest.fixture(scope="module")
def red_stack() -> RgbdFrame:
    return render([CRATE, ON_CRATE])


@pytest.mark.parametrize("view", [{}, ABOVE], ids=["slanted", "from above"])
def test_a_cube_on_a_crate_of_its_colour_is_two_parts(view):
    upper, lower = parts_in(render([CRATE, ON_CRATE], **view))
    assert upper.sizes == pytest.approx([0.05] * 3, abs=0.01)
    assert lower.sizes == pytest.approx([0.11, 0.11, 0.06], abs=0.012)
    assert not (upper.pixels & lower.pixels).any() and not (upper.pixels & ~lower.rest).any()


def test_where_the_lower_thing_has_no_depth_nothing_is_cut(red_stack):
    heights = PreparedFrame.of(red_stack).heights
    lost = (heights > 0.006) & (heights < 0.07)
    assert parts_in(replace(red_stack, depth=np.where(lost, np.nan, red_stack.depth).astype(np.float32))) == []


UPON = {
    "can": Thing("cylinder", (0.033, 0.033, 0.055), (0.5, 0.0, 0.115), GREEN),
    "ball": Thing("sphere", (0.03, 0.03, 0.03), (0.5, 0.0, 0.09), GREEN),
    "small cube": cube(GREEN, 0.5, 0.0, bottom=0.06, half=0.02),
}


@pytest.mark.parametrize("upper", UPON)
def test_other_things_on_a_box_of_their_colour_are_parts_too(upper):
    box = Thing("box", (0.07, 0.05, 0.03), (0.5, 0.0, 0.03), GREEN, 0.6)
    found = parts_in(render([box, UPON[upper]]))
    assert len(found) == 2
    assert found[0].sizes == pytest.approx(2 * np.array(UPON[upper].half), abs=0.018)


def test_three_things_on_each_other_are_three_parts_upper_ones_first():
    base = Thing("box", (0.08, 0.08, 0.02), (0.5, 0.0, 0.02), BLUE, 0.3)
    middle = Thing("box", (0.05, 0.05, 0.02), (0.5, 0.0, 0.06), BLUE, 0.3)
    found = parts_in(render([base, middle, cube(BLUE, 0.5, 0.0, bottom=0.08, half=0.02)]))
    assert [round(float(part.sizes[0]), 2) for part in found] == [0.04, 0.10, 0.16]


ALONE = {
    "cube": [cube(RED, 0.5, 0.0)],
    "flat box": [CRATE],
    "tall box": [Thing("box", (0.03, 0.04, 0.10), (0.5, 0.0, 0.10), RED, 0.5)],
    "can": [Thing("cylinder", (0.033, 0.033, 0.058), (0.5, 0.0, 0.058), RED)],
    "ball": [Thing("sphere", (0.04, 0.04, 0.04), (0.5, 0.0, 0.04), RED)],
    "two equal cubes": [cube(RED, 0.5, 0.0), cube(RED, 0.5, 0.0, bottom=0.06)],
    "kettle": [
        Thing("cylinder", (0.05, 0.05, 0.06), (0.5, 0.0, 0.06), RED),
        Thing("box", (0.006, 0.006, 0.03), (0.5, 0.04, 0.15), RED, 0.0),
        Thing("box", (0.006, 0.006, 0.03), (0.5, -0.04, 0.15), RED, 0.0),
        Thing("box", (0.006, 0.046, 0.006), (0.5, 0.0, 0.186), RED, 0.0),
    ],
}


@pytest.mark.parametrize("view", [{}, ABOVE], ids=["slanted", "from above"])
@pytest.mark.parametrize("single", ALONE)
def test_a_single_thing_is_not_cut_in_two(single, view):
    for seed in range(3):
        assert parts_in(render(ALONE[single], seed=seed, **view)) == []


@pytest.mark.parametrize("names", [("red_cube", "red_crate"), ("red_crate", "red_cube")])
def test_each_name_takes_its_part_in_any_order(red_stack, names):
    seen = perception_from_options("colour").perceive([red_stack], names)
    assert set(seen.names) == set(names)
    for thing, extents in (("red_cube", [0.05, 0.05, 0.05]), ("red_crate", [0.11, 0.11, 0.06])):
        found = seen.get(thing)
        assert found is not None and found.extents == pytest.approx(extents, abs=0.006)
    assert [str(relation) for relation in find_relations(seen)] == ["red_cube is on red_crate"]


def test_masks_keep_to_the_cut(red_stack):
    upper, lower = parts_in(red_stack)
    seen = perception_from_options("colour").perceive([red_stack], ["red_crate", "red_cube"])
    for name, own, other in (("red_crate", lower, upper), ("red_cube", upper, lower)):
        found = seen.get(name)
        assert found is not None
        mask = found.evidence[0].mask
        assert (mask & other.pixels).sum() < 0.05 * other.pixels.sum()
        assert (mask & own.pixels).sum() > 0.9 * own.pixels.sum()


def test_a_small_cube_beside_a_crate_is_the_cube_in_any_order():
    frame = render([CRATE, cube(RED, 0.45, 0.2, half=0.025)])
    for names in (["red_cube", "red_crate"], ["red_crate", "red_cube"], ["red_cube"]):
        found = perception_from_options("colour").perceive([frame], names).get("red_cube")
        assert found is not None and found.position[1] == pytest.approx(0.2, abs=0.01)


def test_a_word_that_says_nothing_of_sizes_means_the_whole(red_stack):
    (found,) = ColourShapeDetector().detect(red_stack, ["red gadget"])
    upper, lower = parts_in(red_stack)
    assert found.rest is None and found.seed is not None
    assert (found.seed & upper.pixels).any() and (found.seed & lower.pixels).any()


def test_pixels_go_to_the_nearer_part():
    own, rest, mask = np.zeros((3, 10, 20), bool)
    own[:, :8], rest[:, 12:], mask[2:8, 2:18] = True, True, True
    kept = own_pixels(mask, own, rest)
    assert kept[2:8, 2:9].all() and not kept[:, 11:].any() and not (kept & ~mask).any()


def test_a_part_is_segmented_with_all_that_looks_the_same():
    own, rest = np.zeros((2, 10, 20), bool)
    own[2:4, 5:8], rest[4:9, 3:12] = True, True
    whole = whole_stack(Detection("red cube", np.array([5.0, 2.0, 8.0, 4.0]), 0.8, own, rest=rest))
    assert whole.rest is None and whole.seed is not None
    assert np.array_equal(whole.seed, own | rest)
    assert whole.box_px == pytest.approx([3, 2, 12, 9])


def test_the_less_a_stack_fills_its_prism_the_less_it_is_one_thing():
    nothing = np.zeros((2, 2), bool)
    cube_on_crate = [StackPart(nothing, nothing, np.array(s)) for s in ([0.05] * 3, [0.1, 0.1, 0.05])]
    assert filled_share(cube_on_crate) == pytest.approx((0.05**3 + 0.1**2 * 0.05) / (0.1**2 * 0.1))
    assert filled_share(cube_on_crate[1:]) == pytest.approx(1.0)
