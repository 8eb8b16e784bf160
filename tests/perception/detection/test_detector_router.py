"""Which of two detectors a phrase goes to."""

import numpy as np
import pytest

from perception.detection.bundled import DETECTOR_FOLDER, BundledDetector
from perception.detection.colour_shape import ColourShapeDetector
from perception.detection.detector_router import DetectorRouter
from perception.errors import UnknownPhraseError
from perception.interfaces import Detection
from perception.pipeline import default_perception
from tests.support.scenes.perception_scenes import RED, cube, render


class Asked:
    """A detector that remembers what it was asked."""

    name = "asked"

    def __init__(self, score: float) -> None:
        self.score = score
        self.phrases: list[str] = []

    def detect(self, frame, phrases):
        self.phrases += phrases
        return [Detection(phrase, np.array([0.0, 0.0, 5.0, 5.0]), self.score) for phrase in phrases]


def only_kettles(phrase: str) -> None:
    if not phrase.endswith("kettle"):
        raise UnknownPhraseError(f"no kettle: {phrase}")


@pytest.fixture
def frame():
    return render([cube(RED, 0.5, 0.0)])


def test_each_phrase_goes_to_the_detector_that_knows_its_noun(frame):
    colour, learned = Asked(0.4), Asked(0.6)
    both = DetectorRouter(colour, learned, only_kettles)
    found = both.detect(frame, ["red cube", "kettle", "green kettle", "blue thing"])
    assert colour.phrases == ["red cube", "blue thing"]
    assert learned.phrases == ["kettle", "green kettle"]
    assert [d.phrase for d in found[:2]] == ["kettle", "green kettle"], "the best score comes first"
    assert both.name == "asked; for other nouns asked"


def test_the_learned_detector_is_not_asked_where_colour_and_shape_do(frame):
    colour, learned = Asked(0.4), Asked(0.6)
    DetectorRouter(colour, learned, only_kettles).detect(frame, ["red cube", "green apple"])
    assert learned.phrases == []


def test_a_phrase_that_neither_knows_is_refused_with_the_reasons_of_both(frame):
    both = DetectorRouter(ColourShapeDetector(), Asked(0.6), only_kettles)
    with pytest.raises(UnknownPhraseError) as caught:
        both.detect(frame, ["red cube", "spanner"])
    assert str(caught.value).startswith(
        "nobody here can look for 'spanner': the colour-and-shape detector cannot look for 'spanner': it knows the "
    )
    assert str(caught.value).endswith("; no kettle: spanner")


def test_the_default_knows_the_nouns_of_the_bundled_weights_too(frame):
    detector = default_perception().detector
    assert isinstance(detector, DetectorRouter)
    assert isinstance(detector.by_colour, ColourShapeDetector) and isinstance(detector.learned, BundledDetector)
    assert detector.is_for_learned("kettle") and not detector.is_for_learned("blue cube")
    with pytest.raises(UnknownPhraseError, match="nobody here can look for 'spanner'"):
        detector.is_for_learned("spanner")


def test_a_package_without_weights_still_knows_colour_and_shape(tmp_path, monkeypatch):
    monkeypatch.setattr("perception.detection.bundled.DETECTOR_FOLDER", tmp_path)
    assert tmp_path != DETECTOR_FOLDER
    assert isinstance(default_perception().detector, ColourShapeDetector)
