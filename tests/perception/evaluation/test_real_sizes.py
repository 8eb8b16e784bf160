"""Sizes of real things from a real depth camera: boxes drawn by hand, masks and solids by the embedded parts."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from perception.interfaces import Detection
from perception.pipeline import Perception, default_perception
from perception.recordings.opening import open_recording

FOLDER = Path(__file__).parents[4] / "shared" / "data" / "real_rgbd"
THINGS = yaml.safe_load((Path(__file__).parents[2] / "data" / "real_boxes.yaml").read_text())
LENS = "{width: 640, height: 480, fx: 1066.778, fy: 1067.487, cx: 312.9869, cy: 241.3109, depth_scale: 0.0001}"

pytestmark = pytest.mark.skipif(not FOLDER.is_dir(), reason=f"no recorded real frames in {FOLDER}")


class BoxesByHand:
    """A detector for a picture in which somebody has drawn boxes."""

    name = "boxes by hand"

    def detect(self, frame, phrases):
        return [Detection(t["phrase"], np.array(t["box"], float), 1.0) for t in THINGS if t["phrase"] in phrases]


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    lens = tmp_path_factory.mktemp("lens") / "lens.yaml"
    lens.write_text(LENS)
    frame = next(iter(open_recording(FOLDER / "posecnn_demo", intrinsics=lens)))
    looker = Perception(BoxesByHand(), default_perception().segmenter)
    return looker.perceive([frame], [t["phrase"].replace(" ", "_") for t in THINGS])


@pytest.mark.parametrize("thing", THINGS, ids=[t["phrase"].replace(" ", "_") for t in THINGS])
def test_sizes_of_a_box_a_standing_can_and_a_lying_can_come_within_a_centimetre(scene, thing):
    found = scene.get(thing["phrase"].replace(" ", "_"))
    assert found is not None, scene.unseen
    assert np.sort(found.extents) == pytest.approx(thing["sizes"], abs=0.010)


def test_a_lying_can_has_a_direction_and_a_standing_one_has_none(scene):
    assert scene.get("soup_can").yaw_std < np.radians(10)
    assert np.isinf(scene.get("coffee_can").yaw_std)
