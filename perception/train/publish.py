"""From a training's checkpoints to the bundled weights with their cards.

Figures and the detector's threshold come from rendered pictures of seeds that were never trained on
(`sim_check.random_scenes.labelled_pictures`, seeds from `HELD_OUT` on).
"""

import json
import shutil
from collections.abc import Callable
from datetime import date
from pathlib import Path

import numpy as np

from perception.detection.bundled import CARD_FILE, DetectorCard, ModelCard, SegmenterCard
from perception.detection.crop_segmenter import CropSegmenter, CropSettings
from perception.detection.hf_detector import TransformersDetector
from perception.detection.nms import suppress
from perception.evaluation.metrics import (
    ScoredQuestion,
    absent_false_positive_rate,
    average_precision,
    mask_iou,
    recall,
)
from perception.frames import CameraIntrinsics, RgbdFrame
from perception.interfaces import Detection
from perception.train.detector import SIDES, boxes_of
from perception.train.model_card import page
from perception.train.questions import ask
from perception.train.segmenter import CROP_FACTOR, LEAST_PIXELS, LOOSE
from perception.train.shards import Sample, Shards

LOWEST = 0.05  # scores below are not looked at
MOST_PHRASES = 8  # in one prompt, as in training


def publish_detector(
    trained: Path, held_out: Shards, to: Path, made: date, steps: int, pictures: int, say: Callable[[str], None]
) -> DetectorCard:
    """Measure trained weights and copy them, with a card, to where the package expects them.

    Args:
        trained: Folder written by `train_detector`.
        held_out: Pictures that were never trained on.
        to: Folder for weights and card; replaced.
        made: Day for the card.
        steps, pictures: Of the training, for the card.
        say: Progress.
    """
    assert held_out.words is not None
    short_side, questions = best_size(trained, held_out, say)
    threshold = choose_threshold(questions)
    figures = {
        "ap50": round(average_precision(questions), 3),
        "recall_at_threshold": round(recall(questions, threshold), 3),
        "absent_false_positive_rate_at_threshold": round(absent_false_positive_rate(questions, threshold), 4),
    }
    card = DetectorCard(
        name="small MM-GroundingDINO without feature enhancer",
        made=made,
        trained_on=f"{steps} steps of 16 pictures, drawn from {pictures} rendered ones of random cells (MuJoCo)",
        figures=figures,
        nouns=held_out.words.nouns,
        colours=tuple(c for c in held_out.words.colours),
        fillers=("a", "an", "the", "weight"),
        threshold=threshold,
        most_phrases=MOST_PHRASES,
        short_side=short_side,
    )
    _write(trained, card, to)
    say(f"detector: {figures}, threshold {threshold}")
    return card


def best_size(trained: Path, held_out: Shards, say: Callable[[str], None]) -> tuple[int, list[ScoredQuestion]]:
    """The picture size, of three, at which the detector finds most, and its questions with their answers."""
    best: tuple[float, int, list[ScoredQuestion]] = (-1.0, SIDES[1], [])
    for short_side in (SIDES[1], SIDES[1] * 5 // 4, SIDES[1] * 3 // 2):
        detector = TransformersDetector(
            str(trained), offline=True, threshold=LOWEST, short_side=short_side, most_phrases=MOST_PHRASES
        )
        questions = answered(detector.detect, held_out)
        found = average_precision(questions)
        say(f"pictures of {short_side} px: AP50 {found:.3f}")
        if found > best[0]:
            best = (found, short_side, questions)
    return best[1], best[2]


def answered(detect: Callable[[RgbdFrame, tuple[str, ...]], list[Detection]], held_out: Shards) -> list[ScoredQuestion]:
    """Questions about all pictures, with what a detector answers."""
    assert held_out.words is not None
    questions = []
    for index in range(len(held_out)):
        sample = held_out.sample(index)
        asked = ask(sample.things, held_out.words, np.random.default_rng((1, index)))
        if not asked:
            continue
        found = suppress(detect(_frame(sample), tuple(q.phrase for q in asked)))
        for question in asked:
            mine = [d for d in found if d.phrase == question.phrase]
            questions.append(
                ScoredQuestion(
                    np.array([d.box_px for d in mine]).reshape(-1, 4),
                    np.array([d.score for d in mine]),
                    boxes_of(sample, list(question.answers)),
                )
            )
    return questions


def choose_threshold(questions: list[ScoredQuestion]) -> float:
    """The threshold, in steps of 0.01, at which most boxes are right and most things found: the largest F1.

    F1 = 2 right / (boxes drawn + things there)
    """

    def f1(threshold: float) -> float:
        there = sum(len(q.truth) for q in questions)
        drawn = sum(int((q.scores >= threshold).sum()) for q in questions)
        return 2.0 * recall(questions, threshold) * there / max(drawn + there, 1)

    return max((percent / 100 for percent in range(round(100 * LOWEST), 95)), key=f1)


def publish_segmenter(
    trained: Path, held_out: Shards, to: Path, made: date, steps: int, pictures: int, say: Callable[[str], None]
) -> SegmenterCard:
    """The same for the segmenter; its figure is the mean IoU of masks from loose boxes."""
    segmenter = CropSegmenter(trained, CropSettings(crop_factor=CROP_FACTOR), precision="single")
    rng = np.random.default_rng(2)
    overlaps = []
    for index in range(len(held_out)):
        sample = held_out.sample(index)
        numbers = [i for i, t in enumerate(sample.things) if t.clear and t.pixels >= LEAST_PIXELS]
        boxes = boxes_of(sample, numbers)
        loose = boxes + rng.uniform(-LOOSE, LOOSE, boxes.shape) * np.tile(boxes[:, 2:] - boxes[:, :2], 2)
        masks = segmenter.segment_all(_frame(sample), loose)
        overlaps += [
            mask_iou(mask, sample.labels == sample.things[n].label) for mask, n in zip(masks, numbers, strict=True)
        ]
    figures = {"mask_iou_from_loose_boxes": round(float(np.mean(overlaps)), 3)}
    card = SegmenterCard(
        name="small SAM on crops",
        made=made,
        trained_on=f"{steps} steps of 24 crops, drawn from {pictures} rendered pictures of random cells (MuJoCo)",
        figures=figures,
    )
    _write(trained, card, to)
    say(f"segmenter: {figures}")
    return card


def _frame(sample: Sample) -> RgbdFrame:
    """The picture as a frame; learned models look at its colours only."""
    height, width = sample.labels.shape
    lens = CameraIntrinsics(width, height, float(width), float(width), width / 2, height / 2)
    return RgbdFrame(sample.colour, np.ones((height, width), np.float32), lens, np.eye(4), 0.0)


def _write(trained: Path, card: ModelCard, to: Path) -> None:
    """Replace the folder by trained weights, their card and the page about them."""
    shutil.rmtree(to, ignore_errors=True)
    shutil.copytree(trained, to)
    (to / CARD_FILE).write_text(json.dumps(card.model_dump(mode="json"), indent=2) + "\n")
    (to / "README.md").write_text(page(card))
