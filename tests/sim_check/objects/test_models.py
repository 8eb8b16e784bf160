"""Bodies of the object library are what the catalogue's entries say of them."""

from typing import get_args

import numpy as np
import pytest

from control.errors import ConfigError
from perception.catalogue.catalogue import BUILTIN_FILE, Catalogue, read_catalogue
from perception.catalogue.entries import ModelName, VisualName
from sim_check.models.object_visuals import VISUALS
from sim_check.objects.library import MODELS, known_nouns, object_model


def with_entry(tmp_path, text: str) -> Catalogue:
    path = tmp_path / "mine.yaml"
    path.write_text(BUILTIN_FILE.read_text() + text)
    return read_catalogue(path)


def test_every_name_of_a_model_or_picture_that_an_entry_may_say_has_its_builder():
    assert set(get_args(ModelName)) == set(MODELS)
    assert set(get_args(VisualName)) == set(VISUALS)


def test_every_entry_with_a_body_is_built_in_its_usual_sizes():
    for noun in known_nouns():
        thing = object_model(noun)
        assert thing.mass > 0 and thing.friction[0] > 0
        assert (thing.handle is not None) == (noun == "kettle")
        assert thing.container == (noun == "bowl")


def test_a_mass_is_that_of_the_usual_sizes_and_grows_with_the_volume(tmp_path):
    catalogue = with_entry(
        tmp_path, "  jar: {shape: cylinder, body: {extents: [0.07, 0.07, 0.09], mass: 0.3, paint: green}}\n"
    )
    assert object_model("jar", catalogue=catalogue).mass == pytest.approx(0.3)
    larger = object_model("red_jar", np.array([0.14, 0.14, 0.09]), catalogue=catalogue)
    assert larger.mass == pytest.approx(1.2)
    assert larger.friction[0] == catalogue.unknown.friction
    assert object_model("jar", catalogue=catalogue).rgb == catalogue.paints["green"]
    assert larger.rgb == catalogue.paints["red"]


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("{shape: box, body: {extents: [0.1, 0.1, 0.1], mass: 1, grasp: handle}}", "no handle; say body"),
        ("{shape: box, carries: inside, body: {extents: [0.1, 0.1, 0.1], mass: 1}}", "no inside; say on_top"),
        ("{shape: box, body: {model: kettle, extents: [0.1, 0.1, 0.1], mass: 1}}", "a handle; say handle"),
        ("{shape: cylinder, body: {model: bowl, extents: [0.1, 0.1, 0.1], mass: 1}}", "an inside; say inside"),
    ],
)
def test_an_entry_that_says_what_its_model_does_not_have_is_refused_by_name(tmp_path, entry, said):
    catalogue = with_entry(tmp_path, f"  jar: {entry}\n")
    with pytest.raises(ConfigError) as caught:
        object_model("jar", catalogue=catalogue)
    assert str(caught.value).startswith(f"{catalogue.source}: objects.jar.")
    assert said in str(caught.value)
