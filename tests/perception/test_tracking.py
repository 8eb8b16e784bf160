"""Following things from frame to frame: names that stay, places that settle, things that move, hide and return."""

from dataclasses import replace

import numpy as np
import pytest

from perception.estimates import ObjectEstimate
from perception.tracking.tracker import Tracker, TrackSettings


def cube(
    x: float, y: float = 0.0, yaw: float = 0.0, phrase: str = "red cube", std: float = 0.003, score: float = 0.9
) -> ObjectEstimate:
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    pose[:3, 3] = (x, y, 0.03)
    name = phrase.replace(" ", "_")
    sides = np.array([0.06, 0.06, 0.06])
    return ObjectEstimate(name, phrase, pose, sides, "box", np.full(3, std), 0.05, score, 0.0)


def names(tracks) -> list[str]:
    return [t.name for t in tracks]


def test_two_of_one_name_keep_their_names_whatever_the_order_of_the_boxes():
    tracker = Tracker()
    assert names(tracker.update([cube(0.0), cube(0.3)])) == ["red_cube", "red_cube_2"]
    assert names(tracker.update([cube(0.301), cube(0.001)])) == ["red_cube_2", "red_cube"]


def test_the_assignment_is_the_best_of_all_and_not_the_nearest_first():
    # The middle estimate is nearest to the left thing, which would leave the right thing to the far left estimate.
    tracker = Tracker(TrackSettings(reach=0.2))
    tracker.update([cube(0.00), cube(0.10)])
    assert names(tracker.update([cube(0.04), cube(-0.06)])) == ["red_cube_2", "red_cube"]


def test_the_place_of_a_thing_that_stands_still_settles_with_the_root_of_the_frames():
    rng = np.random.default_rng(0)
    tracker, track = Tracker(TrackSettings(least_std=0.0001)), None
    for _ in range(25):
        (track,) = tracker.update([cube(0.4 + 0.003 * rng.normal(), 0.003 * rng.normal(), std=0.003)])
    assert track is not None and (track.still, track.moves) == (25, 0)
    # Spread 3 mm / sqrt(25) = 0.6 mm in each of two axes; three times that.
    assert np.hypot(track.estimate.position[0] - 0.4, track.estimate.position[1]) < 3 * 0.0006 * np.sqrt(2)
    assert track.estimate.position_std == pytest.approx(0.0006)


def test_a_mean_is_weighted_by_how_sure_each_estimate_is_and_never_surer_than_frames_can_be():
    tracker = Tracker(TrackSettings(least_std=0.002))
    tracker.update([cube(0.400, std=0.002)])
    (track,) = tracker.update([cube(0.405, std=0.004)])
    # Weights 1/4 and 1/16: 0.400 + 0.005 * 0.2.
    assert track.estimate.position[0] == pytest.approx(0.401)
    for _ in range(20):
        (track,) = tracker.update([cube(0.401, std=0.004)])
    assert track.estimate.position_std == pytest.approx(0.002)


def test_a_yaw_is_averaged_across_quarter_turns_of_the_box():
    tracker = Tracker()
    tracker.update([cube(0.4, yaw=np.radians(44.0))])
    (track,) = tracker.update([cube(0.4, yaw=np.radians(-44.0))])  # 46 degrees, a quarter turn on
    assert np.degrees(track.estimate.yaw) == pytest.approx(45.0)


def test_a_thing_that_was_moved_keeps_its_name_and_is_not_averaged_with_where_it_was():
    tracker = Tracker()
    for _ in range(5):
        tracker.update([cube(0.4)])
    (track,) = tracker.update([cube(0.6)])
    assert (track.name, track.moves, track.still, track.seen) == ("red_cube", 1, 1, 6)
    assert track.estimate.position[0] == pytest.approx(0.6)


def test_a_small_shift_shows_in_time():
    tracker, track = Tracker(), None
    for _ in range(200):
        tracker.update([cube(0.400)])
    for _ in range(100):
        (track,) = tracker.update([cube(0.405)])
    assert track is not None and track.moves == 0
    assert track.estimate.position[0] == pytest.approx(0.405, abs=0.0005)


def test_a_thing_that_was_hidden_is_taken_up_again():
    tracker = Tracker()
    tracker.update([cube(0.4), cube(0.4, 0.3, phrase="crate")])
    for _ in range(3):
        tracker.update([cube(0.4, 0.3, phrase="crate")])
    assert {t.name: t.missed for t in tracker.tracks} == {"red_cube": 3, "crate": 0}
    (back, _) = tracker.update([cube(0.4), cube(0.4, 0.3, phrase="crate")])
    assert (back.name, back.seen, back.missed) == ("red_cube", 2, 0)


def test_one_beyond_reach_is_another_thing():
    tracker = Tracker(TrackSettings(reach=0.2))
    tracker.update([cube(0.0)])
    assert names(tracker.update([cube(0.5)])) == ["red_cube_2"]


def test_what_was_seen_once_only_is_forgotten():
    tracker = Tracker(TrackSettings(reach=0.2, forget_after=3))
    for _ in range(2):
        tracker.update([cube(0.0)])
    tracker.update([cube(0.0), cube(0.5)])
    for _ in range(3):
        tracker.update([cube(0.0)])
    assert names(tracker.tracks) == ["red_cube"]


def test_another_shape_starts_anew_under_the_same_name():
    tracker = Tracker()
    tracker.update([cube(0.4)])
    (track,) = tracker.update([replace(cube(0.401), shape="cylinder", yaw_std=float("inf"))])
    assert (track.name, track.still, track.moves) == ("red_cube", 1, 0)
    assert track.estimate.shape == "cylinder"
