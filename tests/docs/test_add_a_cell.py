"""docs/how-to/add-a-cell.md: its cell file loads, and its simulated cell holds and shows what it says."""

import pytest

from control.errors import ConfigError
from perception.frames import RgbdFrame
from perception.pipeline import default_perception
from sim_check.cells.loading import load_cell
from sim_check.world.world import build_world
from tests.support.documents import ROOT, blocks

(CELL,) = blocks(ROOT / "docs" / "how-to" / "add-a-cell.md", "yaml")


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "my-bench.yaml"
    path.write_text(CELL)
    return path


def test_it_is_read_as_it_says(path):
    cell = load_cell(path)
    assert (cell.name, cell.objects) == ("my-bench", ("red_cube", "crate"))
    assert cell.safety_limits().hand_speed == 0.3
    assert [c.name for c in cell.cameras] == ["tripod"]


def test_its_camera_sees_what_stands_there(path):
    world = build_world(load_cell(path), seed=1)
    colour, depth, pose, lens = world.render("tripod")
    frame = RgbdFrame(colour, depth, lens, pose, 0.0, "tripod")
    scene = default_perception().perceive([frame], ["red_cube", "crate"])
    truth = world.truth().poses
    for name in ("red_cube", "crate"):
        seen = scene.get(name)
        assert seen is not None, scene.unseen
        assert seen.position == pytest.approx(truth[name][:3, 3], abs=0.01)


def test_a_wrong_key_is_refused_by_name(path):
    path.write_text(CELL.replace("look_at:", "looks_at:"))
    with pytest.raises(ConfigError, match="looks_at"):
        load_cell(path)
