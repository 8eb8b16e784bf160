"""Furniture in cells: it stands still, its joints turn as they should, what is locked stays shut until unlocked."""

import mujoco
import numpy as np
import pytest

from benchmarks.scenes.estimates import estimate, exact_scene, noisy_scene, scene, seen_in
from control.errors import ConfigError, StackError
from control.robot.limits import REST_Q
from control.twin_model import ARM_BODIES, FINGER_BODIES, HAND_BODY
from sim_check.cells.furniture_config import CabinetConfig, LeverConfig, MicrowaveConfig, WeightPlateConfig
from sim_check.cells.loading import load_cell
from sim_check.furniture.build import furniture_model
from sim_check.furniture.model import FurnitureModel
from sim_check.objects.library import object_model
from sim_check.twin.twin import build_twin, perturbed_twin
from sim_check.world.world import build_world
from tests.support.scenes.furniture_forces import pull, put, wait

CELLS = (
    "cabinet-open",
    "cabinet-closed",
    "cabinet-blocked",
    "cabinet-locked",
    "cubes-color",
    "kitchen-explore",
    "composite-explore",
)
HIDDEN = {"cabinet-locked": "blue_cube", "kitchen-explore": "green_apple", "composite-explore": "red_cube"}
OPEN = 0.08
ROBOT = {*ARM_BODIES, HAND_BODY, *FINGER_BODIES}


def world_of(name, seed=0):
    return build_world(load_cell(name), seed, meshes=False)


def twin_of(name, seed=0, estimates=None):
    cell = load_cell(name)
    seen = estimates or exact_scene(build_world(cell, seed, meshes=False), without=HIDDEN.get(name, ""))
    return build_twin(cell, seen, np.array(REST_Q), OPEN)


@pytest.mark.parametrize("name", CELLS)
def test_every_scene_stands_for_twenty_seeds_without_overlap_and_stays_for_a_second(name):
    cell = load_cell(name)
    for seed in range(20):
        world = build_world(cell, seed, meshes=False)
        model, data = world.model, world.data
        for contact in data.contact[: data.ncon]:
            pair = {model.body(int(model.geom_bodyid[g])).name for g in contact.geom}
            assert contact.dist > -1e-3, (seed, pair)
            assert pair <= ROBOT | {"table"} or not pair & ROBOT, (seed, pair)
        before = {n: world.object_pose(n)[:3, 3] for n in world.object_names}
        joints = {n: world.joint_fraction(n) for n in world.joint_names}
        wait(world, 1.0)
        for thing, position in before.items():
            assert np.linalg.norm(world.object_pose(thing)[:3, 3] - position) < 2e-4, (seed, thing)
        for joint, fraction in joints.items():
            assert world.joint_fraction(joint) == pytest.approx(fraction, abs=2e-3), (seed, joint)


@pytest.mark.parametrize("name", CELLS)
def test_seeds_move_what_stands_in_a_scene(name):
    places = []
    for seed in range(6):
        world = world_of(name, seed)
        names = (*world.object_names, *world.furniture_names)
        places.append(np.concatenate([world.object_pose(n)[:2, 3] for n in names]))
    spread = np.std(places, axis=0).reshape(-1, 2).max(axis=1)
    assert np.all(spread > 0.004), spread


def test_the_open_cabinet_is_open_and_the_others_are_closed():
    assert all(
        0.9 < world_of("cabinet-open", 2).joint_fraction(j) <= 1.0 for j in world_of("cabinet-open", 2).joint_names
    )
    for name in ("cabinet-closed", "cabinet-blocked", "cabinet-locked", "kitchen-explore"):
        world = world_of(name)
        assert all(abs(world.joint_fraction(j)) < 1e-3 for j in world.joint_names)


@pytest.mark.parametrize(("name", "hidden"), HIDDEN.items())
def test_what_is_to_be_found_lies_inside_and_no_camera_sees_it(name, hidden):
    world = world_of(name, 1)
    inside = [
        (np.linalg.inv(world.object_pose(f.name)) @ np.append(world.object_pose(hidden)[:3, 3], 1.0))[:3]
        for f in world.furniture.values()
        for c in f.compartments
    ]
    rooms = [c for f in world.furniture.values() for c in f.compartments]
    assert sum(bool(np.all((p > c.low) & (p < c.high))) for p, c in zip(inside, rooms, strict=True)) == 1
    ray = np.zeros(1, np.int32)
    target = world.object_pose(hidden)[:3, 3]
    for camera in ("static", "right"):
        if camera not in [c.name for c in world.cameras]:
            continue
        eye = world.data.cam_xpos[world.model.camera(camera).id]
        for corner in np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1], [-1, 0, 1]), -1).reshape(-1, 3):
            way = target + 0.02 * corner - eye
            mujoco.mj_ray(world.model, world.data, eye, way / np.linalg.norm(way), None, 1, -1, ray)
            assert world.model.body(int(world.model.geom_bodyid[ray[0]])).name != hidden


def test_a_free_door_opens_under_twelve_newtons_and_stays_where_it_was_left():
    world = world_of("cabinet-closed")
    # 12 N at 0.255 m against 2 Nm of dry friction.
    angle = pull(world, "wooden_cabinet_left_door", 12.0, 5.0)
    assert angle > 1.0
    wait(world, 1.0)
    assert world.data.joint("wooden_cabinet_left_door").qpos[0] == pytest.approx(angle, abs=0.06)
    assert world.joint_fraction("wooden_cabinet_right_door") == pytest.approx(0.0, abs=1e-3)


def test_a_door_does_not_open_under_less_than_its_dry_friction():
    world = world_of("cabinet-closed")
    # Simulated dry friction creeps by some hundredths of a radian a second.
    assert pull(world, "wooden_cabinet_left_door", 6.0, 1.0) < 0.025


@pytest.mark.parametrize("door", ["left", "right"])
@pytest.mark.parametrize("seed", [0, 1])
def test_the_bar_lets_the_doors_open_a_little_and_no_further(door, seed):
    world = world_of("cabinet-blocked", seed)
    assert 0.16 < pull(world, f"wooden_cabinet_{door}_door", 18.0, 4.0) < 0.30
    # Pulled harder, it drags the other door along until the bar is jammed between both.
    assert pull(world, f"wooden_cabinet_{door}_door", 40.0, 2.0) < 0.48
    free = world_of("cabinet-closed", seed)
    assert pull(free, f"wooden_cabinet_{door}_door", 18.0, 4.0) > 1.5


@pytest.mark.parametrize("seed", range(3))
def test_the_bolted_door_opens_only_after_the_lever_was_pulled(seed):
    world = world_of("cabinet-locked", seed)
    assert pull(world, "wooden_cabinet_door", 30.0, 1.0) < 0.02
    pull(world, "lever_rod", 12.0, 2.0)
    assert world.joint_fraction("lever_rod") > 0.95
    assert pull(world, "wooden_cabinet_door", 15.0, 3.0) > 1.0


@pytest.mark.parametrize(("fraction", "free"), [(0.6, False), (0.75, False), (0.85, True)])
def test_the_bolt_comes_free_near_the_end_of_the_levers_way_and_the_lever_stays_there(fraction, free):
    world = world_of("cabinet-locked")
    world.data.joint("lever_rod").qpos = fraction * 1.57
    wait(world, 0.3)
    assert world.joint_fraction("lever_rod") == pytest.approx(fraction, abs=0.02)
    assert (pull(world, "wooden_cabinet_door", 15.0, 2.0) > 0.5) == free


@pytest.mark.parametrize(("mass", "free"), [(0.10, False), (0.20, False), (0.35, True), (0.5, True)])
def test_a_heavy_weight_draws_the_bolt_of_the_sliding_door_and_a_light_one_does_not(mass, free):
    world = world_of("composite-explore")
    plate = world.object_pose("weight_sensor")[:3, 3]
    put(world, "red_cube", plate + np.array([0.0, 0.0, 0.015 + 0.0275 + 0.003]), mass)
    wait(world, 0.8)
    slid = pull(world, "stone_cabinet_door", 20.0, 2.0)
    assert (slid > 0.18) if free else (slid < 0.01)


def test_the_bolt_falls_back_when_the_weight_is_taken_away():
    world = world_of("composite-explore")
    plate = world.object_pose("weight_sensor")[:3, 3]
    put(world, "red_cube", plate + np.array([0.0, 0.0, 0.05]), 0.5)
    wait(world, 0.8)
    put(world, "red_cube", [0.2, -0.3, 0.03])
    wait(world, 0.8)
    assert pull(world, "stone_cabinet_door", 30.0, 1.0) < 0.01


def test_the_kettle_stands_in_the_way_of_the_microwaves_door():
    world = world_of("kitchen-explore", 1)
    # 9 N are enough for the free door, but not for door and kettle.
    blocked = pull(world, "microwave_door", 9.0, 3.0)
    put(world, "kettle", [0.3, -0.3, 0.11])
    assert pull(world, "microwave_door", 9.0, 6.0) > blocked + 0.5


def test_the_weight_weighs_what_the_cell_says_give_or_take_its_mismatch():
    world = world_of("composite-explore")
    assert world.model.body("red_cube").mass[0] == pytest.approx(0.5, rel=0.11)


@pytest.mark.parametrize("name", CELLS)
def test_twin_joints_lie_where_the_truths_do(name):
    cell, world = load_cell(name), world_of(name, 3)
    twin = build_twin(cell, exact_scene(world, without=HIDDEN.get(name, "")), np.array(REST_Q), OPEN)
    assert {j.name for j in twin.joints} == {n for n in world.joint_names if not n.endswith("plate")}
    mine = twin.start()
    for joint in twin.joints:
        model, truth = twin.model.joint(joint.name), world.model.joint(joint.name)
        assert np.allclose(model.range, truth.range)
        assert np.allclose(model.range, [joint.closed, joint.opened])
        ours, theirs = twin.model.joint(joint.name).id, world.model.joint(joint.name).id
        assert np.allclose(mine.xaxis[ours], world.data.xaxis[theirs], atol=1e-6)
        assert np.allclose(mine.xanchor[ours], world.data.xanchor[theirs], atol=1e-3)
        assert twin.joint_fractions()[joint.name] == pytest.approx(world.joint_fraction(joint.name), abs=2e-3)


@pytest.mark.parametrize("name", CELLS)
def test_a_handle_is_described_where_its_bar_is(name):
    twin = twin_of(name)
    data = twin.start()
    for joint in twin.joints:
        body = twin.model.body(joint.body).id
        turn, at = data.xmat[body].reshape(3, 3), data.xpos[body]
        handle = joint.handle
        middle = at + turn @ handle.centre
        inside = [_distance(twin.model, data, g, middle) for g in np.flatnonzero(twin.model.geom_bodyid == body)]
        assert min(inside) < -0.8 * handle.half_depth  # the middle of the bar is deep inside of it
        for end in (-1, 1):  # and so are the ends of what fingers may take
            point = at + turn @ (handle.centre + end * handle.half_length * handle.axis)
            assert (
                min(_distance(twin.model, data, g, point) for g in np.flatnonzero(twin.model.geom_bodyid == body)) < 0
            )
        outside = at + turn @ (handle.centre + 1.2 * handle.half_depth * handle.outward)
        assert min(_distance(twin.model, data, g, outside) for g in range(twin.model.ngeom)) > 0
        assert abs(handle.axis @ handle.outward) < 1e-9
        assert max(handle.half_width, handle.half_depth) <= 0.02
        assert handle.clearance > 0.015
        # Opening moves the handle outwards, or along the front.
        axis = data.xaxis[twin.model.joint(joint.name).id]
        arm = middle - data.xanchor[twin.model.joint(joint.name).id]
        moves = axis if joint.kind == "slide" else np.cross(axis, arm)
        if joint.kind == "hinge":
            assert moves @ (turn @ handle.outward) > 0.5 * np.linalg.norm(moves)
        assert middle[2] > 0.2  # a Panda's hand takes nothing lower from the front


def _distance(model, data, geom, point):
    """Signed distance in [m] of a point from a box, capsule or sphere; infinite for other geoms."""
    local = data.geom_xmat[geom].reshape(3, 3).T @ (point - data.geom_xpos[geom])
    size = model.geom_size[geom]
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX:
        gap = np.abs(local) - size
        return float(np.linalg.norm(np.maximum(gap, 0)) + min(gap.max(), 0))
    if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CAPSULE:
        local[2] -= np.clip(local[2], -size[1], size[1])
        return float(np.linalg.norm(local) - size[0])
    return np.inf


@pytest.mark.parametrize("name", ["cabinet-locked", "composite-explore"])
def test_a_twin_knows_nothing_of_bolts(name):
    twin, world = twin_of(name), world_of(name)
    bodies = {twin.model.body(i).name for i in range(twin.model.nbody)}
    assert any(world.model.body(i).name.endswith("_bolt") for i in range(world.model.nbody))
    assert not any("bolt" in b for b in bodies)
    assert not any("hook" in twin.model.geom(g).name for g in range(twin.model.ngeom))
    assert twin.model.neq == 1  # the fingers' coupling


def test_a_bar_is_snapped_behind_the_handles_however_it_was_perceived():
    cell = load_cell("cabinet-blocked")
    for seed in range(8):
        world = build_world(cell, seed, meshes=False)
        seen = noisy_scene(world, np.random.default_rng(seed), 0.005, 2.0)
        twin = build_twin(cell, seen, np.array(REST_Q), OPEN)
        data = twin.start()
        # Height is known exactly, for the stand-offs' is; in the slot it is off by no more than its room.
        assert data.body("red_bar").xpos[2] == pytest.approx(world.object_pose("red_bar")[2, 3], abs=1e-3)
        cabinet = data.body("wooden_cabinet")
        local = cabinet.xmat.reshape(3, 3).T @ (data.body("red_bar").xpos - cabinet.xpos)
        assert -0.15 - 0.021 - 0.037 < local[0] < -0.15 - 0.021


@pytest.mark.parametrize("seed", [10, 16])
def test_a_bar_seen_two_centimetres_off_and_crooked_is_snapped_though_many_nearer_poses_let_it_fall(seed):
    cell = load_cell("cabinet-blocked")
    seen = noisy_scene(build_world(cell, seed, meshes=False), np.random.default_rng([seed, 7]), 0.01, 4.0)
    data = build_twin(cell, seen, np.array(REST_Q), OPEN).start()
    cabinet = data.body("wooden_cabinet")
    local = cabinet.xmat.reshape(3, 3).T @ (data.body("red_bar").xpos - cabinet.xpos)
    assert -0.15 - 0.021 - 0.037 < local[0] < -0.15 - 0.021


def test_what_lies_in_an_open_cabinet_is_set_on_its_shelf_even_when_its_bottom_was_not_seen():
    cabinet = seen_in(world_of("cabinet-open"), "wooden_cabinet")
    shelf = 0.17
    at = cabinet.world_T_object[:3, 3]
    cube = estimate("yellow_cube", (at[0] - 0.03, at[1], (shelf + 0.05) / 2), (0.05, 0.05, shelf + 0.05))
    twin = twin_of("cabinet-open", estimates=scene(cabinet, cube))
    thing = twin.get("yellow_cube")
    assert thing is not None
    assert thing.extents[2] == pytest.approx(0.05, abs=1e-3)
    assert twin.start().body("yellow_cube").xpos[2] == pytest.approx(shelf + 0.025, abs=1e-3)


def test_what_stands_on_a_cabinet_stays_on_it():
    cabinet = seen_in(world_of("cabinet-closed"), "wooden_cabinet")
    at = cabinet.world_T_object[:3, 3]
    cube = estimate("yellow_cube", (at[0], at[1], 0.57 + 0.03), (0.05, 0.05, 0.05))
    twin = twin_of("cabinet-closed", estimates=scene(cabinet, cube))
    thing = twin.get("yellow_cube")
    assert thing is not None
    assert twin.start().body("yellow_cube").xpos[2] - thing.extents[2] / 2 == pytest.approx(0.57, abs=1e-3)


def test_a_perturbed_twin_moves_furniture_with_what_hangs_on_it_and_changes_its_friction():
    twin = twin_of("cabinet-blocked")
    before = twin.start()
    shifts, frictions = [], []
    for seed in range(10):
        other = perturbed_twin(twin, np.random.default_rng(seed))
        data = other.start()
        shifts.append(data.body("wooden_cabinet").xpos - before.body("wooden_cabinet").xpos)
        dof = int(other.model.joint("wooden_cabinet_left_door").dofadr[0])
        frictions.append(other.model.dof_frictionloss[dof])
        assert data.body("red_bar").xpos[2] == pytest.approx(before.body("red_bar").xpos[2], abs=2e-3)
    shifts = np.array(shifts)
    assert 0.0015 < np.std(shifts[:, :2]) < 0.005
    assert np.all(np.abs(shifts[:, 2]) < 1e-9)
    assert 1.4 <= min(frictions) < 1.8
    assert 2.2 < max(frictions) <= 2.6
    assert twin.model.body("wooden_cabinet").pos[0] == pytest.approx(before.body("wooden_cabinet").xpos[0])


def test_an_estimate_with_a_joint_that_its_furniture_lacks_is_refused():
    cabinet = seen_in(world_of("cabinet-locked"), "wooden_cabinet")
    plain = seen_in(world_of("cabinet-closed"), "wooden_cabinet")
    with pytest.raises(StackError, match=r"'wooden_cabinet' has no joint 'wooden_cabinet_door'; it has \['wooden_"):
        twin_of("cabinet-closed", estimates=scene(cabinet))
    assert len(twin_of("cabinet-closed", estimates=scene(plain)).joints) == 2


def test_a_kettle_can_be_taken_by_its_handle_whatever_size_it_was_seen_in():
    for size in (0.9, 1.0, 1.2):
        kettle = object_model("kettle", size * np.array([0.13, 0.10, 0.20]))
        assert kettle.handle is not None
        assert kettle.handle.half_width <= 0.02
        assert kettle.handle.clearance > 0.02
        low = np.min([s.position - np.max(s.half) for s in kettle.solids], axis=0)
        assert np.all(low > -1.5 * kettle.extents)
        bar = kettle.solids[1]
        assert bar.position[2] + bar.half[0] == pytest.approx(kettle.extents[2] / 2)


def model_of(config) -> FurnitureModel:
    return furniture_model("thing", config)


@pytest.mark.parametrize(
    "config",
    [
        CabinetConfig(kind="cabinet"),
        CabinetConfig(kind="cabinet", doors=1, hinge="right", width=0.4),
        CabinetConfig(kind="cabinet", opening="sliding"),
        CabinetConfig(kind="cabinet", opening="sliding", hinge="right"),
        MicrowaveConfig(kind="microwave"),
        LeverConfig(kind="lever"),
        WeightPlateConfig(kind="weight_plate"),
    ],
)
def test_furniture_fills_its_box_and_its_parts_are_named_as_the_configuration_says(config):
    thing = model_of(config)
    assert tuple(p.name for p in thing.parts) == config.part_names("thing")
    corners = []
    for board in thing.boards:
        if np.allclose(board.solid.quat, [1, 0, 0, 0]):
            corners += [board.solid.position - board.solid.half, board.solid.position + board.solid.half]
    assert np.min(corners, axis=0)[2] == pytest.approx(-thing.extents[2] / 2)
    assert np.all(np.abs(corners) <= thing.extents / 2 + 1e-9)


@pytest.mark.parametrize("hinge", ["left", "right"])
def test_a_sliding_door_uncovers_its_compartment(hinge):
    config = CabinetConfig(kind="cabinet", opening="sliding", hinge=hinge)
    thing = model_of(config)
    door, room = thing.parts[0], thing.compartments[0]
    panel = door.boards[0].solid
    middle = door.anchor[1] + panel.position[1]
    assert middle - panel.half[1] < room.low[1]
    assert middle + panel.half[1] > room.high[1]
    opened = middle + door.opened * door.axis[1]
    covered = min(opened + panel.half[1], room.high[1]) - max(opened - panel.half[1], room.low[1])
    assert covered < 0.2 * (room.high[1] - room.low[1])


SMALLEST = """\
name: mine
objects: [red_cube]
cameras:
  - {name: static, mounting: static, position: [1.0, 0.0, 0.7], look_at: [0.4, 0.0, 0.0], fx: 600.0}
"""


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("furniture: {a: {kind: wardrobe}}", "furniture.a: there is no kind 'wardrobe'; kinds are cabinet, microwave"),
        ("furniture: {a: {doors: 2}}", "furniture.a: key 'kind' is missing; kinds are cabinet"),
        (
            "furniture: {a: {kind: cabinet, dors: 2}}",
            "unknown key 'furniture.a.dors'; valid keys there are width, depth",
        ),
        ("furniture: {a: {kind: lever, doors: 2}}", "unknown key 'furniture.a.doors'; valid .* pivot_height"),
        ("furniture: {a: {kind: cabinet, doors: 3}}", "furniture.a.doors: Input should be 1 or 2"),
        ("furniture: {a: {kind: cabinet, handle_height: 0.1}}", "beyond the door, which reaches from 0.15 to 0.57"),
        ("furniture: {a: {kind: cabinet, handle_radius: 0.05}}", "handle_radius: .*less than or equal to 0.02"),
        ("furniture: {red_cube: {kind: lever}}", "'red_cube' is both an object and furniture"),
        (
            "simulation: {placements: [{object: red_cube, joints: {x: 1}}]}",
            "'red_cube' is no furniture and has no joints",
        ),
    ],
)
def test_mistakes_about_furniture_are_told_by_name(tmp_path, line, message):
    (tmp_path / "mine.yaml").write_text(SMALLEST + line + "\n")
    with pytest.raises(ConfigError, match=message):
        load_cell(tmp_path / "mine.yaml")


@pytest.mark.parametrize(
    ("simulation", "message"),
    [
        ("{placements: [{object: a, joints: {a_door: 1}}]}", r"'a' has no joint 'a_door'; it has \['a_left_door'"),
        ("{placements: [{object: a, mass: 1}]}", "mass of furniture 'a' is not set here"),
        (
            "{placements: [{object: a}, {object: b}], locks: [{joints: [a_left_door], drawn_by: a_right_door}]}",
            r"drawn by a lever or a weight plate, not by 'a_right_door'; there are \['b_rod'\]",
        ),
        (
            "{placements: [{object: a}, {object: b}], locks: [{joints: [b_rod], drawn_by: b_rod}]}",
            r"keeps doors closed, not 'b_rod'; doors that are placed: \['a_left_door', 'a_right_door'\]",
        ),
        ("{placements: [{object: c}]}", r"objects are \['red_cube'\], furniture is \['a', 'b'\]"),
        ("{placements: [{object: a, joints: {a_left_door: 2}}]}", "less than or equal to 1"),
    ],
)
def test_placements_and_locks_must_speak_of_what_there_is(tmp_path, simulation, message):
    text = SMALLEST + "furniture: {a: {kind: cabinet}, b: {kind: lever}}\n" + f"simulation: {simulation}\n"
    (tmp_path / "mine.yaml").write_text(text)
    with pytest.raises(ConfigError, match=message):
        load_cell(tmp_path / "mine.yaml")


def test_things_lie_only_in_what_has_an_inside(tmp_path):
    text = SMALLEST + (
        "furniture: {b: {kind: lever}}\n"
        "simulation: {placements: [{object: b, position: [0.6, 0.0]}, {object: red_cube, lies_in: b}]}\n"
    )
    (tmp_path / "mine.yaml").write_text(text)
    with pytest.raises(ConfigError, match="'red_cube' lies in 'b', which has no inside"):
        build_world(load_cell(tmp_path / "mine.yaml"), 0, meshes=False)


def test_a_joint_that_is_not_there_is_answered_with_those_that_are():
    with pytest.raises(ConfigError, match=r"no joint 'door'; it has \['lever_rod', 'wooden_cabinet_door'\]"):
        world_of("cabinet-locked").joint_fraction("door")
