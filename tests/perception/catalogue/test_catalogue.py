"""The catalogue of objects: what the built-in file says holds together, and mistakes are told by file and entry."""

import subprocess
import sys
from pathlib import Path

import pytest

from perception.catalogue.catalogue import BUILTIN_FILE, builtin_catalogue, read_catalogue
from perception.detection.bundled import DETECTOR_FOLDER, DetectorCard, read_card
from perception.errors import CatalogueError
from sim_check.random_scenes.things import drawn_nouns

ROOT = Path(__file__).resolve().parents[3]
TIN = """\
  tin:
    shape: cylinder
    look: {outline: any, size: [0.05, 0.18]}
    body: {extents: [0.07, 0.07, 0.09], mass: 0.30}
"""


def refusal(tmp_path: Path, text: str) -> str:
    """What is said of a file of this text, without the file's path, which has to stand in front of every line."""
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(CatalogueError) as caught:
        read_catalogue(path)
    lines = str(caught.value).splitlines()
    assert all(line.startswith(str(path)) for line in lines)
    return "\n".join(line.removeprefix(f"{path}: ") for line in lines)


def with_tin(old: str, new: str) -> str:
    """The built-in file with one more entry, in which something is changed."""
    assert old in TIN
    return BUILTIN_FILE.read_text() + TIN.replace(old, new)


def test_the_bundled_detector_knows_the_words_of_random_scenes_in_their_order():
    card, catalogue = read_card(DETECTOR_FOLDER, DetectorCard), builtin_catalogue()
    assert card.nouns == drawn_nouns(catalogue)
    assert card.colours == tuple(catalogue.painted_words)


def test_words_of_one_entry_mean_the_same_and_words_of_two_do_not():
    same = builtin_catalogue().mean_the_same
    assert same("cube", "brick") and same("block", "brick") and same("tin", "can") and same("oven", "microwave")
    assert same("grey", "gray")
    assert not same("cube", "crate") and not same("pink", "magenta") and not same("brown", "wooden")


def test_a_colour_word_stands_for_the_colour_that_pixels_have():
    seen = builtin_catalogue().seen_colour
    assert (seen("wooden"), seen("violet"), seen("red")) == ("brown", "purple", "red")
    assert seen("golden") is None and "golden" in builtin_catalogue().spoken_colours


def test_nothing_is_read_before_somebody_asks():
    code = (
        "import perception.pipeline, perception.catalogue.phrases\n"
        "import planning.builtin.situation, planning.language.names\n"
        "import sim_check.objects.library, sim_check.cells.loading, sim_check.random_scenes.things\n"
        "from perception.catalogue.catalogue import builtin_catalogue\n"
        "raise SystemExit(builtin_catalogue.cache_info().currsize)\n"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0


def test_an_unknown_key_is_named_with_its_entry_and_the_keys_that_are_valid(tmp_path):
    said = refusal(tmp_path, with_tin("mass:", "weight: 1, mass:"))
    assert said == (
        "objects.tin.body.weight: unknown key; valid there are extents, density, mass, friction, paint, model, visual, "
        "grasp"
    )
    said = refusal(tmp_path, with_tin("    shape: cylinder", "    form: round\n    shape: cylinder"))
    assert said.startswith("objects.tin.form: unknown key; valid there are synonyms, shape, carries,")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("    shape: cylinder\n", "", "objects.tin.shape: the key is missing"),
        ("shape: cylinder", "shape: cone", "objects.tin.shape: Input should be 'box', 'cylinder' or 'sphere'"),
        ("outline: any", "outline: oval", "objects.tin.look.outline: Input should be 'round', 'vessel', 'angular', "),
        ("[0.05, 0.18]", "[0.18, 0.05]", "objects.tin.look: size must go up, as in [0.05, 0.18]"),
        ("mass: 0.30", "mass: -1", "objects.tin.body.mass: Input should be greater than 0"),
        (", mass: 0.30", "", "objects.tin.body: give either density in kg/m^3 or mass in kg"),
        ("mass: 0.30", "mass: 0.3, density: 9", "objects.tin.body: give either density in kg/m^3 or mass in kg"),
        ("mass: 0.30", "mass: 0.3, model: tin", "objects.tin.body.model: Input should be 'bowl' or 'kettle'"),
        ("mass: 0.30", "mass: 0.3, paint: pnik", "objects.tin.body.paint: 'pnik' is none of the file's colours: red, "),
        (
            "    shape:",
            "    colours: [gold]\n    shape:",
            "objects.tin.colours: 'gold' is none of the file's colours",
        ),
        ("  tin:", "  tea tin:", "objects.tea tin: 'tea tin' must be one word of small letters"),
        ("  tin:", "  lever:", "objects.lever: 'lever' stands under furniture too; keep one of the two"),
        (", 0.09]", "]", "objects.tin.body.extents.2: the key is missing"),
        ("    body: ", "    drawn: {low: [1, 1, 1], high: [1, 1, 1]}\n    look_: ", "objects.tin.look_: unknown key"),
    ],
)
def test_a_value_that_is_not_valid_is_named_with_its_entry_and_what_is_valid(tmp_path, old, new, said):
    assert said in refusal(tmp_path, with_tin(old, new))


def test_what_random_scenes_draw_has_a_body_and_known_words(tmp_path):
    drawn = "    drawn: {low: [0.1, 0.1, 0.1], high: [0.1, 0.1, 0.2]%s}\n"
    said = refusal(tmp_path, BUILTIN_FILE.read_text() + "  tin:\n    shape: box\n" + drawn % "")
    assert said.startswith("objects.tin: random scenes draw what the object library builds; give a body")
    said = refusal(tmp_path, with_tin("    body", drawn % ", may_be_called: [canister]" + "    body"))
    assert said.startswith("objects.tin.drawn.may_be_called: 'canister' is none of the file's nouns: cube, block,")
    said = refusal(tmp_path, with_tin("    body", drawn.replace("0.2]", "0.05]") % "" + "    body"))
    assert said.startswith("objects.tin.drawn: low [0.1, 0.1, 0.1] must not be above high [0.1, 0.1, 0.05]")


def test_every_mistake_has_a_line_of_its_own(tmp_path):
    said = refusal(tmp_path, with_tin("mass: 0.30", "mass: heavy, frictoin: 1"))
    assert [line.split(":")[0] for line in said.splitlines()] == ["objects.tin.body.mass", "objects.tin.body.frictoin"]


def test_a_file_that_is_no_catalogue_is_refused(tmp_path):
    assert "not valid YAML" in refusal(tmp_path, "objects: {cube: [")
    assert "key 'cube' is given twice" in refusal(tmp_path, BUILTIN_FILE.read_text() + TIN.replace("tin", "cube"))
    assert refusal(tmp_path, "- cube").startswith("a catalogue has the keys colours, materials,")
    with pytest.raises(CatalogueError, match="the catalogue cannot be read"):
        read_catalogue(tmp_path / "absent.yaml")
