"""Boxes by colour and shape, and their suppression: what is found, what is refused, what is not there."""

import numpy as np
import pytest

from perception.catalogue.catalogue import builtin_catalogue
from perception.catalogue.phrases import appearance_of, parse_phrase
from perception.detection.colour_shape import ColourShapeDetector
from perception.detection.nms import box_iou, suppress
from perception.errors import UnknownPhraseError
from perception.frames import CameraIntrinsics, RgbdFrame
from perception.interfaces import Detection
from tests.support.scenes.perception_scenes import BLUE, GREEN, RED, WHITE, WOOD, YELLOW, Thing, cube, render


@pytest.fixture(scope="module")
def cubes():
    crate = Thing("box", (0.08, 0.06, 0.03), (0.55, -0.18, 0.03), WOOD, 0.2)
    return render([crate, cube(RED, 0.45, 0.12), cube(YELLOW, 0.6, 0.05)])


@pytest.fixture(scope="module")
def fruit():
    apple = Thing("sphere", (0.035, 0.035, 0.035), (0.5, 0.1, 0.035), RED)
    lemon = Thing("ellipsoid", (0.04, 0.028, 0.028), (0.45, -0.02, 0.028), YELLOW, 0.7)
    bowl = Thing("cylinder", (0.07, 0.07, 0.025), (0.55, -0.18, 0.025), BLUE)
    return render([apple, lemon, bowl])


def phrases_found(frame: RgbdFrame, *phrases: str) -> set[str]:
    return {d.phrase for d in ColourShapeDetector().detect(frame, phrases)}


def test_cubes_and_a_crate_are_found_by_their_phrases(cubes):
    assert phrases_found(cubes, "red cube", "yellow cube", "crate") == {"red cube", "yellow cube", "crate"}


def test_fruit_and_a_bowl_are_found_by_their_phrases(fruit):
    assert phrases_found(fruit, "apple", "lemon", "bowl") == {"apple", "lemon", "bowl"}


@pytest.mark.parametrize("absent", ["banana", "apple", "lemon", "bowl", "green block", "blue cube"])
def test_what_is_not_among_the_cubes_yields_no_box(cubes, absent):
    assert phrases_found(cubes, absent) == set()


@pytest.mark.parametrize("absent", ["red cube", "yellow cube", "crate", "banana", "orange", "green apple"])
def test_what_is_not_among_the_fruit_yields_no_box(fruit, absent):
    assert phrases_found(fruit, absent) == set()


def test_a_box_sits_tightly_around_its_thing():
    frame = render([cube(RED, 0.5, 0.0, yaw=0.0)], seed=None)
    (found,) = ColourShapeDetector().detect(frame, ["red cube"])
    red = (frame.colour[..., 0].astype(int) - frame.colour[..., 1]) > 60
    y, x = np.nonzero(red)
    # The lowest 6 mm of a thing may be the table to the detector: 3 px here.
    assert found.box_px == pytest.approx([x.min(), y.min(), x.max() + 1, y.max() + 1], abs=3.0)


def test_links_of_a_white_arm_over_a_table_are_no_bowl():
    link = Thing("sphere", (0.06, 0.06, 0.06), (0.4, 0.0, 0.45), WHITE)
    assert phrases_found(render([link]), "white bowl") == set()


def test_a_white_bowl_on_the_table_is_found():
    bowl = Thing("cylinder", (0.08, 0.08, 0.03), (0.5, 0.0, 0.03), WHITE)
    assert phrases_found(render([bowl]), "white bowl") == {"white bowl"}


def test_an_unknown_noun_with_a_colour_is_looked_for_by_colour():
    block = Thing("box", (0.03, 0.02, 0.02), (0.5, 0.0, 0.02), GREEN, 0.4)
    assert phrases_found(render([block]), "green gadget") == {"green gadget"}


def test_an_unknown_noun_without_a_colour_is_refused_with_what_is_known(cubes):
    with pytest.raises(UnknownPhraseError) as caught:
        ColourShapeDetector().detect(cubes, ["red cube", "spanner"])
    text = str(caught.value)
    assert "cannot look for 'spanner'" in text
    assert "'crate'" in text and "'yellow'" in text and "learned detector" in text


def test_a_colour_picture_alone_is_enough_for_boxes(cubes):
    blind = RgbdFrame(
        cubes.colour, np.full(cubes.depth.shape, np.nan, np.float32), cubes.intrinsics, cubes.world_T_camera, 0.0
    )
    assert phrases_found(blind, "red cube") == {"red cube"}


def test_an_empty_table_yields_nothing():
    assert phrases_found(render([]), *builtin_catalogue().appearances) == set()


def test_a_picture_of_noise_yields_no_error():
    rng = np.random.default_rng(0)
    colour = rng.integers(0, 255, (120, 160, 3), dtype=np.uint8)
    frame = RgbdFrame(
        colour, np.ones((120, 160), np.float32), CameraIntrinsics(160, 120, 150, 150, 80, 60), np.eye(4), 0
    )
    for found in ColourShapeDetector().detect(frame, list(builtin_catalogue().appearances)):
        assert 0.0 <= found.score <= 1.0


def test_orange_is_a_colour_before_a_noun_and_a_fruit_at_the_end():
    assert parse_phrase("orange cube").colours == (builtin_catalogue().colours["orange"],)
    assert parse_phrase("orange cube").appearance is builtin_catalogue().appearances["cube"]
    assert parse_phrase("the orange").appearance is builtin_catalogue().appearances["orange"]


def test_a_named_colour_replaces_the_usual_ones():
    assert [c.word for c in parse_phrase("green apple").colours] == ["green"]
    assert [c.word for c in parse_phrase("apple").colours] == ["red", "green"]
    assert [c.word for c in parse_phrase("wooden crate").colours] == ["brown"]


def test_round_nouns_are_fitted_with_round_solids():
    solids = [appearance_of(phrase).solid for phrase in ("apple", "bowl", "red cube", "spanner")]
    assert solids == ["sphere", "cylinder", "box", "box"]


def detection(phrase: str, box: tuple[float, ...], score: float) -> Detection:
    return Detection(phrase, np.array(box, float), score)


def test_the_overlap_of_half_a_box_is_a_third_of_the_union():
    assert box_iou(np.array([0, 0, 2, 2]), np.array([[0, 1, 2, 3], [5, 5, 6, 6], [0, 0, 0, 0]])) == pytest.approx(
        np.array([[1 / 3, 0.0, 0.0]])
    )


def test_of_two_boxes_of_one_phrase_on_one_thing_the_better_stays():
    kept = suppress([detection("cube", (0, 0, 10, 10), 0.5), detection("cube", (1, 0, 11, 10), 0.9)])
    assert [d.score for d in kept] == [0.9]


def test_two_phrases_for_the_same_pixels_are_one_thing_under_the_better_name():
    kept = suppress([detection("apple", (0, 0, 10, 10), 0.5), detection("red cube", (0, 0, 10, 10), 0.9)])
    assert [d.phrase for d in kept] == ["red cube"]


def test_an_apple_and_the_bowl_around_it_both_stay():
    kept = suppress([detection("apple", (2, 0, 8, 6), 0.5), detection("bowl", (0, 0, 10, 10), 0.9)])
    assert {d.phrase for d in kept} == {"apple", "bowl"}


def test_nothing_to_suppress_is_nothing():
    assert suppress([]) == []
