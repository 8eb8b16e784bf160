"""Scenes without a camera: poses that a person wrote down, and what was perceived before."""

import json

import numpy as np
import pytest

from benchmarks.scenes.estimates import estimate, scene
from control.errors import ConfigError
from control.robot.limits import REST_Q
from perception.errors import FrameError
from perception.scene_file import LookRecord, PerceptionResult
from replan.validate.scene_source import scene_for
from sim_check.cells.loading import builtin_cells, load_cell
from sim_check.twin.twin import build_twin


@pytest.fixture
def file(tmp_path):
    def write(text: str, name: str = "scene.yaml"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize("name", builtin_cells())
def test_the_poses_of_every_built_in_cell_stand_where_they_were_written(name):
    cell = load_cell(name)
    seen = scene_for(cell, None)
    assert set(seen.names) == set(cell.poses)
    twin = build_twin(cell, seen, np.array(REST_Q), 0.08)
    data = twin.start()
    for thing in seen.objects:
        drift = np.linalg.norm(data.body(thing.name).xpos - thing.position)
        assert drift < 0.012, f"{thing.name} is {1e3 * drift:.0f} mm from where it was written to stand"


def test_things_stand_on_the_table_or_on_what_they_are_said_to_stand_on(file):
    cell = load_cell("cubes")
    text = """
table: 0.1
poses:
  crate: {position: [0.5, 0.0], yaw_deg: 90}
  red_cube: {position: [0.5, 0.0], stands_on: crate, spread_mm: 5}
  yellow_cube: {position: [0.4, 0.2, 0.3], extents: [0.04, 0.04, 0.04]}
"""
    seen = scene_for(cell, file(text))
    heights = {o.name: float(o.position[2]) for o in seen.objects}
    assert heights == pytest.approx({"crate": 0.13, "red_cube": 0.185, "yellow_cube": 0.3})
    cube = seen.get("red_cube")
    assert cube is not None and cube.position_std == pytest.approx(0.005)
    crate = seen.get("crate")
    assert crate is not None and crate.yaw == pytest.approx(np.pi / 2)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (
            "poses: {red_cube: {position: [0.5, 0.0], stand_on: crate}}",
            r"unknown key 'poses\.red_cube\.stand_on'; valid",
        ),
        ("poses: {red_cube: {position: [0.5]}}", r"poses\.red_cube\.position"),
        ("poses: {}", r"poses: "),
        ("table: 0.0", r"key 'poses' is missing"),
        ("poses: {red_cube: {position: [.nan, 0.0]}}", r"finite"),
        ("poses: {red_cube: {position: [0.5, 0.0], stands_on: crate}}", r"stands_on names 'crate', which has no pose"),
        (
            "poses: {red_cube: {position: [1, 0], stands_on: crate}, crate: {position: [1, 0], stands_on: red_cube}}",
            r"goes round in a circle: red_cube on crate on red_cube",
        ),
        ("poses: {gizmo: {position: [0.5, 0.0]}}", r"no noun for 'gizmo'.*give both extents and shape"),
        ("poses: {red_cube: {position: [0.5, 0.0], joints: {lid: 0.5}}}", r"only furniture has joints"),
        ("poses: [", r"not valid YAML"),
    ],
)
def test_mistakes_in_a_scene_file_are_told_by_place(file, text, reason):
    path = file(text)
    with pytest.raises(ConfigError, match=reason) as caught:
        scene_for(load_cell("cubes"), path)
    assert str(path) in str(caught.value)


def test_a_cell_without_poses_says_how_to_give_a_scene():
    cell = load_cell("cubes").model_copy(update={"poses": {}})
    with pytest.raises(ConfigError, match=r"says nothing about where things stand; add `poses` .* or give --scene"):
        scene_for(cell, None)


def test_what_was_perceived_is_read_back_as_it_was(tmp_path):
    seen = scene(
        estimate("crate", (0.5, 0.1, 0.03), (0.11, 0.11, 0.06), yaw=0.3),
        estimate("apple", (0.4, -0.1, 0.035), (0.07, 0.07, 0.07), "sphere"),
        table=0.01,
    )
    path = tmp_path / "objects.json"
    PerceptionResult(source="made up", frames=(LookRecord.of(seen, "static"),)).write(path)
    for source in (path, tmp_path):
        back = scene_for(load_cell("cubes"), source)
        assert (back.support_height, back.stamp, back.source) == (0.01, 1.0, "made up")
        for a, b in zip(seen.objects, back.objects, strict=True):
            np.testing.assert_allclose(a.world_T_object, b.world_T_object, atol=1e-8)
            assert (a.name, a.shape, a.yaw_std) == (b.name, b.shape, b.yaw_std)
            np.testing.assert_array_equal(a.extents, b.extents)


def test_a_look_of_a_run_is_chosen_by_its_number(tmp_path):
    for k in (1, 2):
        seen = scene(estimate("crate", (0.5, 0.1 * k, 0.03), (0.11, 0.11, 0.06)))
        PerceptionResult(source="s", frames=(LookRecord.of(seen, "static"),)).write(tmp_path / f"objects_00{k}.json")
    for frame, y in ((0, 0.1), (1, 0.2), (-1, 0.2)):
        assert scene_for(load_cell("cubes"), tmp_path, frame).objects[0].position[1] == pytest.approx(y)
    with pytest.raises(FrameError, match=r"no look 2; .* has 2 looks, counted from 0"):
        scene_for(load_cell("cubes"), tmp_path, 2)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"world_T_object": [[2, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}, r"objects\.0.*not a pose"),
        ({"extents": [0.1, 0.1, -0.1]}, r"extents.*metres and above 0"),
        ({"color": "red"}, r"objects\.0\.color"),
        ({"colour": "reddish"}, r"objects\.0\.colour.*'reddish' is no colour word; it must be null or one of red, "),
    ],
)
def test_a_perception_result_that_is_not_valid_names_file_and_place(file, change, reason):
    seen = scene(estimate("crate", (0.5, 0.1, 0.03), (0.11, 0.11, 0.06)))
    content = PerceptionResult(source="s", frames=(LookRecord.of(seen, "static"),)).model_dump(mode="json")
    content["frames"][0]["objects"][0].update(change)
    path = file(json.dumps(content), "objects.json")
    with pytest.raises(FrameError, match=reason) as caught:
        scene_for(load_cell("cubes"), path)
    assert str(path) in str(caught.value)


def test_a_missing_or_empty_source_says_what_is_expected(tmp_path):
    with pytest.raises(ConfigError, match=r"there is no scene file .*nowhere.*YAML"):
        scene_for(load_cell("cubes"), tmp_path / "nowhere.yaml")
    with pytest.raises(ConfigError, match=r"neither objects.json nor objects_\*\.json is in this folder"):
        scene_for(load_cell("cubes"), tmp_path)
