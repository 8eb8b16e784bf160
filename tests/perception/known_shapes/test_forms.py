"""Things whose form is known up to their sizes, from the depth of all cameras together."""

import numpy as np
import pytest

from perception.frames import RgbdFrame
from perception.known_shapes.forms import FormSolid
from perception.pipeline import perception_from_options
from sim_check.cells.loading import load_cell
from sim_check.furniture.known_models import known_models
from sim_check.models.known_forms import known_forms
from sim_check.world.world import build_world


@pytest.fixture(scope="module")
def kitchen():
    """A kitchen's true world (closed by now) and a frame of each of its cameras."""
    world = build_world(load_cell("kitchen-explore"), 1)
    frames = []
    for camera in world.cameras:
        colour, depth, pose, lens = world.render(camera.name)
        frames.append(RgbdFrame(colour, depth, lens, pose, 1.0, camera.name))
    world.close()
    return world, frames


@pytest.fixture(scope="module")
def perception():
    return perception_from_options(known=known_models(load_cell("kitchen-explore").furniture), forms=known_forms())


def test_a_kettle_before_a_microwave_comes_within_millimetres_with_its_spout_to_the_front(kitchen, perception):
    world, frames = kitchen
    (kettle,) = perception.perceive(frames, ["kettle"]).objects
    true = world.object_pose("kettle")
    assert kettle.position == pytest.approx(true[:3, 3], abs=0.006)
    assert kettle.extents == pytest.approx(world.objects["kettle"].extents, abs=0.008)
    turn = kettle.yaw - np.arctan2(true[1, 0], true[0, 0])
    assert abs(np.degrees(np.angle(np.exp(1j * turn)))) < 5
    assert np.abs(kettle.position - true[:3, 3]).max() < 3 * kettle.position_std.max()
    assert kettle.colour == "blue"
    assert {e.camera for e in kettle.evidence} == {"static", "right", "wrist"}


def test_a_kettle_of_another_colour_is_not_the_one_that_was_asked_for(kitchen, perception):
    _, frames = kitchen
    scene = perception.perceive(frames, ["blue_kettle", "red_kettle"])
    assert scene.names == ("blue_kettle",)


def test_without_a_kettle_none_is_made_of_cabinet_arm_or_cube():
    cell = load_cell("cabinet-closed")
    world = build_world(cell, 0)
    frames = []
    for camera in world.cameras:
        colour, depth, pose, lens = world.render(camera.name)
        frames.append(RgbdFrame(colour, depth, lens, pose, 1.0, camera.name))
    world.close()
    looks = perception_from_options("colour", known=known_models(cell.furniture), forms=known_forms())
    assert looks.perceive(frames, ["blue_kettle"]).names == ()


@pytest.mark.parametrize(
    ("kind", "half", "inside", "beside"),
    [
        ("box", (0.1, 0.2, 0.3), (0.05, 0.0, 0.0), (0.13, 0.24, 0.0)),
        ("cylinder", (0.1, 0.1, 0.3), (0.05, 0.0, 0.0), (0.0, 0.13, 0.34)),
        ("capsule", (0.1, 0.1, 0.3), (0.05, 0.0, 0.3), (0.03, 0.0, 0.44)),
        ("ellipsoid", (0.1, 0.1, 0.1), (0.05, 0.0, 0.0), (0.0, 0.09, 0.12)),
    ],
)
def test_the_distance_to_a_solid_is_negative_inside_and_straight_outside(kind, half, inside, beside):
    turned = np.array([[0.0, 0.0, 1.0, 0.5], [0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    solid = FormSolid(kind, np.array(half), turned)
    points = np.array([inside, beside]) @ turned[:3, :3].T + turned[:3, 3]
    outside = {"box": 0.05, "cylinder": 0.05, "capsule": np.hypot(0.03, 0.14) - 0.1, "ellipsoid": 0.05}[kind]
    assert solid.distance(points) == pytest.approx([-0.05, outside], abs=1e-6)


def test_a_kettle_that_a_camera_sees_from_far_only_is_still_stood_on_the_table(kitchen, perception):
    world, frames = kitchen
    far = [frame for frame in frames if frame.camera != "wrist"]
    (kettle,) = perception.perceive(far, ["kettle"]).objects
    assert kettle.position[2] - kettle.extents[2] / 2 == pytest.approx(0.0, abs=0.005)
    assert kettle.position == pytest.approx(world.object_pose("kettle")[:3, 3], abs=0.012)
