"""Learned detectors and segmenters: the published classes with tiny random weights, through the same code."""

import subprocess
import sys

import numpy as np
import pytest

from perception.errors import ModelUnavailableError
from perception.frames import CameraIntrinsics, RgbdFrame
from perception.hf_models import TransformersDetector, TransformersSegmenter, prompts
from perception.pipeline import perception_from_options
from tests.perception_models import save_tiny_detector, save_tiny_segmenter, tiny_vocabulary


@pytest.fixture(scope="module")
def detector_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("models") / "detector"
    save_tiny_detector(folder)
    return folder


@pytest.fixture(scope="module")
def segmenter_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("models") / "segmenter"
    save_tiny_segmenter(folder)
    return folder


@pytest.fixture(scope="module")
def frame():
    colour = np.random.default_rng(0).integers(0, 255, (96, 128, 3), dtype=np.uint8)
    lens = CameraIntrinsics(128, 96, 100.0, 100.0, 63.5, 47.5)
    return RgbdFrame(colour, np.ones((96, 128), np.float32), lens, np.eye(4), 0.0)


@pytest.fixture(scope="module")
def tokenizer():
    from transformers import BertTokenizer

    return BertTokenizer(vocab=tiny_vocabulary(), do_lower_case=True)


def test_a_detector_from_a_folder_draws_boxes_inside_the_picture(detector_folder, frame):
    found = TransformersDetector(str(detector_folder), threshold=0.0, most_boxes=4).detect(frame, ["red cube", "crate"])
    assert {d.phrase for d in found} == {"red cube", "crate"}
    assert [d.score for d in found] == sorted((d.score for d in found), reverse=True)
    for d in found:
        assert 0.0 <= d.score <= 1.0
        assert np.all(d.box_px >= 0) and np.all(d.box_px <= [128, 96, 128, 96])


def test_a_threshold_that_no_box_reaches_yields_no_box(detector_folder, frame):
    assert TransformersDetector(str(detector_folder), threshold=1.01).detect(frame, ["red cube"]) == []


def test_a_phrase_keeps_its_score_when_asked_for_twice(detector_folder, frame):
    detector = TransformersDetector(str(detector_folder), threshold=0.0)
    first, again = (detector.detect(frame, ["red cube"])[0] for _ in range(2))
    assert first.score == again.score


def test_weights_are_loaded_once_per_process(detector_folder, frame):
    from perception.hf_models import _load_detector

    TransformersDetector(str(detector_folder)).detect(frame, ["crate"])
    before = _load_detector.cache_info().misses
    TransformersDetector(str(detector_folder)).detect(frame, ["apple"])
    assert _load_detector.cache_info().misses == before


def test_every_phrase_owns_exactly_its_tokens(tokenizer):
    ((text, spans),) = prompts(tokenizer, ["Red cube", "crate", "banana"], limit=32)
    tokens = tokenizer.convert_ids_to_tokens(tokenizer(text)["input_ids"])
    assert [tokens[a:b] for a, b in spans.values()] == [
        ["red", "cube"],
        ["crate"],
        ["b", "##a", "##n", "##a", "##n", "##a"],
    ]


def test_more_phrases_than_a_prompt_holds_go_into_several(tokenizer):
    parts = prompts(tokenizer, ["red cube", "yellow cube", "crate", "apple"], limit=9)
    assert [list(spans) for _, spans in parts] == [["red cube", "yellow cube"], ["crate", "apple"]]
    for text, spans in parts:
        assert len(tokenizer(text)["input_ids"]) <= 9
        assert max(after for _, after in spans.values()) < 9


def test_a_segmenter_from_a_folder_gives_a_mask_of_the_pictures_size(segmenter_folder, frame):
    segmenter = TransformersSegmenter(str(segmenter_folder))
    mask = segmenter.segment(frame, np.array([20.0, 20.0, 60.0, 70.0]))
    assert mask.shape == frame.depth.shape and mask.dtype == bool
    other = segmenter.segment(frame, np.array([80.0, 10.0, 120.0, 40.0]))
    assert not np.array_equal(mask, other), "the box must matter"


def test_a_picture_is_embedded_once_for_all_of_its_boxes(segmenter_folder, frame, monkeypatch):
    from perception.hf_models import _load_segmenter

    _, model = _load_segmenter(str(segmenter_folder), False)
    calls = []
    embed = model.get_image_embeddings
    monkeypatch.setattr(model, "get_image_embeddings", lambda pixels: calls.append(1) or embed(pixels))
    segmenter = TransformersSegmenter(str(segmenter_folder))
    for corner in (10.0, 20.0, 30.0):
        segmenter.segment(frame, np.array([corner, corner, corner + 40, corner + 40]))
    assert len(calls) == 1


def test_absent_weights_say_the_command_that_fetches_them(frame):
    with pytest.raises(ModelUnavailableError) as caught:
        TransformersDetector("IDEA-Research/no-such-detector", offline=True).detect(frame, ["crate"])
    assert "are not on this machine; fetch them once with: .venv/bin/hf download IDEA-Research/no-such-detector" in str(
        caught.value
    )


def test_a_folder_that_is_not_there_is_named(frame):
    with pytest.raises(ModelUnavailableError, match=r"there is no folder '\./nothing' and it is no hub name"):
        TransformersSegmenter("./nothing").segment(frame, np.array([0.0, 0.0, 9.0, 9.0]))


def test_a_segmenter_is_no_detector(segmenter_folder, frame):
    with pytest.raises(ModelUnavailableError, match="does not hold a zero-shot detector"):
        TransformersDetector(str(segmenter_folder)).detect(frame, ["crate"])


def test_a_detector_is_no_segmenter(detector_folder, frame):
    with pytest.raises(ModelUnavailableError, match="does not hold a SAM or SAM 2"):
        TransformersSegmenter(str(detector_folder)).segment(frame, np.array([0.0, 0.0, 9.0, 9.0]))


def test_options_name_the_learned_parts(detector_folder, segmenter_folder):
    chosen = perception_from_options(str(detector_folder), str(segmenter_folder), offline=True)
    assert chosen.name == (
        f"{detector_folder} (learned detector, transformers) + {segmenter_folder} (learned segmenter, transformers)"
    )


def test_perception_starts_without_loading_torch():
    code = (
        "import sys, perception.pipeline, perception.hf_models as m; m.TransformersDetector('a/b');"
        "print([n for n in ('torch', 'transformers', 'open3d') if n in sys.modules])"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == "[]"
