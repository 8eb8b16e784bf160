"""Colour words of what was seen."""

import numpy as np
import pytest

from perception.catalogue.catalogue import builtin_catalogue
from perception.catalogue.colour_words import colour_word
from perception.pipeline import default_perception
from perception.scene_file import LookRecord
from tests.support.scenes.perception_scenes import BLUE, RED, Thing, cube, render

PAINTS = builtin_catalogue().paints


def spread(rgb, light=1.0, noise=4.0, n=400):
    pixels = 255.0 * light * np.asarray(rgb) + np.random.default_rng(0).normal(0.0, noise, (n, 3))
    return np.clip(np.round(pixels), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("word", [w for w in builtin_catalogue().colours if w not in ("black", "cyan", "white")])
@pytest.mark.parametrize("light", [0.75, 1.0])
def test_a_plain_colour_gets_its_word_in_light_and_in_shade(word, light):
    assert colour_word(spread(PAINTS[word], light)) == word


@pytest.mark.parametrize("word", ["black", "cyan", "white"])
def test_black_cyan_and_white_get_their_words_in_light(word):
    assert colour_word(spread(PAINTS[word])) == word


def test_a_thing_half_in_the_shade_has_the_colour_of_its_lit_half():
    pixels = np.concatenate([spread(PAINTS["red"], 0.15), spread(PAINTS["red"], 1.0)])
    assert colour_word(pixels) == "red"


def test_a_few_pixels_or_a_colour_between_words_stay_undecided():
    assert colour_word(spread(PAINTS["red"], n=8)) is None
    assert colour_word(spread((0.60, 0.50, 0.50))) is None


def test_what_is_seen_is_said_with_its_colour_and_comes_back_from_a_scene_file():
    ball = Thing("sphere", (0.035, 0.035, 0.035), (0.55, -0.15, 0.035), BLUE)
    scene = default_perception().perceive([render([cube(RED, 0.5, 0.1), ball])], ["cube", "blue_ball"])
    assert {o.name: o.colour for o in scene.objects} == {"cube": "red", "blue_ball": "blue"}
    record = LookRecord.of(scene, "static")
    assert [o.colour for o in record.scene("made up").objects] == ["red", "blue"]


def test_a_scene_file_of_before_colours_were_said_is_still_read():
    scene = default_perception().perceive([render([cube(RED, 0.5, 0.1)])], ["red_cube"])
    content = LookRecord.of(scene, "static").model_dump(mode="json")
    del content["objects"][0]["colour"]
    assert LookRecord.model_validate(content).scene("older").objects[0].colour is None
