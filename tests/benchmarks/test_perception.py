"""The benchmark of perception: seeded held-out pictures, honest questions, rows that tell the stages apart."""

import numpy as np
import pytest

from benchmarks.looking.held_out import ABSENT, FIRST_SEED, held_out_frames
from benchmarks.looking.perception import (
    LOWEST_SCORE,
    Chunk,
    KnownPhrases,
    Looker,
    measure,
    operating_threshold,
    run_chunk,
    table,
)
from perception.detection.colour_shape import ColourShapeDetector
from perception.evaluation.recording_detector import RecordingDetector
from perception.evaluation.scoring import Scores
from sim_check.random_scenes.labelled_pictures import HELD_OUT
from tests.support.scenes.perception_scenes import RED, YELLOW, cube, render


def test_frames_depend_on_their_seed_alone_and_training_never_sees_them():
    assert FIRST_SEED > HELD_OUT
    first, again = (list(held_out_frames(3, 0, 2)) for _ in range(2))
    (other,) = held_out_frames(4, 0, 1)
    assert all(np.array_equal(a.frame.colour, b.frame.colour) for a, b in zip(first, again, strict=True))
    assert all(np.array_equal(a.frame.depth, b.frame.depth, equal_nan=True) for a, b in zip(first, again, strict=True))
    assert [a.names for a in first] == [b.names for b in again]
    assert not np.array_equal(first[0].frame.colour, other.frame.colour)


def test_what_is_asked_is_there_or_certainly_is_not():
    for item in held_out_frames(0, 1, 3):
        there = {o.name for o in item.truth.objects}
        asked = set(item.names)
        assert there <= asked
        assert len(asked - there) == ABSENT
        assert asked - there <= set(item.truth.absent)
        distance = float(item.group.removesuffix(" m"))
        assert distance in (0.5, 0.7, 1.0)


def test_given_masks_are_perfect_in_all_that_comes_before_geometry():
    measured = run_chunk(Chunk(("given boxes", "given masks"), 0, 0, 2))
    boxes, masks = (measured[row].as_json() for row in ("given boxes", "given masks"))
    for figures in (boxes, masks):
        assert figures["ap50"] == figures["recall"] == 1.0
        assert figures["absent_false_positive_rate"] == 0.0
        assert set(figures["position_mm"]["by_distance"]) <= {"0.5 m", "0.7 m"}
    assert masks["mask_iou"] == pytest.approx(1.0, abs=0.02)  # geometry may drop pixels at depth steps
    assert boxes["mask_iou"] < masks["mask_iou"]
    assert set(masks["ms"]) == {"detect", "segment", "pose", "merge", "total"}


def test_rows_come_in_order_the_same_thing_is_measured_once_and_missing_weights_are_said(capsys):
    figures = measure(["colour", "colour+grabcut", "./nowhere+grabcut"], 1, 0, 1)
    assert list(figures) == ["colour", "colour+grabcut", "./nowhere+grabcut"]
    assert figures["colour"] == figures["colour+grabcut"]
    assert "no folder './nowhere'" in figures["./nowhere+grabcut"]["unavailable"]
    text = table(figures)
    assert "not measured: there is no folder './nowhere'" in text
    assert "1 frames" in text
    assert "[1/1 frames]" in capsys.readouterr().err


def test_average_precision_sees_boxes_below_the_threshold_and_the_pose_does_not():
    frame = render([cube(RED, 0.5, 0.1), cube(YELLOW, 0.5, -0.1)])
    (red,) = (d for d in ColourShapeDetector().detect(frame, ["red cube"]))
    recorder = RecordingDetector(ColourShapeDetector(), threshold=red.score + 0.01)
    assert recorder.detect(frame, ["red cube"]) == []
    assert [d.score for d in recorder.drawn] == [red.score]
    looker = Looker("default")
    assert looker.threshold == operating_threshold(ColourShapeDetector()) > LOWEST_SCORE
    assert Scores(looker.threshold).threshold == looker.threshold


def test_a_phrase_that_a_detector_refuses_counts_as_not_found():
    frame = render([cube(RED, 0.5, 0.1)])
    found = KnownPhrases(ColourShapeDetector()).detect(frame, ["gizmo", "red cube"])
    assert [d.phrase for d in found] == ["red cube"]
