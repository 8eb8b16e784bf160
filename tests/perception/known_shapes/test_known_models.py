"""Furniture of known shape: where it stands and how far its doors are open, from depth alone."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from perception.estimates import ObjectEstimate, SceneEstimate
from perception.geometry.cloud import to_world
from perception.geometry.depth_rays import DepthRays
from perception.geometry.prepared_frame import PreparedFrame
from perception.known_shapes.articulated_fit import KnownFit, fit_known
from perception.known_shapes.fit_settings import KnownSettings
from perception.known_shapes.models import KnownBox, KnownModel, KnownPart
from perception.known_shapes.ray_casting import cast
from perception.pipeline import Perception, default_perception
from perception.scene_file import LookRecord
from planning.language.relations import find_relations
from sim_check.cells.loading import load_cell
from sim_check.furniture.known_models import known_models
from sim_check.furniture.mjcf import set_fractions
from sim_check.world.world import build_world

LEFT, RIGHT = "wooden_cabinet_left_door", "wooden_cabinet_right_door"


def frames_of(world, *cameras):
    taken = []
    for camera in cameras:
        colour, depth, pose, lens = world.render(camera)
        taken.append(PreparedFrame(colour, depth, lens, pose, 1.0, camera))
    return taken


def looked_at(cell_name, fractions, *cameras, seed=3, colour=None):
    """True world (closed by now) and frames of a cell whose doors stand at these fractions."""
    world = build_world(load_cell(cell_name), seed)
    for thing in world.furniture.values():
        set_fractions(world.model, world.data.qpos, thing, fractions)
    mujoco.mj_forward(world.model, world.data)
    frames = frames_of(world, *cameras)
    world.close()
    return world, frames


def fitted(cell_name, frames) -> dict[str, KnownFit]:
    models = known_models(load_cell(cell_name).furniture)
    fits = fit_known(frames, list(models.values()), frames[0].support)
    assert all(isinstance(f, KnownFit) for f in fits.values()), fits
    return {name: f for name, f in fits.items() if isinstance(f, KnownFit)}


def yaw_of(pose: np.ndarray) -> float:
    return float(np.arctan2(pose[1, 0], pose[0, 0]))


def off(fit: KnownFit, world) -> tuple[float, float]:
    """Distance on the table in [m] and turn in [rad] between a fit and the truth."""
    turn = np.linalg.inv(world.object_pose(fit.model.name)) @ fit.world_T_model
    return float(np.hypot(*turn[:2, 3])), float(abs(np.arctan2(turn[1, 0], turn[0, 0])))


# One static camera at 0.9 to 1.2 m with a small stereo camera's noise; usual errors are 1 mm and 0.5 degrees.
@pytest.mark.parametrize("left, right", [(0.0, 0.0), (0.5, 0.0), (0.3, 0.9)])
def test_a_cabinet_and_its_doors_are_found_by_one_camera(left, right):
    world, frames = looked_at("cabinet-closed", {LEFT: left, RIGHT: right}, "static")
    fit = fitted("cabinet-closed", frames)["wooden_cabinet"]
    distance, turn = off(fit, world)
    assert distance < 0.005 and turn < np.radians(1.5)
    opened = fit.model.parts[0].opened
    assert np.degrees(np.abs(fit.fractions - [left, right]) * opened).max() < 3


def test_a_front_is_not_taken_for_a_back():
    world, frames = looked_at("kitchen-explore", {"microwave_door": 0.0}, "static", "right", seed=4)
    assert off(fitted("kitchen-explore", frames)["microwave"], world)[1] < np.radians(2)


def test_furniture_of_one_cell_is_told_apart_by_its_sizes_and_a_flat_plate_is_found_among_it():
    world, frames = looked_at("composite-explore", {"stone_cabinet_door": 0.4}, "static", "right", "wrist", seed=1)
    fits = fitted("composite-explore", frames)
    for name in ("stone_cabinet", "wooden_cabinet", "weight_sensor"):
        assert off(fits[name], world)[0] < 0.005, name
    assert fits["stone_cabinet"].fractions == pytest.approx([0.4], abs=0.02)


def test_what_no_camera_shows_of_a_joint_is_in_its_spread():
    _, frames = looked_at("cabinet-closed", {LEFT: 0.4, RIGHT: 0.0}, "static")
    fit = fitted("cabinet-closed", frames)["wooden_cabinet"]
    assert fit.fraction_std.max() < 0.03
    # The same picture without what lies before the left half of the front, where the left door is.
    frame = frames[0]
    depth = np.array(frame.depth)
    everywhere = frame.valid_depth
    points = to_world(frame.points(everywhere), np.linalg.inv(fit.world_T_model))
    depth[everywhere] = np.where((points[:, 0] < -0.14) & (points[:, 1] > -0.01), np.nan, depth[everywhere])
    half = fitted("cabinet-closed", [replace(frame, depth=depth)])["wooden_cabinet"]
    assert half.fraction_std[0] > 0.2 > half.fraction_std[1]


def test_on_a_table_without_furniture_nothing_is_found():
    world = build_world(load_cell("cubes"), 0)
    frames = frames_of(world, "static")
    world.close()
    models = known_models(load_cell("cabinet-closed").furniture)
    (said,) = fit_known(frames, list(models.values()), frames[0].support).values()
    assert said == "nothing stands on the support that could be it"


def test_a_place_that_too_few_depths_speak_for_is_refused_with_their_number():
    _, frames = looked_at("cabinet-closed", {}, "static")
    models = known_models(load_cell("cabinet-closed").furniture)
    strict = KnownSettings(least_rays=1_000_000)
    (said,) = fit_known(frames, list(models.values()), frames[0].support, strict).values()
    assert isinstance(said, str)
    assert said.startswith("nothing in view has its shape (the likeliest place agrees with ")
    assert said.endswith("% of those that would see it; 1000000 and 90% are needed)")


@pytest.fixture(scope="module")
def kitchen() -> tuple[SceneEstimate, object]:
    cell = load_cell("kitchen-explore")
    world, frames = looked_at("kitchen-explore", {"microwave_door": 0.9}, "static", "right")
    embedded = default_perception()
    eyes = Perception(embedded.detector, embedded.segmenter, known=known_models(cell.furniture))
    return eyes.perceive(frames, ["microwave", "wooden_cabinet", "green_apple"]), world


def seen(scene: SceneEstimate, name: str) -> ObjectEstimate:
    found = scene.get(name)
    assert found is not None, scene.unseen
    return found


def test_the_pipeline_gives_known_things_with_joints_without_asking_the_detector(kitchen):
    scene, world = kitchen
    microwave = seen(scene, "microwave")  # a word that the colour detector does not know
    assert microwave.joint_fractions["microwave_door"] == pytest.approx(0.9, abs=0.03)
    assert microwave.joint_stds["microwave_door"] < 0.03
    assert microwave.position == pytest.approx(world.object_pose("microwave")[:3, 3], abs=0.006)
    assert {e.camera for e in microwave.evidence} == {"static", "right"}
    assert microwave.evidence[0].mask.sum() > 3000


def test_an_apple_in_an_open_microwave_rests_on_its_floor_and_is_in_it(kitchen):
    scene, world = kitchen
    apple = seen(scene, "green_apple")
    assert apple.position == pytest.approx(world.object_pose("green_apple")[:3, 3], abs=0.008)
    assert "green_apple is in microwave" in [str(r) for r in find_relations(scene)]


def test_furniture_seen_before_is_found_there_and_elsewhere_if_it_moved():
    models = list(known_models(load_cell("cabinet-locked").furniture).values())
    world, frames = looked_at("cabinet-locked", {"lever_rod": 0.6, "wooden_cabinet_door": 0.3}, "static", "wrist")
    table = frames[0].support
    stood = {n: np.array([*world.object_pose(n)[:2, 3], yaw_of(world.object_pose(n)), 0.0]) for n in world.furniture}
    elsewhere = {"wooden_cabinet": stood["wooden_cabinet"] + [0.1, 0.05, 0.3, 0.0], "lever": stood["lever"] - 0.1}
    for before in (stood, elsewhere):
        fits = fit_known(frames, models, table, before=before)
        for name, fraction in (("lever", 0.6), ("wooden_cabinet", 0.3)):
            fit = fits[name]
            assert isinstance(fit, KnownFit), fit
            assert off(fit, world)[0] < 0.003
            assert fit.fractions == pytest.approx([fraction], abs=0.02)


def test_a_scene_seen_before_says_where_furniture_is_looked_for_first(kitchen, monkeypatch):
    scene, _ = kitchen
    asked = {}
    monkeypatch.setattr(
        "perception.stages.known_shapes_first.fit_known",
        lambda *given: asked.update(given[4]) or {"microwave": "not looked for"},
    )
    frames = looked_at("kitchen-explore", {}, "static", seed=4)[1]
    models = known_models(load_cell("kitchen-explore").furniture)
    embedded = default_perception()
    eyes = Perception(embedded.detector, embedded.segmenter, known=models)
    eyes.perceive(frames, ["microwave"], before=scene)
    microwave = seen(scene, "microwave")
    fraction = microwave.joint_fractions["microwave_door"]
    assert asked["microwave"] == pytest.approx([*microwave.position[:2], microwave.yaw, fraction])


def test_joints_and_their_spreads_pass_through_a_scene_file(kitchen):
    scene, _ = kitchen
    record = LookRecord.model_validate_json(LookRecord.of(scene, "static").model_dump_json())
    read, wrote = seen(record.scene("file"), "microwave"), seen(scene, "microwave")
    assert dict(read.joint_fractions) == pytest.approx(dict(wrote.joint_fractions))
    assert dict(read.joint_stds) == pytest.approx(dict(wrote.joint_stds))


def test_a_ray_meets_the_nearest_face_of_a_box():
    box = KnownBox(np.array([1.0, -1.0, -1.0]), np.array([2.0, 1.0, 1.0]))
    direction = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    n = len(direction)
    rays = DepthRays(np.zeros((n, 3)), direction, np.ones(n), np.ones(n), np.zeros(n, int), np.zeros((n, 2), int))
    hits = cast(rays, np.eye(4), [box])
    assert hits.distance.tolist() == [1.0, np.inf, np.inf]
    assert hits.normal[0].tolist() == [-1.0, 0.0, 0.0]


def test_a_ray_past_the_corner_of_a_round_bar_s_box_passes_the_bar():
    # Along z from -0.3 to 0.3 with radius 0.1, before a wall at x = 2; rays start at x = 0 and run along x.
    bar = KnownBox(np.array([0.9, -0.1, -0.3]), np.array([1.1, 0.1, 0.3]), rounded=True)
    wall = KnownBox(np.array([2.0, -1.0, -1.0]), np.array([2.1, 1.0, 1.0]))
    yz = np.array([[0.0, 0.0], [0.06, 0.1], [0.0, 0.26], [0.08, 0.27], [0.0, 0.31]])
    n = len(yz)
    origin, direction = np.c_[np.zeros(n), yz], np.tile([1.0, 0.0, 0.0], (n, 1))
    rays = DepthRays(origin, direction, np.ones(n), np.ones(n), np.zeros(n, int), np.zeros((n, 2), int))
    hits = cast(rays, np.eye(4), [wall, bar])
    # The fourth goes through the box's corner: 0.08 and 0.07 from the upper ball's centre are more than 0.1.
    assert hits.distance == pytest.approx([0.9, 0.92, 0.92, 2.0, 2.0])
    wanted = [[-1.0, 0.0, 0.0], [-0.8, 0.6, 0.0], [-0.8, 0.0, 0.6], [-1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]
    assert hits.normal == pytest.approx(np.array(wanted))


def test_a_ray_along_a_round_bar_meets_its_end():
    bar = KnownBox(np.array([-0.3, -0.1, -0.1]), np.array([0.3, 0.1, 0.1]), rounded=True)
    origin, direction = np.array([[1.0, 0.06, 0.0], [1.0, 0.2, 0.0]]), np.tile([-1.0, 0.0, 0.0], (2, 1))
    rays = DepthRays(origin, direction, np.ones(2), np.ones(2), np.zeros(2, int), np.zeros((2, 2), int))
    assert cast(rays, np.eye(4), [bar]).distance == pytest.approx([1.0 - 0.28, np.inf])


@pytest.mark.parametrize("pulled", [0.5, 1.0])
def test_a_lever_and_how_far_it_is_pulled_are_found(pulled):
    world, frames = looked_at("cabinet-locked", {"lever_rod": pulled}, "static", "wrist", seed=0)
    lever = fitted("cabinet-locked", frames)["lever"]
    distance, turn = off(lever, world)
    assert distance < 0.003 and turn < np.radians(2.0)
    assert lever.fractions == pytest.approx([pulled], abs=0.02)
    assert lever.agreeing > 0.97


def test_a_part_turns_about_its_anchor_and_slides_along_its_axis():
    board = (KnownBox(np.zeros(3), np.ones(3)),)
    hinge = KnownPart("door", "hinge", np.array([1.0, 2.0, 0.0]), np.array([0.0, 0.0, 1.0]), np.pi, board)
    slide = KnownPart("tray", "slide", np.array([1.0, 2.0, 0.0]), np.array([0.0, 1.0, 0.0]), 0.4, board)
    assert hinge.model_T_part(0.5) @ [1.0, 0.0, 0.0, 1.0] == pytest.approx([1.0, 3.0, 0.0, 1.0])
    assert slide.model_T_part(0.5) @ [1.0, 0.0, 0.0, 1.0] == pytest.approx([2.0, 2.2, 0.0, 1.0])
    model = KnownModel("shelf", np.ones(3), board, (slide,))
    assert model.standing(0.0, 0.0, 0.0, 0.2)[2, 3] == pytest.approx(0.7)
