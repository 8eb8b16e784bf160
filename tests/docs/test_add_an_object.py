"""docs/how-to/add-an-object.md: the entry that it shows is all that a new object needs."""

import re
from pathlib import Path

import numpy as np
import pytest

from perception.catalogue.catalogue import BUILTIN_FILE, Catalogue, builtin_catalogue, read_catalogue
from perception.detection.colour_shape import ColourShapeDetector
from perception.errors import UnknownPhraseError
from perception.pipeline import perception_from_options
from perception.train.vocabulary import known_words
from planning.language.goal_language import parse_goal
from planning.language.names import MissingName, resolve
from sim_check.objects.library import noun_of, object_model
from sim_check.random_scenes.labelled_pictures import vocabulary
from sim_check.random_scenes.scenes import RandomScenes, SceneOptions
from sim_check.random_scenes.things import drawn_nouns, random_thing
from tests.support.scenes.perception_scenes import RED, YELLOW, Thing, cube, render

PAGE = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "add-an-object.md"
JAR = Thing("cylinder", (0.04, 0.04, 0.05), (0.5, -0.1, 0.05), RED)


@pytest.fixture(scope="module")
def catalogue(tmp_path_factory) -> Catalogue:
    """The built-in file with the page's entry at its end."""
    (entry,) = re.findall(r"```yaml\n(.+?)```", PAGE.read_text(), re.DOTALL)
    path = tmp_path_factory.mktemp("catalogue") / "objects.yaml"
    path.write_text(BUILTIN_FILE.read_text() + entry)
    return read_catalogue(path)


def test_the_new_noun_is_found_by_colour_and_shape(catalogue):
    frame = render([JAR, cube(YELLOW, 0.55, 0.12)])
    with pytest.raises(UnknownPhraseError, match="cannot look for 'jar'"):
        ColourShapeDetector().detect(frame, ["jar"])
    (box,) = ColourShapeDetector(catalogue=catalogue).detect(frame, ["red jar"])
    assert box.score > 0.5
    scene = perception_from_options("colour", catalogue=catalogue).perceive([frame], ["red_jar", "yellow_cube"])
    seen = scene.get("red_jar")
    assert seen is not None and seen.shape == "cylinder"
    assert seen.position == pytest.approx(JAR.position, abs=0.01)
    assert seen.extents == pytest.approx(2 * np.array(JAR.half), abs=0.015)


def test_the_new_noun_is_looked_for_in_its_own_sizes(catalogue):
    frame = render([Thing("cylinder", (0.012, 0.012, 0.014), (0.5, 0.0, 0.014), RED)])
    found = ColourShapeDetector(catalogue=catalogue).detect(frame, ["red jar", "red gadget"])
    assert [d.phrase for d in found] == ["red gadget"]


def test_the_object_library_builds_it(catalogue):
    thing = object_model("green_jar", catalogue=catalogue)
    assert (noun_of("green_jar"), thing.noun) == (None, "jar")
    assert [s.kind for s in thing.solids] == ["cylinder"]
    assert thing.extents == pytest.approx([0.07, 0.07, 0.09])
    assert (thing.mass, thing.friction[0]) == pytest.approx((0.30, 0.5))


def test_a_goal_may_call_it_by_its_synonym(catalogue):
    (clause,) = parse_goal("put the red canister on the crate").clauses
    names = ("red_jar", "red_cube", "crate")
    assert resolve(clause.subject, names, catalogue) == "red_jar"
    with pytest.raises(MissingName, match="there is no 'red canister' in view"):
        resolve(clause.subject, names)


def test_random_scenes_draw_it_and_name_it(catalogue):
    rng = np.random.default_rng(0)
    jars = [t for i in range(200) if "jar" in (t := random_thing(rng, f"t{i}", catalogue)).nouns]
    assert len(jars) > 5
    assert {t.colour for t in jars} == {"red", "green", "white"}
    assert all(0.05 <= t.extents[0] <= 0.09 and t.extents[0] == t.extents[1] for t in jars)
    assert "jar" in vocabulary(catalogue)["nouns"]
    words = known_words(vocabulary(catalogue)["nouns"], vocabulary(catalogue)["colours"], catalogue)
    assert set(words) - set(known_words(drawn_nouns(builtin_catalogue()), ())) >= {"jar", "glass", "pot"}
    options = SceneOptions(width=160, height=120, robot_share=0.0, furniture_share=0.0, scenes_per_pool=12)
    scenes = RandomScenes(1, options, catalogue=catalogue)
    named = {o.name.split("_")[-1] for _ in range(36) for o in scenes.frame()[1].objects}
    scenes.close()
    assert "jar" in named
