"""Learned detectors and segmenters: the published classes with tiny random weights, through the same code."""

import json
import shutil
import subprocess
import sys

import numpy as np
import pytest

from perception.detection import hf_detector, hf_segmenter
from perception.detection.devices import choose_device, load_package
from perception.detection.hf_detector import TransformersDetector
from perception.detection.hf_segmenter import TransformersSegmenter
from perception.detection.prompts import make_prompts, side_by_side
from perception.errors import ModelUnavailableError, UnknownPhraseError
from perception.frames import CameraIntrinsics, RgbdFrame
from perception.options import PerceptionOptions
from perception.pipeline import perception_from_options
from tests.support.models.perception_models import (
    save_tiny_detector,
    save_tiny_sam2,
    save_tiny_segmenter,
    tiny_vocabulary,
)

BOXES = np.array([[20.0, 20.0, 60.0, 70.0], [80.0, 10.0, 120.0, 40.0], [5.0, 50.0, 50.0, 90.0]])


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    root = tmp_path_factory.mktemp("models")
    save_tiny_detector(root / "grounding-dino")
    save_tiny_detector(root / "mm-grounding-dino", mm=True)
    save_tiny_segmenter(root / "sam")
    save_tiny_sam2(root / "sam2")
    return root


@pytest.fixture(params=["grounding-dino", "mm-grounding-dino"])
def detector_folder(folders, request):
    return str(folders / request.param)


@pytest.fixture(params=["sam", "sam2"])
def segmenter_folder(folders, request):
    return str(folders / request.param)


@pytest.fixture(scope="module")
def frame():
    colour = np.random.default_rng(0).integers(0, 255, (96, 128, 3), dtype=np.uint8)
    lens = CameraIntrinsics(128, 96, 100.0, 100.0, 63.5, 47.5)
    return RgbdFrame(colour, np.ones((96, 128), np.float32), lens, np.eye(4), 0.0)


@pytest.fixture(scope="module")
def tokenizer():
    from transformers import BertTokenizer

    return BertTokenizer(vocab=tiny_vocabulary(), do_lower_case=True)


def scores(found, phrase):
    """Of one phrase, best first, one of its boxes each."""
    return np.array([d.score for d in found if d.phrase == phrase])


# --- detectors


def test_a_detector_from_a_folder_draws_boxes_inside_the_picture(detector_folder, frame):
    found = TransformersDetector(detector_folder, threshold=0.0, most_boxes=4).detect(frame, ["red cube", "crate"])
    assert {d.phrase for d in found} == {"red cube", "crate"}
    assert [d.score for d in found] == sorted((d.score for d in found), reverse=True)
    for d in found:
        assert 0.0 <= d.score <= 1.0
        assert np.all(d.box_px >= 0) and np.all(d.box_px <= [128, 96, 128, 96])


def test_a_phrases_score_is_the_mean_over_its_own_tokens_of_what_the_published_class_gives(detector_folder, frame):
    torch = load_package("torch")
    from transformers import AutoModelForZeroShotObjectDetection, AutoProcessor

    processor = AutoProcessor.from_pretrained(detector_folder)
    network = AutoModelForZeroShotObjectDetection.from_pretrained(detector_folder).eval()
    inputs = processor(images=np.array(frame.colour), text="red cube. crate. banana.", return_tensors="pt")
    with torch.inference_mode():
        match = network(**inputs).logits[0].sigmoid().numpy()
    # [CLS] red cube . crate . b ##a ##n ##a ##n ##a . [SEP]
    expected = {"red cube": match[:, 1:3], "crate": match[:, 4:5], "banana": match[:, 6:12]}
    found = TransformersDetector(detector_folder, threshold=0.0).detect(frame, list(expected))
    for phrase, tokens in expected.items():
        assert scores(found, phrase) == pytest.approx(sorted(tokens.mean(1), reverse=True), abs=1e-5)


def test_prompts_side_by_side_give_what_each_gives_alone(detector_folder, frame):
    # With a phrase a prompt nothing else can have an influence; in one prompt the fusion of text and picture mixes.
    detector = TransformersDetector(detector_folder, threshold=0.0, most_phrases=1)
    phrases = ["crate", "banana", "red cube", "apple", "yellow bowl", "bowl"]
    together = detector.detect(frame, phrases)
    for phrase in phrases:
        alone = detector.detect(frame, [phrase])
        mine = [d for d in together if d.phrase == phrase]
        assert [d.score for d in mine] == pytest.approx([d.score for d in alone], abs=1e-5)
        assert np.allclose([d.box_px for d in mine], [d.box_px for d in alone], atol=1e-2)


def test_the_pictures_features_are_computed_once_for_all_prompts(detector_folder, frame, monkeypatch):
    detector = TransformersDetector(detector_folder, threshold=0.0, most_phrases=1)
    detector.detect(frame, ["crate"])
    _, network, memory = hf_detector._load_detector(hf_detector.Path(detector_folder), "cpu")
    sizes = []
    backbone = memory._backbone
    monkeypatch.setattr(memory, "_backbone", lambda x, m: sizes.append(len(x)) or backbone(x, m))
    detector.detect(frame, list("abcdefghi"))
    assert sizes == [1], "nine prompts in three batches, one picture"
    detector.detect(frame, ["crate"])
    assert sizes == [1, 1], "another call looks anew"
    assert network.model.backbone.forward is memory


def test_five_hundred_phrases_are_answered(folders, frame):
    phrases = [f"{a}{b} cube" for a in "abcdefghijklmnopqrstuvwxy" for b in "abcdefghijklmnopqrst"]
    assert len(set(phrases)) == 500
    detector = TransformersDetector(str(folders / "grounding-dino"), threshold=0.0, most_boxes=1)
    assert {d.phrase for d in detector.detect(frame, phrases)} == set(phrases)


def test_no_phrase_gives_no_box_and_loads_nothing(frame):
    assert TransformersDetector("./nothing").detect(frame, []) == []


@pytest.mark.parametrize("blank", ["", "  ", "...", "?"])
def test_a_phrase_without_a_word_is_refused(folders, frame, blank):
    with pytest.raises(UnknownPhraseError, match="names nothing to look for; give at least one word"):
        TransformersDetector(str(folders / "grounding-dino")).detect(frame, ["crate", blank])


def test_a_phrase_longer_than_a_prompt_is_refused(folders, frame):
    with pytest.raises(UnknownPhraseError, match="has 40 tokens, but a prompt holds 29; shorten it"):
        TransformersDetector(str(folders / "grounding-dino")).detect(frame, ["red " * 40])


def test_a_phrase_outside_of_the_vocabulary_is_refused(folders, frame):
    with pytest.raises(UnknownPhraseError, match="no part of the phrase 'куб' is in the detector's vocabulary"):
        TransformersDetector(str(folders / "grounding-dino")).detect(frame, ["куб"])


def test_marks_that_cut_prompts_do_not_cut_a_phrase(tokenizer):
    odd = ["red? cube.", "[SEP] crate", "apple.bowl"]
    (prompt,) = make_prompts(tokenizer, odd, limit=32)
    tokens = tokenizer.convert_ids_to_tokens(list(prompt.tokens))
    assert [tokens[a:b] for a, b in prompt.spans.values()] == [
        ["red", "cube"],
        ["s", "##e", "##p", "crate"],
        ["apple", "bowl"],
    ]
    assert tokens.count(".") == 3 and tokens.count("[SEP]") == 1 and "?" not in tokens


def test_a_threshold_that_no_box_reaches_yields_no_box(detector_folder, frame):
    assert TransformersDetector(detector_folder, threshold=1.01).detect(frame, ["red cube"]) == []


def test_weights_are_loaded_once_per_process(detector_folder, frame):
    TransformersDetector(detector_folder).detect(frame, ["crate"])
    before = hf_detector._load_detector.cache_info().misses
    TransformersDetector(detector_folder, precision="half").detect(frame, ["apple"])
    assert hf_detector._load_detector.cache_info().misses == before


def test_half_precision_finds_the_same_boxes(detector_folder, frame):
    single, half = (
        TransformersDetector(detector_folder, threshold=0.0, precision=p).detect(frame, ["red cube", "crate"])
        for p in ("single", "half")
    )
    # bfloat16 has 8 bits: a per cent in a score of tiny random weights.
    assert scores(half, "crate") == pytest.approx(scores(single, "crate"), abs=0.02)


def test_scores_that_are_no_numbers_are_an_error(folders, tmp_path, frame):
    from safetensors.numpy import load_file, save_file

    folder = tmp_path / "broken"
    shutil.copytree(folders / "grounding-dino", folder)
    weights = load_file(folder / "model.safetensors")
    weights["model.text_projection.bias"] = np.full_like(weights["model.text_projection.bias"], np.nan)
    save_file(weights, folder / "model.safetensors", {"format": "pt"})
    with pytest.raises(ModelUnavailableError, match="gives scores that are no numbers; use --precision single"):
        TransformersDetector(str(folder)).detect(frame, ["crate"])


def test_a_tokenizer_whose_marks_the_network_does_not_know_is_refused(folders, tmp_path, frame):
    swapped = tmp_path / "swapped"
    shutil.copytree(folders / "grounding-dino", swapped)
    text = (swapped / "tokenizer.json").read_text()
    swaps = {'".": 1012': '".": 1000', '"[unused1000]": 1000': '"[unused1000]": 1012'}
    for before, after in swaps.items():
        assert before in text
        text = text.replace(before, after)
    (swapped / "tokenizer.json").write_text(text)
    with pytest.raises(ModelUnavailableError, match=r"other numbers for \[CLS\], \[SEP\] and '\.' than the network"):
        TransformersDetector(str(swapped)).detect(frame, ["crate"])


# --- prompts


def test_every_phrase_owns_exactly_its_tokens(tokenizer):
    (prompt,) = make_prompts(tokenizer, ["Red cube", "crate", "banana", "crate"], limit=32)
    tokens = tokenizer.convert_ids_to_tokens(list(prompt.tokens))
    assert [tokens[a:b] for a, b in prompt.spans.values()] == [
        ["red", "cube"],
        ["crate"],
        ["b", "##a", "##n", "##a", "##n", "##a"],
    ]
    assert list(prompt.tokens) == tokenizer("red cube. crate. banana.")["input_ids"]


def test_more_phrases_than_a_prompt_holds_go_into_several(tokenizer):
    parts = make_prompts(tokenizer, ["red cube", "yellow cube", "crate", "apple"], limit=9)
    assert [list(p.spans) for p in parts] == [["red cube", "yellow cube"], ["crate", "apple"]]
    assert all(len(p.tokens) <= 9 for p in parts)
    few = make_prompts(tokenizer, ["red cube", "yellow cube", "crate"], limit=32, most_phrases=2)
    assert [list(p.spans) for p in few] == [["red cube", "yellow cube"], ["crate"]]


def test_shorter_prompts_are_filled_up(tokenizer):
    tokens, text = side_by_side(make_prompts(tokenizer, ["red cube", "crate"], 32, most_phrases=1), padding=0)
    assert tokens.shape == text.shape == (2, 5)
    assert tokens[1, -1] == 0 and text.tolist() == [[1, 1, 1, 1, 1], [1, 1, 1, 1, 0]]


# --- segmenters


def test_a_segmenter_from_a_folder_gives_a_mask_of_the_pictures_size(segmenter_folder, frame):
    segmenter = TransformersSegmenter(segmenter_folder)
    mask = segmenter.segment(frame, BOXES[0])
    assert mask.shape == frame.depth.shape and mask.dtype == bool
    assert not np.array_equal(mask, segmenter.segment(frame, BOXES[1])), "the box must matter"


def test_several_boxes_give_what_each_gives_alone(segmenter_folder, frame, monkeypatch):
    monkeypatch.setattr(hf_segmenter, "BOXES_AT_ONCE", 2)
    together = TransformersSegmenter(segmenter_folder).segment_all(frame, BOXES)
    assert together.shape == (3, 96, 128) and together.dtype == bool
    for mask, box in zip(together, BOXES, strict=True):
        # Sums in another order may tip a logit of random weights that is nearly 0.
        assert np.mean(mask != TransformersSegmenter(segmenter_folder).segment(frame, box)) < 0.001


def test_sam_gives_the_masks_of_the_published_class(folders, frame):
    torch = load_package("torch")
    from transformers import AutoModelForMaskGeneration, AutoProcessor

    processor = AutoProcessor.from_pretrained(folders / "sam")
    network = AutoModelForMaskGeneration.from_pretrained(folders / "sam").eval()
    inputs = processor(images=np.array(frame.colour), input_boxes=[BOXES.tolist()], return_tensors="pt")
    inputs["input_boxes"] = inputs["input_boxes"].float()
    with torch.inference_mode():
        output = network(**inputs, multimask_output=False)
    masks = processor.post_process_masks(output.pred_masks, inputs["original_sizes"], inputs["reshaped_input_sizes"])
    mine = TransformersSegmenter(str(folders / "sam")).segment_all(frame, BOXES)
    assert np.mean(mine != np.asarray(masks[0])[:, 0]) < 0.001


def test_no_box_gives_no_mask(segmenter_folder, frame):
    assert TransformersSegmenter(segmenter_folder).segment_all(frame, np.zeros((0, 4))).shape == (0, 96, 128)


def test_a_picture_is_embedded_once_for_all_of_its_boxes(segmenter_folder, frame, monkeypatch):
    TransformersSegmenter(segmenter_folder).segment(frame, BOXES[0])
    _, network = hf_segmenter.load_segmenter(hf_segmenter.Path(segmenter_folder), "cpu")
    calls = []
    embed = network.get_image_embeddings
    monkeypatch.setattr(network, "get_image_embeddings", lambda pixels: calls.append(1) or embed(pixels))
    segmenter = TransformersSegmenter(segmenter_folder)
    segmenter.segment_all(frame, BOXES)
    segmenter.segment(frame, BOXES[0])
    assert len(calls) == 1


# --- what cannot be used


def test_a_device_that_is_not_there_is_named(frame, monkeypatch):
    torch = load_package("torch")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert choose_device("auto") == "cpu"
    with pytest.raises(ModelUnavailableError) as caught:
        choose_device("cuda")
    assert str(caught.value) == (
        "device 'cuda' was asked for, but of CUDA devices torch sees none; use --device cpu or --device auto"
    )


def test_a_second_device_needs_two(monkeypatch):
    torch = load_package("torch")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 1)
    assert choose_device("auto") == choose_device("cuda") == "cuda:0"
    with pytest.raises(ModelUnavailableError, match=r"'cuda:1' was asked for, .* torch sees 1 of them \(cuda:0"):
        choose_device("cuda:1")


def test_weights_with_gaps_are_refused_rather_than_filled_at_random(folders, tmp_path, frame):
    from safetensors.numpy import load_file, save_file

    folder = tmp_path / "gaps"
    shutil.copytree(folders / "sam", folder)
    weights = load_file(folder / "model.safetensors")
    del weights["mask_decoder.iou_token.weight"]
    save_file(weights, folder / "model.safetensors", {"format": "pt"})
    with pytest.raises(ModelUnavailableError, match=r"1 of its weights are absent, the first is mask_decoder\.iou_tok"):
        TransformersSegmenter(str(folder)).segment(frame, BOXES[0])


def test_files_as_on_the_hub_load(folders, tmp_path, frame):
    # The published folders keep the image processor in a file of its own and have no processor_config.json.
    for name in ("grounding-dino", "sam"):
        shutil.copytree(folders / name, tmp_path / name)
        whole = json.loads((tmp_path / name / "processor_config.json").read_text())
        (tmp_path / name / "processor_config.json").unlink()
        images = whole["image_processor"] | {"processor_class": whole["processor_class"]}
        images["image_processor_type"] = images["image_processor_type"].removesuffix("Pil")
        (tmp_path / name / "preprocessor_config.json").write_text(json.dumps(images))
    detector = [TransformersDetector(str(root / "grounding-dino"), threshold=0.0) for root in (folders, tmp_path)]
    assert len({d.detect(frame, ["crate"])[0].score for d in detector}) == 1
    masks = [TransformersSegmenter(str(root / "sam")).segment(frame, BOXES[0]) for root in (folders, tmp_path)]
    assert np.array_equal(masks[0], masks[1])


def test_options_name_the_learned_parts(folders):
    detector, segmenter = str(folders / "grounding-dino"), str(folders / "sam")
    chosen = perception_from_options(detector, segmenter, PerceptionOptions(offline=True))
    assert chosen.name == (
        f"{detector} (learned detector, transformers) + {segmenter} (learned segmenter, transformers)"
    )


def test_perception_starts_without_loading_torch():
    code = (
        "import sys, perception.pipeline, perception.detection.hf_detector as m; m.TransformersDetector('a/b');"
        "print([n for n in ('torch', 'transformers', 'open3d') if n in sys.modules])"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == "[]"
