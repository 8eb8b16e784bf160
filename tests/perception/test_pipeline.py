"""From frames to named poses: how near, what when hidden, what when the camera fails."""

from dataclasses import replace

import numpy as np
import pytest

from perception.errors import FrameError, UnknownPhraseError
from perception.estimates import ObjectEstimate, SceneEstimate
from perception.frames import RgbdFrame
from perception.geometry.ply import write_ply
from perception.interfaces import Detection
from perception.pictures import overlay
from perception.pipeline import STAGES, Perception, default_perception, perception_from_options
from tests.support.scenes.perception_scenes import BLUE, GREEN, RED, WOOD, YELLOW, Thing, cube, render

# Stereo noise at 0.8 m is 5 mm a point; outlines and averages bring a centre to 1 to 2 mm, seldom to 4.
NEAR = 0.005
CRATE = Thing("box", (0.06, 0.06, 0.03), (0.55, -0.18, 0.03), WOOD, 0.2)


def look(things, *names, **options):
    return default_perception().perceive([render(things, **options)], names)


def seen(scene: SceneEstimate, name: str) -> ObjectEstimate:
    found = scene.get(name)
    assert found is not None, scene.unseen
    return found


def seen_from_two_sides(things, *names):
    left = render(things, camera="left", eye=(1.05, -0.35, 0.6))
    right = render(things, camera="right", eye=(1.05, 0.35, 0.6), seed=1)
    return default_perception().perceive([left, right], names), left, right


@pytest.fixture(scope="module")
def stack():
    yellow = cube(YELLOW, 0.55, -0.18, bottom=0.06, yaw=0.5, half=0.025)
    return [CRATE, cube(RED, 0.45, 0.12, half=0.025), yellow]


@pytest.fixture(scope="module")
def stacked(stack):
    return look(stack, "crate", "red_cube", "yellow_cube", "banana")


def test_cubes_and_crate_come_within_five_millimetres(stacked, stack):
    for name, thing in zip(("crate", "red_cube", "yellow_cube"), stack, strict=True):
        assert seen(stacked, name).position == pytest.approx(thing.position, abs=NEAR), name
        assert seen(stacked, name).extents == pytest.approx(2 * np.array(thing.half), abs=0.008), name


def test_yaw_comes_within_three_degrees(stacked, stack):
    for name, thing in zip(("crate", "red_cube", "yellow_cube"), stack, strict=True):
        turn = np.degrees(seen(stacked, name).yaw - thing.yaw)
        assert abs((turn + 45) % 90 - 45) < 3, name


def test_a_cube_on_a_crate_ends_at_the_crate_and_not_at_the_table(stacked):
    on_top = seen(stacked, "yellow_cube")
    assert on_top.position[2] - on_top.extents[2] / 2 == pytest.approx(0.06, abs=NEAR)


def test_a_cube_on_a_crate_that_nobody_named_ends_at_the_crate_too(stack):
    on_top = seen(look(stack, "yellow_cube"), "yellow_cube")
    assert on_top.position[2] - on_top.extents[2] / 2 == pytest.approx(0.06, abs=0.008)


def test_what_is_absent_is_listed_with_a_reason(stacked):
    assert [(u.name, u.reason) for u in stacked.unseen] == [("banana", "no box above the threshold")]


def test_the_estimate_says_who_looked_and_how_long_each_stage_took(stacked):
    assert "not a learned model" in stacked.source and "GrabCut-and-depth" in stacked.source
    assert set(stacked.seconds) == set(STAGES)
    assert stacked.seconds["detect"] > 0


def test_evidence_holds_the_mask_it_came_from(stacked):
    (evidence,) = seen(stacked, "red_cube").evidence
    x0, y0, x1, y1 = evidence.box_px.astype(int)
    assert evidence.camera == "static" and evidence.depth_share > 0.9
    assert evidence.mask[y0 - 3 : y1 + 3, x0 - 3 : x1 + 3].sum() == evidence.mask.sum() > 300


def test_an_apple_and_a_bowl_are_fitted_as_round_things():
    apple = Thing("sphere", (0.035, 0.035, 0.035), (0.45, 0.1, 0.035), RED)
    bowl = Thing("cylinder", (0.07, 0.07, 0.025), (0.55, -0.1, 0.025), BLUE)
    scene = look([apple, bowl], "apple", "bowl")
    assert (seen(scene, "apple").shape, seen(scene, "bowl").shape) == ("sphere", "cylinder")
    for name, thing in (("apple", apple), ("bowl", bowl)):
        assert seen(scene, name).position == pytest.approx(thing.position, abs=NEAR)
        assert seen(scene, name).extents == pytest.approx(2 * np.array(thing.half), abs=0.008)
        assert np.isinf(seen(scene, name).yaw_std)


def test_an_apple_lying_on_top_of_a_full_bowl_is_not_pulled_down_to_its_rim():
    bowl = Thing("cylinder", (0.07, 0.07, 0.025), (0.5, 0.0, 0.025), BLUE)
    apple = Thing("sphere", (0.035, 0.035, 0.035), (0.5, 0.0, 0.105), RED)
    scene = look([bowl, apple], "apple", "bowl")
    assert seen(scene, "apple").position == pytest.approx(apple.position, abs=0.008)


def test_a_lower_end_hidden_by_a_wall_reaches_down_to_the_table():
    wall = Thing("box", (0.01, 0.10, 0.02), (0.62, 0.0, 0.02), GREEN)
    hidden = seen(look([wall, cube(RED, 0.5, 0.0)], "red_cube"), "red_cube")
    assert hidden.position == pytest.approx((0.5, 0.0, 0.03), abs=0.01)
    assert hidden.position[2] - hidden.extents[2] / 2 == pytest.approx(0.0, abs=0.008)


HIDING_WALL = Thing("box", (0.01, 0.06, 0.13), (0.60, 0.06, 0.13), GREEN)


def test_a_half_hidden_block_has_a_larger_spread_that_covers_its_error():
    target = cube(RED, 0.5, 0.0)
    half_hidden, free = (seen(look(things, "red_block"), "red_block") for things in ([HIDING_WALL, target], [target]))
    assert np.linalg.norm(half_hidden.position_std) > 3 * np.linalg.norm(free.position_std)
    off = np.abs(half_hidden.position - target.position)
    assert np.all(off < 3 * half_hidden.position_std)


def test_a_side_that_something_hides_has_a_larger_spread_and_covers_the_true_size():
    target = cube(RED, 0.5, 0.0, yaw=0.0)
    half_hidden, free = (seen(look(things, "red_block"), "red_block") for things in ([HIDING_WALL, target], [target]))
    assert half_hidden.extents_std is not None and free.extents_std is not None
    assert half_hidden.extents_std.max() > 3 * free.extents_std.max()
    assert np.all(np.abs(half_hidden.extents - 0.06) < 3 * half_hidden.extents_std)


@pytest.mark.parametrize(
    "thing, shape",
    [
        (cube(RED, 0.5, 0.0), "box"),
        (Thing("sphere", (0.035, 0.035, 0.035), (0.5, 0.0, 0.035), RED), "sphere"),
        (Thing("cylinder", (0.033, 0.033, 0.05), (0.5, 0.0, 0.05), RED), "cylinder"),
    ],
)
def test_a_thing_of_an_unknown_noun_gets_the_solid_that_its_points_lie_on(thing, shape):
    found = seen(look([thing], "red_thing"), "red_thing")
    assert found.shape == shape
    assert found.extents == pytest.approx(2 * np.array(thing.half), abs=0.008)
    assert np.isfinite(found.yaw_std) == (shape == "box")


KETTLE = (
    Thing("cylinder", (0.05, 0.05, 0.065), (0.5, 0.0, 0.065), BLUE),
    Thing("box", (0.035, 0.009, 0.009), (0.5, 0.0, 0.19), BLUE, 0.5),
    *(
        Thing("box", (0.006, 0.006, 0.03), (0.5 + d * np.cos(0.5), d * np.sin(0.5), 0.16), BLUE, 0.5)
        for d in (-0.03, 0.03)
    ),
    Thing("box", (0.035, 0.012, 0.012), (0.5 + 0.06 * np.cos(0.5), 0.06 * np.sin(0.5), 0.09), BLUE, 0.5),
)


def test_a_thing_that_no_solid_explains_gets_the_box_around_it_along_its_spout_and_a_wide_spread():
    found = seen(look(KETTLE, "blue_thing"), "blue_thing")
    assert found.shape == "box"
    assert found.extents == pytest.approx((0.145, 0.1, 0.199), abs=0.012)
    assert found.position[:2] == pytest.approx(0.0225 * np.array([np.cos(0.5), np.sin(0.5)]) + [0.5, 0.0], abs=0.012)
    assert np.degrees(found.yaw) == pytest.approx(np.degrees(0.5), abs=12.0), "the x axis must point to the spout"
    assert found.extents_std is not None and found.extents_std[:2].min() > 0.008


def test_a_lemon_has_three_sizes_and_the_direction_in_which_it_lies():
    lemon = Thing("ellipsoid", (0.04, 0.028, 0.028), (0.5, 0.0, 0.028), YELLOW, 0.6)
    found = seen(look([lemon], "lemon"), "lemon")
    assert found.shape == "sphere"
    assert found.position == pytest.approx((0.5, 0.0, 0.028), abs=NEAR)
    assert found.extents == pytest.approx((0.08, 0.056, 0.056), abs=0.006)
    assert np.degrees(found.yaw) == pytest.approx(np.degrees(0.6), abs=8.0)


def test_a_lemon_seen_from_two_sides_keeps_its_direction():
    lemon = Thing("ellipsoid", (0.04, 0.028, 0.028), (0.5, 0.0, 0.028), YELLOW, 0.6)
    scene, *_ = seen_from_two_sides([lemon], "lemon")
    assert np.degrees(scene.objects[0].yaw) % 180 == pytest.approx(np.degrees(0.6), abs=8.0)
    assert scene.objects[0].extents == pytest.approx((0.08, 0.056, 0.056), abs=0.006)


def test_a_box_whose_top_leaves_the_picture_has_a_spread_that_covers_its_error():
    tower = Thing("box", (0.04, 0.04, 0.15), (0.5, 0.0, 0.15), RED, 0.3)
    cut = seen(look([tower], "red_block", target=(0.5, 0.0, -0.58)), "red_block")
    assert cut.evidence[0].mask[0].any(), "the tower must touch the border, or this test shows nothing"
    assert cut.extents_std is not None and cut.extents[2] < 0.26, "what lies beyond the border is not seen"
    assert np.all(np.abs(cut.extents - (0.08, 0.08, 0.3)) < 2.5 * cut.extents_std)
    assert np.all(np.abs(cut.position - (0.5, 0.0, 0.15)) < 2.5 * cut.position_std)


def test_a_half_hidden_cube_is_known_to_be_as_wide_as_high():
    half_hidden = seen(look([HIDING_WALL, cube(RED, 0.5, 0.0)], "red_cube"), "red_cube")
    assert half_hidden.position == pytest.approx((0.5, 0.0, 0.03), abs=0.006)
    assert half_hidden.extents == pytest.approx((0.06, 0.06, 0.06), abs=0.012)


def test_a_half_hidden_apple_is_still_an_apple_and_no_cube():
    wall = Thing("box", (0.01, 0.06, 0.08), (0.60, 0.07, 0.08), GREEN)
    scene = look([wall, Thing("sphere", (0.035, 0.035, 0.035), (0.5, 0.0, 0.035), RED)], "apple", "red_cube")
    assert scene.names == ("apple",)
    assert scene.objects[0].position == pytest.approx((0.5, 0.0, 0.035), abs=0.01)


def test_a_block_cut_by_the_picture_has_a_larger_spread():
    target = cube(RED, 0.5, 0.0)
    cut = seen(look([target], "red_block", target=(0.5, 0.68, 0.0)), "red_block")
    free = seen(look([target], "red_block"), "red_block")
    assert cut.evidence[0].mask[:, [0, -1]].any(), "the block must touch the border, or this test shows nothing"
    assert cut.position_std[1] > 2 * free.position_std[1], "the side that the border cuts off lies along y"


def test_one_thing_seen_by_two_cameras_is_one_thing_with_a_smaller_spread():
    scene, left, _ = seen_from_two_sides([cube(RED, 0.5, 0.05)], "red_cube")
    alone = default_perception().perceive([left], ["red_cube"]).objects[0]
    (both,) = scene.objects
    assert {e.camera for e in both.evidence} == {"left", "right"}
    assert np.linalg.norm(both.position_std) < np.linalg.norm(alone.position_std)
    assert both.position == pytest.approx((0.5, 0.05, 0.03), abs=0.003)


def test_a_thing_that_one_of_two_cameras_misses_is_still_seen():
    target = cube(RED, 0.5, 0.05)
    here = render([target])
    elsewhere = render([target], target=(1.5, 3.0, 0.0), camera="away")
    scene = default_perception().perceive([elsewhere, here], ["red_cube"])
    assert [e.camera for e in scene.objects[0].evidence] == ["static"]


def with_depth(frame: RgbdFrame, depth: np.ndarray) -> RgbdFrame:
    return replace(frame, depth=depth.astype(np.float32))


def test_a_frame_without_any_depth_is_refused_with_the_cameras_name():
    frame = render([cube(RED, 0.5, 0.0)])
    blind = with_depth(frame, np.full(frame.depth.shape, np.nan))
    with pytest.raises(FrameError, match=r"camera 'static' at 1\.000 s has no valid depth at all; check that"):
        default_perception().perceive([blind], ["red_cube"])


def test_a_camera_without_depth_is_left_out_and_named_when_another_one_sees():
    frame = render([cube(RED, 0.5, 0.0)])
    blind = replace(with_depth(frame, np.full(frame.depth.shape, np.nan)), camera="wrist")
    scene = default_perception().perceive([frame, blind], ["red_cube"])
    assert scene.names == ("red_cube",)
    assert scene.source.endswith("; camera 'wrist' has no depth")


def test_a_frame_is_written_as_a_coloured_cloud_in_the_world(tmp_path):
    import open3d

    frame = render([cube(RED, 0.5, 0.0)])
    count = write_ply(frame, tmp_path / "frame.ply")
    cloud = open3d.io.read_point_cloud(tmp_path / "frame.ply")
    points, colours = np.asarray(cloud.points), np.asarray(cloud.colors)
    assert len(points) == count == int(frame.valid_depth.sum())
    length = np.linalg.norm(np.asarray(cloud.normals), axis=1)
    assert np.all((np.abs(length - 1.0) < 1e-6) | (length == 0.0)) and np.mean(length > 0.0) > 0.8
    reddish = (colours[:, 0] > 0.4) & (colours[:, 1] < 0.25)
    assert np.abs(points[reddish][:, :2] - (0.5, 0.0)).max() < 0.06  # the cube is 60 mm wide and turned


def test_a_cloud_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(FrameError, match="cannot write the point cloud"):
        write_ply(render([]), tmp_path / "nowhere" / "frame.ply")


def test_no_frame_at_all_is_refused():
    with pytest.raises(FrameError, match="no frame to look at"):
        default_perception().perceive([], ["red_cube"])


def test_depth_of_another_size_than_the_intrinsics_is_refused():
    frame = render([])
    with pytest.raises(FrameError, match=r"depth picture of camera 'static' has shape \(240, 320\)"):
        with_depth(frame, np.ones((240, 320)))


def test_a_thing_with_too_little_depth_is_unseen_with_the_share():
    frame = render([cube(RED, 0.5, 0.0)])
    red = (frame.colour[..., 0].astype(int) - frame.colour[..., 1]) > 60
    lost = np.random.default_rng(0).random(frame.depth.shape) < 0.85
    scene = default_perception().perceive([with_depth(frame, np.where(red & lost, np.nan, frame.depth))], ["red_cube"])
    assert scene.objects == ()
    assert scene.unseen[0].reason.startswith("not enough depth (1")
    assert "% of its pixels, 30% are needed)" in scene.unseen[0].reason


def test_infinite_and_missing_depth_in_places_do_no_harm():
    frame = render([cube(RED, 0.5, 0.0)])
    depth, rng = np.array(frame.depth), np.random.default_rng(0)
    depth[rng.random(depth.shape) < 0.2] = np.nan
    depth[rng.random(depth.shape) < 0.02] = np.inf
    scene = default_perception().perceive([with_depth(frame, depth)], ["red_cube"])
    assert scene.objects[0].position == pytest.approx((0.5, 0.0, 0.03), abs=NEAR)


def test_an_unknown_phrase_passes_through_as_an_error():
    with pytest.raises(UnknownPhraseError, match="cannot look for 'spanner'"):
        look([], "spanner")


def test_names_may_be_written_with_spaces_and_capitals():
    assert look([cube(RED, 0.5, 0.0)], "Red Cube").names == ("red_cube",)


def test_masks_wider_than_the_thing_do_little_harm():
    class WideMasks:
        name = "masks 3 px too wide"

        def segment(self, frame, box_px, seed=None):
            import cv2

            return cv2.dilate(np.asarray(seed).astype(np.uint8), np.ones((7, 7), np.uint8)) > 0

        def segment_all(self, frame, boxes_px, seeds=()):
            return np.array([self.segment(frame, *one) for one in zip(boxes_px, seeds, strict=True)])

    embedded = default_perception()
    frame = render([cube(RED, 0.5, 0.0)])
    wide = Perception(embedded.detector, WideMasks()).perceive([frame], ["red_cube"]).objects[0]
    # Three pixels are 4 mm at this distance; without care for depth steps the background adds 40 mm and more.
    assert wide.position == pytest.approx((0.5, 0.0, 0.03), abs=0.006)


def test_of_two_things_under_one_name_one_is_reported():
    assert look([cube(RED, 0.5, 0.0), cube(RED, 0.6, 0.2)], "red_cube").names == ("red_cube",)


def test_a_detector_with_boxes_only_is_enough():
    frame = render([CRATE, cube(RED, 0.45, 0.12)])
    (box,) = default_perception().detector.detect(frame, ["red cube"])

    class BoxOnly:
        name = "a box by hand"

        def detect(self, frame, phrases):
            return [Detection(p, np.add(box.box_px, (-3, -3, 3, 3)), 1.0) for p in phrases]

    found = Perception(BoxOnly(), default_perception().segmenter).perceive([frame], ["red_cube"]).objects[0]
    assert found.position == pytest.approx((0.45, 0.12, 0.03), abs=0.008)


def test_the_embedded_parts_are_the_default_options():
    assert perception_from_options().name == default_perception().name


def test_the_overlay_marks_what_was_seen_and_says_what_was_not(stack, stacked):
    frame = render(stack)
    picture = overlay(frame, stacked)
    mask = seen(stacked, "red_cube").evidence[0].mask
    assert picture.shape == frame.colour.shape and picture.dtype == np.uint8
    assert np.abs(picture[mask].astype(int) - frame.colour[mask]).mean() > 20
    assert np.abs(picture[-10:].astype(int) - frame.colour[-10:]).mean() > 20, "the footer names detector and misses"
    untouched = frame.colour[240:300, 500:]
    assert np.array_equal(picture[240:300, 500:], untouched)
