"""Depth to solids: cleaning, back-projection, support, fits, spreads, merging; no pictures needed."""

from dataclasses import replace

import numpy as np
import pytest

from perception.errors import FrameError
from perception.estimates import ObjectEstimate
from perception.frames import CameraIntrinsics
from perception.geometry.cloud import StereoNoise, back_project, largest_cluster
from perception.geometry.depth_cleaning import speckles
from perception.geometry.gravity_alignment import camera_above_plane
from perception.geometry.prepared_frame import PreparedFrame
from perception.geometry.refinement import Refined
from perception.geometry.resting import LowerEnd, find_bottom, levels
from perception.geometry.shape_choice import Kind, best_of, first_fits, lying
from perception.geometry.solid_outlines import outline_distance, sphere_rim
from perception.geometry.solids import Solid, fit_box, fit_cylinder, fit_sphere
from perception.geometry.support import SupportPlane
from perception.tracking.merging import merge, turned_like
from tests.support.scenes.perception_scenes import look_at

LENS = CameraIntrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)
TABLE = SupportPlane(0.0, (0.0, 0.0), True)
OPEN_END = LowerEnd(hidden=False, drops=False, height=float("nan"), px_per_metre=500.0)


def box_surface(centre, half, yaw, rng, n=3000):
    """Points of the top and of the two sides that a camera at +x, +y sees, in [m], shape (n, 3)."""
    unit = rng.uniform(-1, 1, (n, 3))
    face = rng.integers(0, 3, n)
    unit[np.arange(n), face] = 1.0
    local = unit * half
    c, s = np.cos(yaw), np.sin(yaw)
    return local @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T + centre


def with_depth(depth: np.ndarray) -> PreparedFrame:
    """A frame of this depth by a camera at the world's origin."""
    height, width = depth.shape
    lens = CameraIntrinsics(width, height, 60.0, 60.0, (width - 1) / 2, (height - 1) / 2)
    return PreparedFrame(np.zeros((height, width, 3), np.uint8), depth, lens, np.eye(4), 0.0)


def test_a_point_on_the_optical_axis_lies_straight_ahead():
    points = back_project(np.full((48, 64), 2.0), LENS)
    assert points[23, 31] == pytest.approx(np.array([-0.5 * 2 / 60, -0.5 * 2 / 60, 2.0]))


def test_the_height_map_agrees_with_the_points():
    pose = look_at((1.0, 0.2, 0.8), (0.3, 0.0, 0.0))
    rng = np.random.default_rng(0)
    frame = PreparedFrame(np.zeros((48, 64, 3), np.uint8), rng.uniform(0.5, 2, (48, 64)), LENS, pose, 0.0)
    assert frame.heights == pytest.approx(frame.cloud[..., 2], abs=1e-6)


def test_pixels_beside_a_depth_step_are_marked_and_others_are_not():
    depth = np.full((5, 8), 1.0)
    depth[:, 4:] = 1.05
    marked = with_depth(depth).depth_steps(0.03)
    assert marked[2].tolist() == [False, False, False, True, True, False, False, False]
    assert not with_depth(depth).depth_steps(0.06).any()


def test_unknown_depth_is_no_step():
    depth = np.full((5, 5), 1.0)
    depth[2, 2] = np.nan
    assert not with_depth(depth).depth_steps(0.03).any()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 0.0, -1.0])
def test_numbers_that_are_no_depth_are_unknown(bad):
    depth = np.full((9, 9), 1.0)
    depth[4, 4] = bad
    frame = with_depth(depth)
    assert np.argwhere(~frame.valid_depth).tolist() == [[4, 4]]
    assert np.argwhere(np.isnan(frame.known_depth)).tolist() == [[4, 4]]
    assert np.argwhere(~frame.trusted_depth).tolist() == [[4, 4]]


def test_a_pixel_that_flies_between_front_and_back_is_not_trusted_nor_are_its_neighbours():
    depth = np.full((9, 12), 1.0)
    depth[:, 6:] = 1.5
    depth[4, 6] = 1.25
    trusted = with_depth(depth).trusted_depth
    assert not trusted[:, 5:7].any() and trusted[:, :5].all() and trusted[:, 8:].all()


def test_a_speckle_is_dropped_and_a_patch_is_kept():
    depth = np.full((40, 40), 1.0)
    depth[5:9, 5:9] = 0.97  # 16 pixels
    depth[20:30, 20:30] = 0.97  # 100 pixels
    dropped = speckles(depth, np.ones(depth.shape, bool))
    assert dropped[5:9, 5:9].all() and dropped.sum() == 16


def test_stereo_noise_grows_with_the_square_of_the_distance():
    noise = StereoNoise()
    assert noise.depth_std(1.0, 700.0) == pytest.approx(0.25 / (700 * 0.063))
    assert noise.depth_std(2.0, 700.0) == pytest.approx(4 * noise.depth_std(1.0, 700.0))


def test_flying_pixels_do_not_join_the_thing():
    rng = np.random.default_rng(0)
    thing, flying = rng.uniform(-0.03, 0.03, (500, 3)), rng.uniform(0.2, 0.3, (20, 3))
    kept = largest_cluster(np.concatenate([thing, flying, [[900.0, 0.0, 0.0]]]))
    assert kept[:500].mean() > 0.98 and not kept[500:].any()


def test_a_box_seen_from_one_side_is_completed_down_to_its_support():
    rng = np.random.default_rng(1)
    points = box_surface((0.5, 0.1, 0.05), (0.06, 0.04, 0.03), 0.4, rng) + rng.normal(0, 0.001, (3000, 3))
    fit = fit_box(points, bottom=0.0)
    assert fit.centre == pytest.approx((0.5, 0.1, 0.04), abs=0.003)
    assert fit.extents == pytest.approx((0.12, 0.08, 0.08), abs=0.006)
    assert fit.yaw == pytest.approx(0.4, abs=0.03)


def test_single_outliers_turn_no_box():
    rng = np.random.default_rng(1)
    points = box_surface((0.5, 0.1, 0.03), (0.06, 0.04, 0.03), 0.4, rng)
    points[::300] += 0.05
    assert fit_box(points, bottom=0.0).yaw == pytest.approx(0.4, abs=0.03)


def test_half_a_sphere_is_enough_for_the_whole():
    rng = np.random.default_rng(2)
    way = rng.normal(size=(2000, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    way = way[(way[:, 0] > 0) & (way[:, 2] > -0.3)]
    fit = fit_sphere(np.array([0.4, 0.0, 0.035]) + 0.035 * way)
    assert fit.centre == pytest.approx((0.4, 0.0, 0.035), abs=1e-3)
    assert fit.extents == pytest.approx(0.07, abs=2e-3)


def test_the_rim_of_a_bowl_gives_its_circle():
    rng = np.random.default_rng(3)
    turn, level = rng.uniform(0, 2 * np.pi, 3000), rng.uniform(0, 1, 3000)
    radius = 0.05 + 0.02 * level  # the inside of a bowl, widening upwards
    points = np.stack([0.5 + radius * np.cos(turn), radius * np.sin(turn), 0.005 + 0.045 * level], -1)
    fit = fit_cylinder(points, bottom=0.0, depth_std=0.0005)
    assert fit.centre == pytest.approx((0.5, 0.0, 0.025), abs=0.003)
    assert fit.extents == pytest.approx((0.14, 0.14, 0.05), abs=0.006)


def test_outline_distance_is_negative_inside_and_zero_on_the_edge():
    square = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0], [5.0, 5.0]])
    pixels = np.array([[5.0, 5.0], [10.0, 5.0], [13.0, 5.0], [1.0, 5.0]])
    assert outline_distance(pixels, square) == pytest.approx([-5.0, 0.0, 3.0, -1.0])


def test_the_visible_rim_of_a_sphere_touches_the_lines_of_sight():
    centre, eye = np.array([0.5, 0.0, 0.1]), np.array([1.0, 0.3, 0.6])
    rim = sphere_rim(centre, 0.05, eye)
    assert np.linalg.norm(rim - centre, axis=1) == pytest.approx(0.05)
    assert np.einsum("ij,ij->i", rim - centre, rim - eye) == pytest.approx(0.0, abs=1e-12)


def standing_on(height: float, n: int = 500) -> np.ndarray:
    rng = np.random.default_rng(0)
    return rng.uniform((0.4, -0.03, height), (0.46, 0.03, height + 0.06), (n, 3))


def test_a_thing_over_a_crate_rests_on_the_crate():
    crate = Solid("box", np.array([0.43, 0.0, 0.04]), 0.2, np.array([0.2, 0.2, 0.08]))
    assert find_bottom(standing_on(0.08), OPEN_END, TABLE, [crate], 0.003)[0] == pytest.approx(0.08)


def test_a_thing_beside_a_crate_rests_on_the_table():
    crate = Solid("box", np.array([0.7, 0.0, 0.01]), 0.0, np.array([0.2, 0.2, 0.02]))
    assert find_bottom(standing_on(0.0), OPEN_END, TABLE, [crate], 0.003)[0] == 0.0


def test_a_thing_that_hangs_ends_where_it_is_seen_to_end():
    hanging = replace(OPEN_END, drops=True)
    assert find_bottom(standing_on(0.2), hanging, TABLE, [], 0.003)[0] == pytest.approx(0.2, abs=0.005)


def test_a_hidden_lower_end_reaches_down_and_is_less_sure():
    hidden = replace(OPEN_END, hidden=True)
    bottom, spread = find_bottom(standing_on(0.06), hidden, TABLE, [], 0.003)
    assert bottom == 0.0
    assert spread > 5 * find_bottom(standing_on(0.0), OPEN_END, TABLE, [], 0.003)[1]


def test_an_unnamed_shelf_far_above_the_table_carries_what_stands_on_it():
    rng = np.random.default_rng(0)
    shelf = rng.normal((0.43, 0.0, 0.4), (0.1, 0.1, 0.002), (400, 3))
    hidden = replace(OPEN_END, hidden=True)
    assert find_bottom(standing_on(0.42), hidden, TABLE, [], 0.003, shelf)[0] == pytest.approx(0.4, abs=0.003)


def test_levels_are_where_many_points_lie():
    rng = np.random.default_rng(0)
    z = np.concatenate([rng.normal(0.0, 0.002, 400), rng.normal(0.1, 0.002, 300), rng.uniform(0, 0.3, 60)])
    assert levels(np.stack([z * 0, z * 0, z], -1)) == pytest.approx([0.0, 0.1], abs=0.003)


def plane_frame(pose: np.ndarray, rng: np.random.Generator, height: float = 0.0) -> PreparedFrame:
    """A camera that sees nothing but a table of the given height, through 2 mm of noise."""
    v, u = np.mgrid[0:48, 0:64]
    rays = np.stack([(u - LENS.cx) / LENS.fx, (v - LENS.cy) / LENS.fy, np.ones((48, 64))], -1) @ pose[:3, :3].T
    depth = (height - pose[2, 3]) / rays[..., 2]
    depth = np.where((depth > 0) & (depth < 4), depth + rng.normal(0, 0.002, depth.shape), np.nan)
    return PreparedFrame(np.zeros((48, 64, 3), np.uint8), depth, LENS, pose, 0.0)


def test_the_support_is_found_where_the_table_really_is():
    frame = plane_frame(look_at((1.0, 0.0, 0.7), (0.4, 0.0, 0.0)), np.random.default_rng(0), height=0.012)
    support = frame.support
    assert support.seen and support.at(0.4, 0.0) == pytest.approx(0.012, abs=0.002)


def test_a_picture_without_a_table_assumes_zero_and_says_so():
    frame = plane_frame(look_at((1.0, 0.0, 0.7), (0.4, 0.0, 0.0)), np.random.default_rng(0), height=0.4)
    assert frame.support == SupportPlane(0.0, (0.0, 0.0), False)


def test_a_camera_without_a_pose_is_aligned_with_gravity_by_the_plane_it_sees():
    true = look_at((1.0, 0.0, 0.7), (0.4, 0.0, 0.0))
    frame = plane_frame(true, np.random.default_rng(0))
    pose = camera_above_plane(frame.depth, LENS)
    assert pose[2, 3] == pytest.approx(0.7, abs=0.005)
    assert pose[2, :3] == pytest.approx(true[2, :3], abs=0.01)
    assert pose[:3, :3] @ pose[:3, :3].T == pytest.approx(np.eye(3), abs=1e-9)


def test_a_camera_that_sees_a_wall_only_cannot_be_aligned_with_gravity():
    depth = np.full((48, 64), 1.0) + np.random.default_rng(0).uniform(0, 3, (48, 64))
    with pytest.raises(FrameError, match="no plane holds a tenth of the known depths"):
        camera_above_plane(depth, LENS)


def estimate(x: float, yaw: float = 0.2, extents=(0.05, 0.05, 0.05), spread=0.002) -> ObjectEstimate:
    pose = Solid("box", np.array([x, 0.0, 0.025]), yaw, np.array(extents)).pose
    return ObjectEstimate(
        "red_cube", "red cube", pose, np.array(extents), "box", np.full(3, spread), 0.02, 0.9, 0.0, ()
    )


def test_two_estimates_of_equal_spread_meet_in_the_middle():
    both = merge([estimate(0.500), estimate(0.504)])
    assert both.position[0] == pytest.approx(0.502)
    assert both.position_std == pytest.approx(0.002 / np.sqrt(2))


def test_the_surer_estimate_weighs_more():
    assert merge([estimate(0.500, spread=0.001), estimate(0.510, spread=0.003)]).position[0] == pytest.approx(0.501)


def test_an_estimate_elsewhere_is_another_thing_and_not_averaged_in():
    assert merge([estimate(0.5, spread=0.003), estimate(0.9)]).position[0] == pytest.approx(0.9)


def test_estimates_that_differ_by_more_than_their_spreads_leave_a_wider_one():
    apart = merge([estimate(0.500, spread=0.001), estimate(0.510, spread=0.001)])
    # Birge: chi^2 of two values 10 spreads apart is 50.
    assert apart.position_std[0] == pytest.approx(0.001 * np.sqrt(50 / 2 / 2))
    assert apart.position_std[1] == pytest.approx(0.001 / np.sqrt(2))


def test_a_side_that_one_camera_sees_better_has_that_cameras_size():
    sure = replace(estimate(0.5), extents_std=np.array([0.001, 0.001, 0.001]))
    half_hidden = replace(estimate(0.5, extents=(0.03, 0.05, 0.05)), extents_std=np.array([0.03, 0.001, 0.001]))
    both = merge([sure, half_hidden])
    assert both.extents == pytest.approx((0.05, 0.05, 0.05), abs=1e-4)
    assert both.extents_std == pytest.approx((0.001, 0.001 / np.sqrt(2), 0.001 / np.sqrt(2)), rel=0.01)


def test_a_quarter_turn_apart_is_the_same_box_with_swapped_sides():
    turned = turned_like(estimate(0.5, yaw=0.2 + np.pi / 2, extents=(0.04, 0.08, 0.05)), 0.2)
    assert turned.yaw == pytest.approx(0.2)
    assert turned.extents == pytest.approx((0.08, 0.04, 0.05))


def test_yaws_on_both_sides_of_a_quarter_turn_are_averaged_the_short_way():
    both = merge([estimate(0.5, yaw=np.radians(1)), estimate(0.5, yaw=np.radians(89))])
    assert (np.degrees(both.yaw) + 45) % 90 - 45 == pytest.approx(0.0, abs=1e-6)


def test_a_can_on_its_side_is_told_from_a_box_and_from_an_upright_can():
    rng = np.random.default_rng(2)
    # The upper 200 degrees of a can of 68 mm and 102 mm that lies along 30 degrees.
    turn, along = rng.uniform(np.radians(-10), np.radians(190), 3000), rng.uniform(-0.051, 0.051, 3000)
    across, height = 0.034 * np.cos(turn), 0.034 + 0.034 * np.sin(turn)
    c, s = np.cos(np.radians(30)), np.sin(np.radians(30))
    points = np.stack([0.5 + c * along - s * across, 0.1 + s * along + c * across, height], -1)
    points += rng.normal(0, 0.001, points.shape)
    fits = first_fits(points, ("cylinder", "lying cylinder", "box"), 0.0, 0.001)
    alike: dict[Kind, Refined] = {kind: lying(fit, 0.001) for kind, fit in fits.items()}  # no word of the outline
    assert best_of(fits, alike, points, 0.001)[0] == "lying cylinder"
    solid = fits["lying cylinder"]
    assert solid.extents == pytest.approx((0.102, 0.068, 0.068), abs=0.003)
    assert np.degrees(solid.yaw) == pytest.approx(30, abs=1.5)
    assert solid.centre == pytest.approx((0.5, 0.1, 0.034), abs=0.002)
