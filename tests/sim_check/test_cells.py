"""Cell files are read strictly, and mistakes in them are told by name."""

from pathlib import Path

import numpy as np
import pytest

from control.errors import ConfigError
from control.safety.limits import SafetyLimits
from sim_check.cells.loading import builtin_cells, load_cell
from sim_check.world.world import build_world

SMALLEST = """\
name: mine
objects: [red_cube]
cameras:
  - {name: static, mounting: static, position: [1.0, 0.0, 0.7], look_at: [0.4, 0.0, 0.0], fx: 600.0}
"""


@pytest.fixture
def write(tmp_path):
    def file(text):
        path = tmp_path / "mine.yaml"
        path.write_text(text)
        return path

    return file


def test_every_built_in_cell_loads_under_its_own_name():
    assert builtin_cells()[0] == "cubes"
    assert set(builtin_cells()) >= {"cubes", "cubes-blocked", "fruit-bowl"}
    for name in builtin_cells():
        cell = load_cell(name)
        assert cell.name == name
        assert {c.mounting for c in cell.cameras} == {"static", "wrist"}


def test_an_unknown_cell_is_answered_with_the_built_in_ones():
    listed = r"no built-in cell 'cubs'; built-in are cubes, cabinet-\w+, .*cubes-blocked, .*fruit-bowl"
    with pytest.raises(ConfigError, match=listed):
        load_cell("cubs")


def test_a_missing_file_is_named():
    with pytest.raises(ConfigError, match=r"no cell file 'nowhere/x.yaml'"):
        load_cell("nowhere/x.yaml")


def test_a_file_of_ones_own_gets_the_default_safety_table(write):
    cell = load_cell(write(SMALLEST))
    assert cell.safety_limits() == SafetyLimits()
    assert cell.simulation is None


@pytest.mark.parametrize(
    ("line", "where", "valid"),
    [
        ("colour: blue", "colour", "name, description, robot, cameras"),
        ("robot: {profil: panda/5}", "robot.profil", "profile, gripper, position, yaw_deg"),
        (
            "simulation: {placements: [{object: red_cube, onn: red_cube}]}",
            "simulation.placements[0].onn",
            "stands_on, lies_in",
        ),
        ("simulation: {depth_noise: {basline: 0.1}}", "simulation.depth_noise.basline", "baseline"),
    ],
)
def test_an_unknown_key_is_told_with_its_place_and_the_valid_keys(write, line, where, valid):
    with pytest.raises(ConfigError) as error:
        load_cell(write(SMALLEST + line + "\n"))
    text = str(error.value)
    assert "mine.yaml" in text
    assert f"unknown key '{where}'" in text
    assert valid in text


def test_a_colour_that_the_catalogue_lacks_is_told_with_the_ones_that_it_has(write):
    with pytest.raises(ConfigError, match=r"microwave\.colour: there is no colour 'beige'; colours are red, .*, wood"):
        load_cell(write(SMALLEST + "furniture: {microwave: {kind: microwave, colour: beige}}\n"))


def test_an_unknown_key_of_a_camera_is_told_with_its_number(write):
    with pytest.raises(ConfigError, match=r"unknown key 'cameras\[0\]\.focal'; valid keys there are name, mounting"):
        load_cell(write(SMALLEST.replace("fx: 600.0", "fx: 600.0, focal: 3")))


def test_broken_yaml_is_told_with_its_line(write):
    with pytest.raises(ConfigError, match=r"mine\.yaml:5: not valid YAML"):
        load_cell(write(SMALLEST + "robot: [\n"[:-1].replace("[", "{a: b: c}")))


def test_a_key_given_twice_is_a_mistake(write):
    with pytest.raises(ConfigError, match=r"mine\.yaml:5: not valid YAML \(key 'name' is given twice\)"):
        load_cell(write(SMALLEST + "name: other\n"))


def test_a_missing_key_is_named(write):
    with pytest.raises(ConfigError, match="key 'objects' is missing"):
        load_cell(write(SMALLEST.replace("objects: [red_cube]\n", "")))


def test_limits_are_changed_by_their_names_in_the_safety_table(write):
    cell = load_cell(
        write(
            SMALLEST + "safety: {hand_speed: 0.3, keep_out: [[[0, 0, 0], [0.1, 0.1, 0.1]]]}\n"
            "workspace: {low: [0, -0.5, 0], high: [0.8, 0.5, 1]}\n"
        )
    )
    limits = cell.safety_limits()
    assert limits.hand_speed == 0.3
    assert limits.velocity_scale == SafetyLimits().velocity_scale
    assert limits.workspace_high == (0.8, 0.5, 1.0)
    assert limits.keep_out == (((0, 0, 0), (0.1, 0.1, 0.1)),)


def test_ways_through_space_that_nobody_saw_are_avoided_unless_the_cell_says_otherwise(write):
    assert load_cell(write(SMALLEST)).safety_limits().unseen == "avoid"
    limits = load_cell(
        write(SMALLEST + "unseen: refuse\nsafety: {unseen_volume: 0.1, unseen_overhead: 0.5}\n")
    ).safety_limits()
    assert (limits.unseen, limits.unseen_volume, limits.unseen_overhead) == ("refuse", 0.1, 0.5)
    with pytest.raises(ConfigError, match="'allow', 'avoid' or 'refuse'"):
        load_cell(write(SMALLEST + "unseen: never\n"))


@pytest.mark.parametrize(
    ("safety", "message"),
    [
        ("{hand_sped: 0.3}", "no limit 'hand_sped'; valid are"),
        ("{hand_speed: fast}", "hand_speed must be a number that is not negative"),
        ("{hand_speed: -1}", "hand_speed must be a number that is not negative"),
        ("{workspace_low: [0, 0, 0]}", "the cell's `workspace`"),
        ("{keep_out: [1, 2]}", "keep_out must be a list of boxes"),
        ("{unseen: refuse}", r"the cell's own `unseen` \(allow, avoid or refuse\) is"),
    ],
)
def test_a_limit_that_makes_no_sense_is_refused(write, safety, message):
    with pytest.raises(ConfigError, match=message):
        load_cell(write(SMALLEST + f"safety: {safety}\n"))


def test_options_are_switched_by_name():
    assert load_cell("fruit-bowl").options == {"lemon_in_bowl": False}
    assert load_cell("fruit-bowl", {"lemon_in_bowl": True}).options == {"lemon_in_bowl": True}
    with pytest.raises(ConfigError, match=r"no option 'melon'; it has \['lemon_in_bowl'\]"):
        load_cell("fruit-bowl", {"melon": True})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("look_at: [0.4, 0.0, 0.0], ", ""), "give either look_at or quaternion"),
        (("fx: 600.0", "fx: 600.0, horizontal_fov_deg: 60"), "give either fx"),
        (("look_at: [0.4, 0.0, 0.0]", "look_at: [1.0, 0.0, 0.0]"), "up must not be parallel"),
        (("[red_cube]", "[red_cube, red_cube]"), "'red_cube' is named twice"),
        (("[red_cube]", "[Red-Cube]"), "match pattern"),
    ],
)
def test_conflicting_entries_are_refused(write, change, message):
    with pytest.raises(ConfigError, match=message):
        load_cell(write(SMALLEST.replace(*change)))


@pytest.mark.parametrize(
    ("placements", "message"),
    [
        ("[{object: apple}]", "objects are"),
        ("[{object: red_cube, stands_on: crate}]", "must be placed before it"),
        ("[{object: red_cube}, {object: red_cube}]", "placed twice"),
        ("[{object: red_cube, only_if: sunday}]", "not 'sunday'"),
    ],
)
def test_placements_must_refer_to_what_there_is(write, placements, message):
    with pytest.raises(ConfigError, match=message):
        load_cell(write(SMALLEST + f"simulation: {{placements: {placements}}}\n"))


def test_a_camera_looks_where_it_is_told_with_its_picture_upright():
    camera = load_cell("cubes").camera("static")
    pose = camera.mount_T_camera
    assert camera.look_at is not None
    target = np.linalg.inv(pose) @ np.append(camera.look_at, 1.0)
    assert np.allclose(target[:2], 0.0, atol=1e-9)
    assert target[2] > 0.5
    assert pose[2, 1] < -0.5  # the picture's y axis points down
    assert np.isclose(np.linalg.det(pose[:3, :3]), 1.0)


def test_field_of_view_and_focal_length_agree(write):
    lens = load_cell(write(SMALLEST.replace("fx: 600.0", "horizontal_fov_deg: 90.0"))).cameras[0].intrinsics
    assert lens.fx == pytest.approx(320.0)
    assert (lens.cx, lens.cy) == (319.5, 239.5)


def test_a_calibrated_camera_is_given_by_its_quaternion(write):
    cell = load_cell(write(SMALLEST.replace("look_at: [0.4, 0.0, 0.0]", "quaternion: [0.0, 1.0, 0.0, 0.0]")))
    assert np.allclose(cell.cameras[0].mount_T_camera[:3, :3], np.diag([1.0, -1.0, -1.0]))


def test_a_camera_that_is_not_there_is_answered_with_those_that_are():
    with pytest.raises(ConfigError, match=r"no camera 'side'; it has \['static', 'wrist'\]"):
        load_cell("cubes").camera("side")


def test_the_example_of_the_documentation_is_a_valid_cell(tmp_path):
    text = (Path(__file__).resolve().parents[2] / "docs" / "cells.md").read_text()
    (tmp_path / "my-bench.yaml").write_text(text.split("```yaml\n")[1].split("```")[0])
    cell = load_cell(tmp_path / "my-bench.yaml")
    assert cell.safety_limits().hand_speed == 0.3
    assert build_world(cell, 0, meshes=False).object_names


def test_the_furniture_of_the_documentation_is_valid_too(tmp_path):
    text = (Path(__file__).resolve().parents[2] / "docs" / "cells.md").read_text()
    blocks = [b.split("```")[0] for b in text.split("```yaml\n")[1:]]
    smallest = SMALLEST.replace("[red_cube]", "[red_cube, red_bar]")
    (tmp_path / "mine.yaml").write_text(smallest + blocks[1] + blocks[2])
    world = build_world(load_cell(tmp_path / "mine.yaml"), 0, meshes=False)
    assert world.furniture_names == ("wooden_cabinet", "microwave", "lever")
    assert world.joint_fraction("microwave_door") == pytest.approx(0.4, abs=0.01)
    assert world.object_names == ("red_cube", "red_bar")


def test_every_built_in_scene_is_shown_in_the_documentation():
    folder = Path(__file__).resolve().parents[2] / "docs"
    text = (folder / "scenes.md").read_text()
    for name in builtin_cells():
        assert f"`{name}`" in text
        assert f"(scenes/{name}.png)" in text
        assert (folder / "scenes" / f"{name}.png").stat().st_size < 150_000
