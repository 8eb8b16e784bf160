"""Measures of perception, against values worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest

from perception.estimates import Evidence, ObjectEstimate, SceneEstimate, Shape
from perception.evaluation.metrics import (
    ScoredQuestion,
    absent_false_positive_rate,
    average_precision,
    compare,
    mask_iou,
    median_p95,
    recall,
    summary,
)
from perception.evaluation.scoring import Scores, scores_text
from perception.ground_truth import FrameTruth, TrueObject
from perception.interfaces import Detection

HERE, THERE = (0.0, 0.0, 10.0, 10.0), (50.0, 50.0, 60.0, 60.0)


def question(drawn: list[tuple[tuple[float, ...], float]], truth: list[tuple[float, ...]]) -> ScoredQuestion:
    boxes = np.array([box for box, _ in drawn], float).reshape(-1, 4)
    return ScoredQuestion(boxes, np.array([s for _, s in drawn], float), np.array(truth, float).reshape(-1, 4))


def test_perfect_boxes_have_an_average_precision_of_one():
    assert average_precision([question([(HERE, 0.9)], [HERE]), question([(THERE, 0.4)], [THERE])]) == 1.0


def test_average_precision_of_a_worked_example():
    # In order of score: right, wrong, right, wrong; one of three true boxes is never found.
    # p = 1, 1/2, 2/3, 1/2 and r = 1/3, 1/3, 2/3, 2/3; the best precision from there on: 1 and 2/3.
    questions = [
        question([(HERE, 0.9), (THERE, 0.8)], [HERE]),
        question([(HERE, 0.7)], [HERE]),
        question([(HERE, 0.6)], []),
        question([], [THERE]),
    ]
    assert average_precision(questions) == pytest.approx((1 + 2 / 3) / 3)


def test_precision_counts_at_every_recall_as_the_best_that_follows():
    # In order of score: wrong, right, right: p = 0, 1/2, 2/3; the envelope is 2/3 throughout.
    drawn = [(THERE, 0.9), (HERE, 0.8), ((100.0, 0.0, 110.0, 10.0), 0.7)]
    assert average_precision([question(drawn, [HERE, (100.0, 0.0, 110.0, 10.0)])]) == pytest.approx(2 / 3)


def test_a_second_box_on_the_same_thing_is_wrong():
    # The better-scored one takes the true box: p = 1, 1/2 at r = 1.
    twice = question([(HERE, 0.9), ((0.0, 0.0, 10.0, 9.0), 0.8)], [HERE])
    assert list(twice.right()) == [True, False]
    # With the worse-scored one in an earlier place of the list nothing changes.
    assert list(question([((0.0, 0.0, 10.0, 9.0), 0.8), (HERE, 0.9)], [HERE]).right()) == [False, True]


def test_a_box_is_right_from_half_overlap_on():
    half = question([((0.0, 0.0, 10.0, 5.0), 0.9)], [HERE])
    less = question([((0.0, 0.0, 10.0, 4.9), 0.9)], [HERE])
    assert (average_precision([half]), average_precision([less])) == (1.0, 0.0)


def test_recall_and_false_answers_count_boxes_from_the_threshold_on():
    questions = [
        question([(HERE, 0.9)], [HERE]),
        question([(HERE, 0.3)], [HERE]),
        question([], [HERE]),
        question([(HERE, 0.3)], []),
        question([(HERE, 0.6)], []),
        question([], []),
        question([], []),
    ]
    assert recall(questions) == pytest.approx(2 / 3)
    assert recall(questions, 0.5) == pytest.approx(1 / 3)
    assert absent_false_positive_rate(questions) == pytest.approx(2 / 4)
    assert absent_false_positive_rate(questions, 0.5) == pytest.approx(1 / 4)


def test_where_nothing_was_asked_nothing_is_measured():
    assert np.isnan(average_precision([question([(HERE, 1.0)], [])]))
    assert np.isnan(recall([])) and np.isnan(absent_false_positive_rate([question([], [HERE])]))
    assert average_precision([question([], [HERE])]) == 0.0
    assert median_p95([float("nan")]) == {"median": None, "p95": None}


def test_masks_overlap_by_pixels():
    a, b = np.zeros((4, 4), bool), np.zeros((4, 4), bool)
    assert mask_iou(a, b) == 1.0
    a[:2], b[1:3] = True, True
    assert mask_iou(a, b) == pytest.approx(4 / 12)


def turned(yaw_deg: float, position: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    c, s = np.cos(np.radians(yaw_deg)), np.sin(np.radians(yaw_deg))
    return np.array([[c, -s, 0, position[0]], [s, c, 0, position[1]], [0, 0, 1, position[2]], [0, 0, 0, 1.0]])


def estimate(pose: np.ndarray, extents, shape: Shape = "box", std: float = 0.002) -> ObjectEstimate:
    return ObjectEstimate(
        "red_block", "red block", pose, np.array(extents, float), shape, np.full(3, std), 0.01, 0.9, 1.0
    )


def test_position_error_is_a_distance_and_is_held_against_the_claimed_spread():
    error = compare(
        estimate(turned(0, (0.003, 0.004, 0.0)), (0.1, 0.06, 0.05)),
        TrueObject("red_block", turned(0), np.array([0.1, 0.06, 0.05])),
    )
    assert error.position_mm == pytest.approx(5.0)
    # Axes are off by 1.5, 2 and 0 spreads: root mean square sqrt((2.25 + 4) / 3).
    assert error.normalised == pytest.approx(np.sqrt(6.25 / 3))
    assert error.extents_mm == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("yaw", "extents", "yaw_deg", "extents_mm"),
    [
        (10.0, (0.10, 0.06, 0.05), 10.0, 0.0),
        (190.0, (0.10, 0.06, 0.05), 10.0, 0.0),  # a half turn shows nothing
        (100.0, (0.06, 0.10, 0.05), 10.0, 0.0),  # its long side is called y: the same box
        (100.0, (0.10, 0.06, 0.05), 10.0, 40.0),  # across the true one
        (-40.0, (0.11, 0.06, 0.047), 40.0, 10.0),
    ],
)
def test_yaw_and_sides_of_a_box_do_not_depend_on_what_its_axes_are_called(yaw, extents, yaw_deg, extents_mm):
    error = compare(
        estimate(turned(yaw), extents), TrueObject("red_block", turned(0), np.array([0.10, 0.06, 0.05]), "box")
    )
    assert error.yaw_deg == pytest.approx(yaw_deg)
    assert error.extents_mm == pytest.approx(extents_mm, abs=1e-6)


def test_a_true_box_whose_model_lies_on_its_side_is_compared_along_the_same_directions():
    # The true model's z points along the world's x: 0.05 wide in x, 0.06 in y, 0.10 high.
    lying = np.eye(4)
    lying[:3, :3] = np.array([[0, 0, 1.0], [0, 1, 0], [-1, 0, 0]])
    error = compare(
        estimate(turned(7), (0.05, 0.06, 0.10)), TrueObject("red_block", lying, np.array([0.1, 0.06, 0.05]))
    )
    assert error.extents_mm == pytest.approx(0.0, abs=1e-9)
    assert error.yaw_deg == pytest.approx(7.0)


def test_round_things_have_no_yaw_and_unknown_sizes_no_error():
    ball = TrueObject("red_block", turned(0), np.array([0.06, 0.06, 0.06]), "sphere")
    assert np.isnan(compare(estimate(turned(20), (0.06, 0.06, 0.06)), ball).yaw_deg)
    can = estimate(turned(20), (0.06, 0.06, 0.06), "cylinder")
    assert np.isnan(compare(can, TrueObject("red_block", turned(0))).yaw_deg)
    assert np.isnan(compare(can, TrueObject("red_block", turned(0))).extents_mm)


def test_a_summary_holds_median_and_upper_quantile_of_what_was_measured():
    errors = [
        compare(estimate(turned(0, (mm / 1000, 0, 0)), (0.1, 0.1, 0.1)), TrueObject("x", turned(0)))
        for mm in (1, 2, 3, 4, 5)
    ]
    row = summary(errors)
    assert (row["n"], row["position_mm_median"]) == (5, pytest.approx(3.0))
    assert row["position_mm_p95"] == pytest.approx(4.8)
    assert np.isnan(row["extents_mm_median"])


def scene_of(*objects: ObjectEstimate) -> SceneEstimate:
    return SceneEstimate(tuple(objects), (), 0.0, 1.0, "test")


def seen_at(box: tuple[float, ...], o: ObjectEstimate) -> ObjectEstimate:
    mask = np.zeros((80, 80), bool)
    mask[int(box[1]) : int(box[3]), int(box[0]) : int(box[2])] = True
    return replace(o, evidence=(Evidence("static", np.array(box), mask, 1.0, "test"),))


def test_a_frame_is_scored_by_what_was_asked_and_is_known():
    mask = np.zeros((80, 80), bool)
    mask[:10, :10] = True
    block = TrueObject(
        "red_block", turned(0), np.array([0.1, 0.06, 0.05]), "box", mask, np.array(HERE), 1.0, {"door": 0.5}
    )
    found = replace(
        seen_at((0, 0, 10, 8), estimate(turned(3, (0.002, 0, 0)), (0.1, 0.06, 0.05))), joint_fractions={"door": 0.6}
    )
    boxes = [
        Detection("red block", np.array((0, 0, 10, 8.0)), 0.9),
        Detection("red block", np.array(THERE), 0.1),
        Detection("blue ball", np.array(THERE), 0.2),
        Detection("yellow bar", np.array(THERE), 0.95),
    ]
    scores = Scores(threshold=0.5)
    names = ("red_block", "blue_ball", "yellow_bar", "whatever")
    scores.add(
        scene_of(found),
        FrameTruth((block,), ("blue_ball", "yellow_bar")),
        boxes,
        names,
        "static",
        "0.7 m",
        {"door": 90.0},
    )
    figures = scores.as_json()
    assert (figures["n_frames"], figures["n_objects"]) == (1, 1)
    assert figures["recall"] == 1.0
    assert figures["absent_false_positive_rate"] == 0.5  # of two absent things one has a box above 0.5; one is unknown
    assert figures["ap50"] == 0.5  # the best score is that of a bar that is not there
    assert figures["mask_iou"] == pytest.approx(0.8)
    assert figures["position_mm"] == {
        "median": 2.0,
        "p95": 2.0,
        "by_group": {"0.7 m": {"median": 2.0, "p95": 2.0}},
    }
    assert figures["joint_fraction"]["median"] == pytest.approx(0.1)
    assert figures["door_angle_deg"]["median"] == pytest.approx(9.0)
    assert "AP50 of boxes" in scores_text(figures)


def test_a_pose_of_another_thing_is_counted_apart_and_not_as_a_pose_error():
    block = TrueObject("red_block", turned(0), np.array([0.1, 0.06, 0.05]), "box", None, np.array(HERE))
    elsewhere = seen_at(THERE, estimate(turned(0, (0.4, 0, 0)), (0.1, 0.06, 0.05)))
    scores = Scores()
    scores.add(scene_of(elsewhere), FrameTruth((block,)), [], ("red_block",), "static")
    figures = scores.as_json()
    assert figures["wrong_thing_rate"] == 1.0
    assert figures["posed"] == 0.0
    assert figures["position_mm"]["median"] is None
    assert figures["recall"] == 0.0


def test_several_of_one_name_are_paired_by_distance():
    left, right = (TrueObject("red_block", turned(0, (x, 0, 0)), np.array([0.05] * 3)) for x in (0.0, 0.3))
    near_right = replace(estimate(turned(0, (0.29, 0, 0)), (0.05,) * 3))
    near_left = replace(estimate(turned(0, (0.02, 0, 0)), (0.05,) * 3), name="red_block_2")
    scores = Scores()
    scores.add(scene_of(near_right, near_left), FrameTruth((left, right)), [], ("red_block",), "static")
    assert sorted(round(e.position_mm) for e in scores.errors()) == [10, 20]
    assert [e.name for e in scores.errors("red_block_2")] == ["red_block_2"]
