"""What follows from a frame is worked out once a look, however many cameras, things and stages ask for it."""

import sys
from collections import Counter
from collections.abc import Callable

import numpy as np
import pytest

from perception.frames import CameraIntrinsics, RgbdFrame
from perception.geometry.cloud import StereoNoise, back_project, height_map
from perception.geometry.depth_cleaning import neighbour_range, speckles
from perception.geometry.prepared_frame import NORMAL_REACH, PreparedFrame, prepared
from perception.geometry.support import estimate_support
from perception.pipeline import perception_from_options
from sim_check.cells.loading import load_cell
from sim_check.furniture.known_models import known_models
from sim_check.models.known_forms import known_forms
from sim_check.world.world import build_world
from tests.support.scenes.perception_scenes import BLUE, GREEN, RED, WOOD, YELLOW, Thing, cube, render

ONCE = {
    "back-projection": back_project,
    "heights": height_map,
    "ranges of depth": neighbour_range,
    "speckles": speckles,
    "support": estimate_support,
    "colours": PreparedFrame.hsv.func,
    "known depth": PreparedFrame.known_depth.func,
    "valid depth": RgbdFrame.valid_depth.func,
    "smooth heights": PreparedFrame.smooth_rises.func,
}
CRATE = Thing("box", (0.06, 0.06, 0.03), (0.55, -0.18, 0.03), WOOD, 0.2)
THINGS = [CRATE, cube(RED, 0.45, 0.12), cube(BLUE, 0.5, 0.0), cube(YELLOW, 0.55, -0.18, bottom=0.06, half=0.02)]


def calls_during(action: Callable[[], object]) -> Counter:
    """How often each Python function is called, by its code, from whichever module and under whichever name."""
    calls: Counter = Counter()

    def count(frame, event, _):
        if event == "call":
            calls[frame.f_code] += 1

    sys.setprofile(count)
    try:
        action()
    finally:
        sys.setprofile(None)
    return calls


def two_cameras() -> list[RgbdFrame]:
    left = render(THINGS, camera="left", eye=(1.05, -0.35, 0.6))
    return [left, render(THINGS, camera="right", eye=(1.05, 0.35, 0.6), seed=1)]


@pytest.mark.parametrize("name", ONCE)
def test_two_cameras_and_four_things_need_each_derived_picture_once_a_camera(name):
    frames, eyes = two_cameras(), perception_from_options("colour")
    scenes = []
    calls = calls_during(
        lambda: scenes.append(eyes.perceive(frames, ["crate", "red_cube", "blue_cube", "yellow_cube"]))
    )
    assert len(scenes[0].objects) == 4, scenes[0].unseen
    assert 0 < calls[ONCE[name].__code__] <= len(frames)


def test_furniture_forms_and_detected_things_of_one_look_share_what_was_prepared():
    cell = load_cell("kitchen-explore")
    world = build_world(cell, 0)
    frames = []
    for camera in world.cameras:
        colour, depth, pose, lens = world.render(camera.name)
        frames.append(RgbdFrame(colour, depth, lens, pose, 0.0, camera.name))
    world.close()
    eyes = perception_from_options(known=known_models(cell.furniture), forms=known_forms())
    looks = prepared(frames)
    names = ["kettle", "microwave", "wooden_cabinet", "green_apple"]
    calls = calls_during(lambda: eyes.perceive(looks, names))
    for name in ("back-projection", "heights", "ranges of depth", "support", "known depth"):
        assert 0 < calls[ONCE[name].__code__] <= len(frames), name
    # Furniture looks at every fourth row and column, forms at every second.
    assert calls[PreparedFrame._make_rays.__code__] == 2 * len(frames)
    again = calls_during(lambda: eyes.perceive(looks, names))
    assert not any(again[one.__code__] for one in ONCE.values()) and not again[PreparedFrame._make_rays.__code__]


def test_a_prepared_frame_is_the_frame_and_is_not_prepared_again():
    frame = render([cube(GREEN, 0.5, 0.0)])
    once = PreparedFrame.of(frame)
    assert isinstance(once, RgbdFrame) and once.depth is frame.depth and once.colour is frame.colour
    assert PreparedFrame.of(once) is once
    assert PreparedFrame.of(once, StereoNoise(disparity_std=0.5)).noise.disparity_std == 0.5


def test_what_was_worked_out_cannot_be_written_to():
    frame = PreparedFrame.of(render([cube(GREEN, 0.5, 0.0)]))
    names = (
        "valid_depth",
        "known_depth",
        "trusted_depth",
        "cloud",
        "heights",
        "rises",
        "smooth_rises",
        "hsv",
        "normals",
    )
    for array in (*(getattr(frame, name) for name in names), frame.rays(4).direction, frame.rays(4).distance):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_normals_point_out_of_the_table_towards_the_camera_and_end_at_a_step():
    rows = np.arange(48)[:, None] - 23.5
    lens = CameraIntrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)
    # A camera at 1 m height that looks straight down, over the edge of a table of 0.3 m in its left half.
    down = np.array([[0.0, -1.0, 0.0, 0.4], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 1.0], [0.0, 0.0, 0.0, 1.0]])
    depth = np.where(np.arange(64) < 32, 0.7, 1.0) + 0.0 * rows
    frame = PreparedFrame(np.zeros((48, 64, 3), np.uint8), depth, lens, down, 0.0)
    known = np.asarray(np.isfinite(frame.normals).all(-1))
    assert frame.normals[known] == pytest.approx(np.tile([0.0, 0.0, 1.0], (int(known.sum()), 1)), abs=1e-6)
    r = NORMAL_REACH
    assert known[r, r : 31 - r].all() and known[r, 33 + r : 64 - r].all()
    assert not known[:, 31 - r : 33 + r].any() and not known[:r].any() and not known[:, -r:].any()
    # A wall that falls away to the lower rows: half a metre of depth a metre downwards.
    wall = PreparedFrame(frame.colour, 1.0 / (1.0 - 0.5 * rows / 60.0) + 0.0 * depth, lens, np.eye(4), 0.0)
    assert wall.normals[24, 32] == pytest.approx(np.array([0.0, 0.5, -1.0]) / np.hypot(1.0, 0.5), abs=1e-6)


def test_rays_end_where_the_cloud_says():
    frame = PreparedFrame.of(render([cube(GREEN, 0.5, 0.0)]))
    rays = frame.rays(4)
    assert rays.points == pytest.approx(frame.cloud[tuple(rays.pixel.T)], abs=1e-9)
    assert np.linalg.norm(rays.direction, axis=1) == pytest.approx(1.0)
