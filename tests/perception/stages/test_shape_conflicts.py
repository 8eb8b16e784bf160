"""A slice of a ball in one camera is no cube where another camera sees the ball."""

import mujoco
import pytest

from perception.detection.colour_shape import ColourShapeDetector
from perception.frames import RgbdFrame
from perception.pipeline import Perception, perception_from_options
from sim_check.cells.loading import load_cell
from sim_check.furniture.mjcf import set_fractions
from sim_check.world.world import build_world


@pytest.fixture(scope="module")
def frames() -> list[RgbdFrame]:
    """An apple in the open microwave: the shell hides most of it from one side, the wrist's picture cuts it."""
    cell = load_cell("kitchen-explore")
    # From further back than the cell's own camera, whose picture shows too little of the apple to mistake it.
    static = cell.cameras[0].model_copy(update={"position": (0.1, 0.85, 1.1)})
    world = build_world(cell.model_copy(update={"cameras": (static, *cell.cameras[1:])}), 2)
    set_fractions(world.model, world.data.qpos, world.furniture["microwave"], {"microwave_door": 0.95})
    mujoco.mj_forward(world.model, world.data)
    taken = []
    for camera in world.cameras:
        colour, depth, pose, lens = world.render(camera.name)
        taken.append(RgbdFrame(colour, depth, lens, pose, 1.0, camera.name))
    world.close()
    return taken


def test_an_apple_of_which_one_camera_sees_a_slice_is_no_cube(frames):
    looker = perception_from_options("colour")
    alone = [frame for frame in frames if frame.camera == "static"]
    assert looker.perceive(alone, ["green_cube"]).names == ("green_cube",)  # nothing speaks against it
    scene = looker.perceive(frames, ["green_apple", "green_cube"])
    assert scene.names == ("green_apple",)
    assert scene.unseen[0].reason == (
        "what 'static' took for it is rather a green ball in the larger picture of 'right' and 'wrist'"
    )


def test_where_a_phrase_may_be_several_things_no_shape_is_held_against_it(frames):
    one = perception_from_options("colour")
    several = Perception(one.detector, one.segmenter, instances=2)
    assert "green_cube" in several.perceive(frames, ["green_cube"]).names


@pytest.mark.parametrize(
    "phrase, other",
    [
        ("green cube", "green ball"),
        ("red apple", "red block"),
        ("cube", None),
        ("blue bowl", None),
        ("red bar", None),
        ("grey can", None),
    ],
)
def test_the_other_shape_of_a_phrase_is_told_where_it_names_one_colour_and_a_shape(phrase, other):
    assert ColourShapeDetector().other_shape(phrase) == other
