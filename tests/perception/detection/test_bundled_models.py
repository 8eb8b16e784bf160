"""Bundled weights: a card says what they know, everything else is refused; and the options of perception."""

import json
import subprocess

import numpy as np
import pytest

from perception.detection import bundled
from perception.detection.bundled import BundledDetector, DetectorCard, SegmenterCard, bundled_segmenter, read_card
from perception.detection.crop_segmenter import CropSegmenter
from perception.errors import ModelUnavailableError, OptionError, UnknownPhraseError
from perception.options import PerceptionOptions
from perception.pipeline import perception_from_options
from perception.stages.named_boxes import kept_boxes
from tests.support.models.perception_models import save_tiny_detector, save_tiny_segmenter
from tests.support.scenes.perception_scenes import RED, cube, render

CARD = {
    "name": "tiny MM-GroundingDINO",
    "made": "2026-11-25",
    "trained_on": "random weights of the tests",
    "figures": {"AP50": 0.0},
    "nouns": ["cube", "crate", "coffee can", "orange"],
    "colours": ["red", "grey", "orange"],
    "threshold": 0.0,
    "most_phrases": 1,
}


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    root = tmp_path_factory.mktemp("weights")
    save_tiny_detector(root / "detector", mm=True)
    (root / "detector" / "card.json").write_text(json.dumps(CARD))
    save_tiny_segmenter(root / "segmenter")
    plain = {k: CARD[k] for k in ("name", "made", "trained_on", "figures")}
    (root / "segmenter" / "card.json").write_text(json.dumps(plain | {"name": "tiny SAM"}))
    (root / "segmenter" / "replan.json").write_text('{"crop_factor": 1.4}')
    return root


@pytest.fixture(scope="module")
def frame():
    return render([cube(RED, 0.5, 0.0)])


def test_phrases_come_back_as_they_were_asked(weights, frame):
    detector = BundledDetector(weights / "detector")
    found = detector.detect(frame, ["the red cube", "red cube", "Gray crate"])
    assert {d.phrase for d in found} == {"the red cube", "red cube", "Gray crate"}
    one, other = ([d.score for d in found if d.phrase == p] for p in ("the red cube", "red cube"))
    assert one == other, "both are one question to the network"
    assert detector.name == "tiny MM-GroundingDINO (bundled, learned on rendered scenes)"


@pytest.mark.parametrize(
    ("phrase", "asked"),
    [
        ("red cube", "red cube"),
        ("a Gray crate", "grey crate"),
        ("coffee_can", "coffee can"),
        ("orange", "orange"),
        ("the orange orange", "orange orange"),
        ("red-grey cube.", "red grey cube"),
    ],
)
def test_a_phrase_is_colours_and_a_noun_of_the_card(weights, phrase, asked):
    assert BundledDetector(weights / "detector").known_words(phrase) == asked


@pytest.mark.parametrize("phrase", ["spanner", "red", "green cube", "cube crate", "coffee", ""])
def test_other_words_are_refused_with_the_words_that_are_known(weights, frame, phrase):
    with pytest.raises(UnknownPhraseError) as caught:
        BundledDetector(weights / "detector").detect(frame, ["red cube", phrase])
    assert str(caught.value) == (
        f"the bundled detector cannot look for '{phrase}': it was trained with the nouns "
        "['coffee can', 'crate', 'cube', 'orange'] and the colours ['grey', 'orange', 'red']; "
        "say colours and one of the nouns, or choose another detector"
    )


def test_the_cards_threshold_holds_unless_another_is_asked_for(weights, frame):
    assert BundledDetector(weights / "detector").detect(frame, ["cube"])
    assert not BundledDetector(weights / "detector", threshold=1.0).detect(frame, ["cube"])


def test_a_bundled_segmenter_looks_at_crops_when_its_settings_say_so(weights, frame):
    segmenter = bundled_segmenter(weights / "segmenter")
    assert isinstance(segmenter, CropSegmenter)
    assert segmenter.name == "tiny SAM (bundled, learned on rendered scenes)"
    assert segmenter.segment(frame, np.array([100.0, 100.0, 200.0, 200.0])).shape == (480, 640)


def test_a_package_without_weights_says_what_to_choose_instead(tmp_path):
    with pytest.raises(ModelUnavailableError) as caught:
        read_card(tmp_path / "detector", DetectorCard)
    assert str(caught.value) == (
        f"this package has no bundled detector ({tmp_path}/detector/card.json is not there); "
        "say --detector colour, or give a folder or hub name (see docs/models.md)"
    )
    with pytest.raises(ModelUnavailableError, match=r"no bundled segmenter .*; say --segmenter grabcut, or give a"):
        bundled_segmenter(tmp_path / "segmenter")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"threshold": 1.5}, "threshold: Input should be less than or equal to 1"),
        ({"nouns": []}, "nouns: Tuple should have at least 1 item"),
        ({"colour": ["red"]}, "colour: Extra inputs are not permitted"),
    ],
)
def test_a_card_that_is_not_valid_is_named(tmp_path, change, message):
    (tmp_path / "card.json").write_text(json.dumps(CARD | change))
    with pytest.raises(ModelUnavailableError, match=rf"card\.json is not valid: {message}"):
        read_card(tmp_path, DetectorCard)


def test_a_card_that_is_no_json_is_named(tmp_path):
    (tmp_path / "card.json").write_text("{")
    with pytest.raises(ModelUnavailableError, match=r"card\.json is not JSON"):
        read_card(tmp_path, SegmenterCard)


def test_weights_in_the_package_are_not_kept_out_of_it():
    for folder in (bundled.DETECTOR_FOLDER, bundled.SEGMENTER_FOLDER):
        for name in ("model.safetensors", "card.json", "tokenizer.json"):
            asked = subprocess.run(
                ["git", "check-ignore", "-q", str(folder / name)], cwd=bundled.WEIGHTS.parent, check=False
            )
            assert asked.returncode != 0, f"{folder / name} would be ignored, and left out of the wheel"


# --- options


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"threshold": 1.5}, "--threshold 1.5 is not valid; it must be from 0 to 1"),
        ({"threshold": float("nan")}, "--threshold nan is not valid; it must be from 0 to 1"),
        ({"same_phrase_iou": -0.1}, "--same-phrase-iou -0.1 is not valid; it must be from 0 to 1"),
        ({"other_phrase_iou": 2.0}, "--other-phrase-iou 2 is not valid; it must be from 0 to 1"),
        ({"most_per_phrase": 0}, "--most-per-phrase 0 is not valid; it must be at least 1"),
        ({"device": "gpu"}, "--device 'gpu' is not valid; it must be auto, cpu, cuda or cuda:<number>"),
        ({"precision": "double"}, "--precision 'double' is not valid; it must be auto, half or single"),
    ],
)
def test_an_option_outside_of_its_range_is_named(option, message):
    with pytest.raises(OptionError) as caught:
        PerceptionOptions(**option)
    assert str(caught.value) == message


def test_the_threshold_reaches_every_detector(weights, monkeypatch):
    monkeypatch.setattr(bundled, "DETECTOR_FOLDER", weights / "detector")
    for name in ("colour", "bundled", str(weights / "detector")):
        chosen = perception_from_options(name, options=PerceptionOptions(threshold=1.0)).detector
        assert chosen.detect(render([cube(RED, 0.5, 0.0)]), ["red cube"]) == [], name


def test_the_options_say_which_boxes_stay(frame):
    from perception.interfaces import Detection

    boxes = [(0, 0, 10, 10), (1, 0, 11, 10), (50, 50, 60, 60)]

    class Boxes:
        name = "boxes by hand"

        def detect(self, frame, phrases):
            return [Detection("cube", np.array(b, float), 0.9 - 0.1 * k) for k, b in enumerate(boxes)]

    def kept(**options):
        found = kept_boxes(Boxes(), frame, ("cube",), PerceptionOptions(**options))
        return [tuple(d.box_px.astype(int)) for d in found]

    assert kept() == [boxes[0], boxes[2]]
    assert kept(same_phrase_iou=0.9) == boxes
    assert kept(most_per_phrase=1) == [boxes[0]]
