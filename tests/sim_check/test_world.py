"""The simulated cell's truth: seeded, free of overlaps, at rest."""

import mujoco
import numpy as np
import pytest

from control.errors import ConfigError
from control.robot.limits import REST_Q
from control.twin_model import ARM_JOINTS, FINGER_JOINTS
from sim_check.cells.loading import load_cell
from sim_check.objects.bowl import bowl_profile
from sim_check.objects.library import known_nouns, noun_of, object_model
from sim_check.world.world import build_world

CELLS = [("cubes", None), ("cubes-blocked", None), ("fruit-bowl", None), ("fruit-bowl", {"lemon_in_bowl": True})]


def poses(world):
    return {name: world.object_pose(name) for name in world.object_names}


def test_the_same_seed_gives_the_same_world_and_another_seed_another_one():
    cell = load_cell("cubes")
    first, again, other = (build_world(cell, seed, meshes=False) for seed in (3, 3, 4))
    for name in first.object_names:
        assert np.array_equal(first.object_pose(name), again.object_pose(name))
        assert np.linalg.norm(first.object_pose(name)[:2, 3] - other.object_pose(name)[:2, 3]) > 0.005
    assert np.array_equal(first.model.body_mass, again.model.body_mass)
    assert not np.array_equal(first.model.body_mass, other.model.body_mass)


@pytest.mark.parametrize(("name", "options"), CELLS)
def test_nothing_moves_for_a_second_in_a_built_world(name, options):
    world = build_world(load_cell(name, options), seed=1, meshes=False)
    before = poses(world)
    for _ in range(1000):
        mujoco.mj_step(world.model, world.data)
    for thing, pose in poses(world).items():
        # A tenth of a millimetre is what soft contacts creep; a fruit that rolls goes much further.
        assert np.linalg.norm(pose[:3, 3] - before[thing][:3, 3]) < 1e-4, thing
    for joint, angle in zip(ARM_JOINTS, REST_Q, strict=True):
        assert world.data.joint(joint).qpos[0] == pytest.approx(angle, abs=1e-3)
    for joint in FINGER_JOINTS:
        assert world.data.joint(joint).qpos[0] == pytest.approx(0.04, abs=1e-3)


@pytest.mark.parametrize(("name", "options"), CELLS)
def test_over_thirty_seeds_nothing_overlaps_or_leaves_the_work_area(name, options):
    cell = load_cell(name, options)
    for seed in range(30):
        world = build_world(cell, seed, meshes=False)
        depths = [-c.dist for c in world.data.contact[: world.data.ncon]]
        assert max(depths) < 1e-3, seed
        for pose in poses(world).values():
            assert 0.3 < pose[0, 3] < 0.65, seed
            assert abs(pose[1, 3]) < 0.32, seed


def test_things_on_the_table_leave_room_for_the_fingers_between_them():
    cell = load_cell("cubes")
    assert cell.simulation is not None
    for seed in range(30):
        world = build_world(cell, seed, meshes=False)
        names = world.object_names
        for i, a in enumerate(names):
            for b in names[:i]:
                apart = np.linalg.norm(world.object_pose(a)[:2, 3] - world.object_pose(b)[:2, 3])
                radii = world.objects[a].footprint_radius + world.objects[b].footprint_radius
                assert apart > radii + cell.simulation.gap - 1e-3, (seed, a, b)


def test_the_yellow_cube_blocks_the_crate_in_cubes_blocked():
    world = build_world(load_cell("cubes-blocked"), seed=5, meshes=False)
    crate, cube = world.object_pose("crate"), world.object_pose("yellow_cube")
    assert cube[2, 3] == pytest.approx(0.06 + 0.025, abs=1e-3)
    assert np.all(np.abs(cube[:2, 3] - crate[:2, 3]) < 0.03)


def test_an_option_puts_the_lemon_into_the_bowl_and_it_stays_inside():
    assert "lemon" not in build_world(load_cell("fruit-bowl"), 0, meshes=False).object_names
    world = build_world(load_cell("fruit-bowl", {"lemon_in_bowl": True}), 0, meshes=False)
    away = world.object_pose("lemon")[:2, 3] - world.object_pose("bowl")[:2, 3]
    assert np.linalg.norm(away) < world.objects["bowl"].inner_radius - 0.025


def test_masses_and_friction_differ_from_the_library_by_no_more_than_the_mismatch():
    factors = []
    for seed in range(10):
        world = build_world(load_cell("cubes"), seed, meshes=False)
        factors.append(world.objects["red_cube"].mass / object_model("red_cube").mass)
        body = world.model.body("red_cube").id
        assert world.model.body_mass[body] == pytest.approx(world.objects["red_cube"].mass)
    assert max(factors) <= 1.1
    assert min(factors) >= 0.9
    assert max(factors) - min(factors) > 0.05


def test_a_cell_without_a_simulation_block_cannot_be_simulated():
    cell = load_cell("cubes").model_copy(update={"simulation": None})
    with pytest.raises(ConfigError, match="cell 'cubes' has no simulation block"):
        build_world(cell, 0)


def test_a_cell_that_is_too_full_says_so():
    cell = load_cell("cubes")
    assert cell.simulation is not None
    crowded = cell.simulation.model_copy(update={"gap": 1.0})
    with pytest.raises(ConfigError, match=r"do not fit with a gap of 1\.0 m"):
        build_world(cell.model_copy(update={"simulation": crowded}), 0, meshes=False)


def test_an_object_that_is_not_there_is_answered_with_those_that_are():
    world = build_world(load_cell("cubes"), 0, meshes=False)
    with pytest.raises(ConfigError, match=r"no object 'apple'; it has \['crate', 'red_cube', 'yellow_cube'\]"):
        world.object_pose("apple")


def test_the_library_reads_nouns_and_colours_out_of_names():
    assert noun_of("red_cube") == "cube"
    assert noun_of("gizmo") is None
    assert object_model("blue_cube").rgb != object_model("red_cube").rgb
    assert object_model("orange").rgb == object_model("orange_cube").rgb
    for noun in known_nouns():
        thing = object_model(noun)
        assert 0.01 < thing.mass < 2.0
        assert thing.container == (noun == "bowl")


def test_an_unknown_noun_needs_a_shape_and_gets_a_stated_density():
    with pytest.raises(ConfigError, match="no noun for 'gizmo'; it has apple, ball"):
        object_model("gizmo")
    thing = object_model("gizmo", np.array([0.1, 0.1, 0.1]), "box")
    assert thing.mass == pytest.approx(400.0 * 0.001)
    with pytest.raises(ConfigError, match="sizes of 'red_cube'"):
        object_model("red_cube", np.array([0.05, 0.0, 0.05]))


def test_a_bowl_fills_its_box_and_leaves_room_for_an_apple():
    bowl, apple = object_model("bowl"), object_model("apple")
    profile = bowl_profile(bowl.extents)
    assert profile[:, 0].max() == pytest.approx(bowl.extents[0] / 2, abs=1e-6)
    assert profile[:, 1].max() == pytest.approx(bowl.extents[2], abs=1e-4)
    assert profile[:, 1].min() >= 0.0
    assert bowl.inner_radius > apple.extents[0] / 2 + 0.02
    assert 0.0 < bowl.inner_floor < 0.2 * bowl.extents[2]
