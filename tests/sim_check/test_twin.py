"""The twin stands on its own feet: built from estimates, it holds still, or says what cannot be."""

import mujoco
import numpy as np
import pytest

from benchmarks.scenes.estimates import estimate, exact_scene, scene
from control.errors import ConfigError, StackError
from control.robot.limits import REST_Q
from control.twin_model import TCP_SITE
from perception.estimates import ObjectEstimate
from sim_check.cells.loading import load_cell
from sim_check.twin.twin import TWIN_STEP, build_twin, perturbed_twin, worlds_to_try
from sim_check.world.world import build_world

CELL = load_cell("cubes")
CUBE, CRATE, BOWL, APPLE = (0.05,) * 3, (0.11, 0.11, 0.06), (0.144, 0.144, 0.053), (0.07,) * 3
OPEN = 0.08


def twin_of(*objects: ObjectEstimate, table: float = 0.0, **kwargs):
    return build_twin(CELL, scene(*objects, table=table), np.array(REST_Q), OPEN, **kwargs)


def positions(twin):
    data = twin.start()
    return {o.name: data.body(o.name).xpos.copy() for o in twin.objects}


def drift(twin, seconds=0.5):
    """Furthest that any object moves when the twin runs, in [m]."""
    data, before = twin.start(), positions(twin)
    for _ in range(round(seconds / twin.model.opt.timestep)):
        mujoco.mj_step(twin.model, data)
    return max(np.linalg.norm(data.body(n).xpos - p) for n, p in before.items())


@pytest.mark.parametrize(
    ("name", "options"),
    [("cubes", None), ("cubes-blocked", None), ("fruit-bowl", None), ("fruit-bowl", {"lemon_in_bowl": True})],
)
def test_a_twin_of_exact_estimates_holds_still_where_things_truly_are(name, options):
    cell = load_cell(name, options)
    for seed in range(3):
        world = build_world(cell, seed, meshes=False)
        twin = build_twin(cell, exact_scene(world), np.array(REST_Q), OPEN)
        assert twin.model.opt.timestep == TWIN_STEP
        for thing, position in positions(twin).items():
            assert np.linalg.norm(position - world.object_pose(thing)[:3, 3]) < 1e-3, (seed, thing)
        assert drift(twin) < 2e-3, seed


def test_estimates_that_are_off_by_millimetres_still_make_a_twin_at_rest():
    cell = load_cell("cubes-blocked")
    rng = np.random.default_rng(0)
    world = build_world(cell, 2, meshes=False)
    for _ in range(20):
        exact = exact_scene(world)
        noisy = [
            estimate(o.name, o.position + rng.normal(0, 0.004, 3), o.extents + rng.normal(0, 0.003, 3), o.shape, o.yaw)
            for o in exact.objects
        ]
        twin = twin_of(*noisy)
        assert drift(twin) < 2e-3
        at = positions(twin)
        crate, cube = twin.get("crate"), twin.get("yellow_cube")
        assert crate is not None
        assert cube is not None
        # The cube stands on the crate, whatever its bottom was taken to be.
        gap = (at["yellow_cube"][2] - cube.extents[2] / 2) - (at["crate"][2] + crate.extents[2] / 2)
        assert abs(gap) < 1e-3


def test_the_same_estimates_give_the_same_twin():
    objects = (estimate("crate", (0.5, 0.0, 0.03), CRATE), estimate("red_cube", (0.5, 0.1, 0.024), CUBE, yaw=0.4))
    assert np.array_equal(twin_of(*objects).qpos, twin_of(*objects).qpos)


def test_the_arm_starts_exactly_where_it_was_asked_to():
    twin = twin_of(estimate("red_cube", (0.5, 0.0, 0.025), CUBE))
    data = twin.start()
    assert np.array_equal(data.qpos[:7], REST_Q)
    assert np.array_equal(data.qpos[7:9], [0.04, 0.04])


def test_a_bottom_that_was_seen_too_low_ends_at_the_support_and_the_top_stays():
    twin = twin_of(
        estimate("crate", (0.5, 0.0, 0.03), CRATE), estimate("red_cube", (0.5, 0.01, 0.055), (0.05, 0.05, 0.11))
    )
    cube = twin.get("red_cube")
    assert cube is not None
    assert cube.extents[2] == pytest.approx(0.05, abs=5e-4)
    assert positions(twin)["red_cube"][2] == pytest.approx(0.085, abs=1e-3)


def test_a_thing_below_the_table_is_set_on_it():
    twin = twin_of(estimate("red_cube", (0.5, 0.0, -0.02), CUBE))
    assert positions(twin)["red_cube"][2] == pytest.approx(0.025, abs=1e-3)


def test_the_table_is_where_it_was_perceived():
    twin = twin_of(estimate("red_cube", (0.5, 0.0, 0.035), CUBE), table=0.01)
    assert twin.support_height == 0.01
    assert positions(twin)["red_cube"][2] == pytest.approx(0.035, abs=1e-3)


def test_neighbours_that_overlap_a_little_are_moved_apart():
    twin = twin_of(estimate("red_cube", (0.5, 0.0, 0.025), CUBE), estimate("yellow_cube", (0.54, 0.002, 0.025), CUBE))
    at = positions(twin)
    assert at["yellow_cube"][0] - at["red_cube"][0] == pytest.approx(0.05, abs=1e-3)
    assert drift(twin) < 2e-3


def test_an_apple_perceived_over_the_bowls_wall_comes_to_rest_inside():
    twin = twin_of(
        estimate("bowl", (0.5, 0.0, 0.0265), BOWL, "cylinder"), estimate("apple", (0.5, 0.055, 0.05), APPLE, "sphere")
    )
    at, bowl = positions(twin), twin.get("bowl")
    assert bowl is not None
    assert bowl.container
    assert np.linalg.norm(at["apple"][:2] - at["bowl"][:2]) < bowl.inner_radius - 0.035
    assert drift(twin) < 2e-3


def test_an_unknown_noun_becomes_the_solid_that_was_perceived():
    twin = twin_of(estimate("gizmo", (0.5, 0.0, 0.04), (0.05, 0.05, 0.08), "cylinder"))
    geom = twin.model.geom("gizmo_0")
    assert geom.type[0] == mujoco.mjtGeom.mjGEOM_CYLINDER
    assert drift(twin) < 2e-3


def test_two_things_in_one_place_are_refused_by_name():
    with pytest.raises(StackError, match=r"'\w+_cube' cannot be where it was perceived.*against .*_cube'"):
        twin_of(estimate("red_cube", (0.5, 0.0, 0.025), CUBE), estimate("yellow_cube", (0.5, 0.001, 0.025), CUBE))


def test_a_thing_inside_the_robot_is_refused_with_the_pair():
    with pytest.raises(StackError, match=r"'panda_link0' and 'red_cube' are .* mm inside each other"):
        twin_of(estimate("red_cube", (0.02, 0.0, 0.025), CUBE))


def test_a_thing_in_the_air_is_refused():
    with pytest.raises(StackError, match="'red_cube' was perceived 275 mm above anything"):
        twin_of(estimate("red_cube", (0.5, 0.0, 0.3), CUBE))


def test_poses_that_are_not_numbers_are_refused():
    with pytest.raises(StackError, match="'red_cube' is not finite"):
        twin_of(estimate("red_cube", (0.5, np.nan, 0.025), CUBE))


def test_joints_of_the_wrong_number_are_refused():
    with pytest.raises(ConfigError, match=r"shape \(7,\), not \(6,\)"):
        build_twin(CELL, scene(), np.zeros(6), OPEN)


def in_hand(offset=(0.0, 0.0, 0.0), size=0.05, yaw=0.0):
    """A cube between the pads of the hand at rest, moved by `offset` in the hand's frame."""
    data = twin_of().start()
    hand = data.site(TCP_SITE)
    turn = hand.xmat.reshape(3, 3)
    # The hand points down at rest: a cube turned about the world's z is turned about the hand's z.
    return estimate("red_cube", hand.xpos + turn @ np.array(offset), (size,) * 3, yaw=yaw)


@pytest.mark.parametrize(("offset", "size", "yaw"), [((0, 0, 0), 0.05, 0.0), ((0.003, 0.005, 0.004), 0.047, 0.05)])
def test_a_held_object_stays_between_the_pads(offset, size, yaw):
    twin = build_twin(CELL, scene(in_hand(offset, size, yaw)), np.array(REST_Q), 0.05, held="red_cube")
    assert twin.held == "red_cube"
    assert drift(twin, 2.0) < 1e-3
    # The pads are as far apart as the cube is wide, however wide the gripper said.
    assert 2 * twin.start().joint("panda_finger_joint1").qpos[0] == pytest.approx(size, abs=0.004)
    assert drift(perturbed_twin(twin, np.random.default_rng(0)), 1.0) < 2e-3


def test_a_held_object_that_is_beside_the_hand_is_refused():
    for offset in ((0.0, 0.06, 0.0), (0.05, 0.0, 0.0)):
        with pytest.raises(StackError, match=r"'red_cube' .*between the pads"):
            build_twin(CELL, scene(in_hand(offset)), np.array(REST_Q), 0.05, held="red_cube")


def test_a_held_object_that_was_not_perceived_is_refused():
    with pytest.raises(StackError, match=r"'red_cube' should be in the hand .* perceived were \['crate'\]"):
        twin_of(estimate("crate", (0.5, 0.0, 0.03), CRATE), held="red_cube")


def blocked_twin():
    return build_twin(
        load_cell("cubes-blocked"),
        exact_scene(build_world(load_cell("cubes-blocked"), 0, meshes=False)),
        np.array(REST_Q),
        OPEN,
    )


def test_a_perturbed_twin_differs_within_its_spreads_and_leaves_the_twin_alone():
    twin = blocked_twin()
    mass, friction, gain = (
        x.copy() for x in (twin.model.body_mass, twin.model.geom_friction, twin.model.actuator_gainprm)
    )
    moved, heavier = [], []
    body = twin.model.body("red_cube").id
    for seed in range(20):
        other = perturbed_twin(twin, np.random.default_rng(seed))
        moved.append(positions(other)["red_cube"] - positions(twin)["red_cube"])
        heavier.append(other.model.body_mass[body] / mass[body])
        assert drift(other, 0.2) < 2e-3
        ratio = other.model.actuator_gainprm[:7, 0] / gain[:7, 0]
        assert np.all(np.abs(ratio - 1) <= 0.07)
        # A servo pulls to where it is told: both of its gains changed alike.
        assert np.allclose(-other.model.actuator_biasprm[:7, 1], other.model.actuator_gainprm[:7, 0])
    assert np.array_equal(twin.model.body_mass, mass)
    assert np.array_equal(twin.model.geom_friction, friction)
    assert np.array_equal(twin.model.actuator_gainprm, gain)
    # 3 mm of spread, cut at twice that: 20 draws of two coordinates have a standard deviation of 2 to 4 mm.
    assert 0.0015 < np.std(np.array(moved)[:, :2]) < 0.0045
    assert np.abs(np.array(moved)[:, :2]).max() < 0.0065
    assert 0.7 <= min(heavier) < 0.9
    assert 1.1 < max(heavier) <= 1.3


def test_derived_constants_follow_the_masses_of_a_perturbed_twin():
    twin = blocked_twin()
    other = perturbed_twin(twin, np.random.default_rng(3))
    body = twin.model.body("crate").id
    ratio = other.model.body_mass[body] / twin.model.body_mass[body]
    assert other.model.body_subtreemass[body] == pytest.approx(ratio * twin.model.body_subtreemass[body])
    assert other.model.body_invweight0[body, 0] == pytest.approx(twin.model.body_invweight0[body, 0] / ratio)


def test_a_scale_of_zero_gives_the_twin_again_and_the_same_seed_the_same_perturbation():
    twin = blocked_twin()
    same = perturbed_twin(twin, np.random.default_rng(0), scale=0.0)
    assert np.abs(same.qpos - twin.qpos).max() < 1e-4
    first, again = (perturbed_twin(twin, np.random.default_rng(7)) for _ in range(2))
    assert np.array_equal(first.qpos, again.qpos)


def test_the_less_is_known_the_more_worlds_a_plan_is_tried_in():
    def known_to(std):
        return worlds_to_try(twin_of(estimate("red_cube", (0.45, 0.0, 0.025), (0.05, 0.05, 0.05), std=std)))

    assert [known_to(s) for s in (0.001, 0.003, 0.004, 0.005, 0.02)] == [3, 3, 6, 8, 8]
