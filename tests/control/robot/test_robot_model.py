"""The MuJoCo Panda is the URDF's Panda: where it is, what it weighs, what its collision bodies contain."""

from functools import cache

import mujoco
import numpy as np
import pinocchio as pin  # type: ignore[import-not-found]
import pytest

from control.robot.description_files import panda_description, panda_urdf
from control.robot.limits import REST_Q, panda_limits
from control.robot.rotations import rotation_log
from control.twin_model import (
    ARM_ACTUATORS,
    ARM_BODIES,
    ARM_JOINTS,
    FINGER_BODIES,
    FINGER_JOINTS,
    GRIPPER_ACTUATOR,
    HAND_BODY,
    TCP_SITE,
)
from sim_check.models.capsules import (
    CAPSULES_PER_LINK,
    SLAB_CUTS,
    fit_capsules,
    fit_link,
    link_points,
    outside,
    slab_boxes,
    stored_boxes,
    stored_capsules,
    union_volume,
)
from sim_check.models.panda_mjcf import COLLISION_GROUP, PAD_NAMES, PICTURE_GROUP, SERVO_LEAD, panda_spec
from sim_check.models.robot_meshes import CELL, load_parts, thin

CONTAINED_WITHIN = 0.003  # how far any point of a link's surface may stick out of its collision bodies, in [m]


@cache
def mj_model() -> mujoco.MjModel:
    return panda_spec(meshes=False).compile()


@cache
def pin_model() -> pin.Model:
    return pin.buildModelFromUrdf(str(panda_urdf()))


def test_every_name_that_the_stack_uses_exists():
    model = mj_model()
    for name in (*ARM_BODIES, HAND_BODY, *FINGER_BODIES):
        assert model.body(name).id > 0
    assert [model.joint(i).name for i in range(9)] == [*ARM_JOINTS, *FINGER_JOINTS]
    assert [model.actuator(i).name for i in range(8)] == [*ARM_ACTUATORS, GRIPPER_ACTUATOR]
    assert model.site(TCP_SITE).bodyid[0] == model.body(HAND_BODY).id
    for pad, finger in zip(PAD_NAMES, FINGER_BODIES, strict=True):
        assert model.geom(pad).bodyid[0] == model.body(finger).id


def test_mujoco_and_pinocchio_put_every_body_in_the_same_place():
    model, data = mj_model(), mujoco.MjData(mj_model())
    other, other_data = pin_model(), pin_model().createData()
    names = (*ARM_BODIES, HAND_BODY, *FINGER_BODIES, "panda_hand_tcp")
    frames = [other.getFrameId(name) for name in names]
    q = np.random.default_rng(0).uniform(model.jnt_range[:, 0], model.jnt_range[:, 1], (1000, 9))
    worst_move, worst_turn = 0.0, 0.0
    for row in q:
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        pin.framesForwardKinematics(other, other_data, row)
        for name, frame in zip(names, frames, strict=True):
            here = data.site(TCP_SITE) if name == "panda_hand_tcp" else data.body(name)
            place = here.xpos, here.xmat.reshape(3, 3)
            there = other_data.oMf[frame]
            worst_move = max(worst_move, float(np.linalg.norm(place[0] - there.translation)))
            worst_turn = max(worst_turn, float(np.linalg.norm(rotation_log(place[1] @ there.rotation.T))))
    assert worst_move < 1e-6
    assert worst_turn < 1e-6


def body_inertia(name: str) -> pin.Inertia:
    """Mass, centre of mass and inertia of a MuJoCo body in its own frame."""
    model = mj_model()
    i = model.body(name).id
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[i])
    axes = turn.reshape(3, 3)
    return pin.Inertia(model.body_mass[i], model.body_ipos[i], axes @ np.diag(model.body_inertia[i]) @ axes.T)


def test_masses_centres_and_inertias_agree_with_pinocchio():
    other = pin_model()
    hand = other.frames[other.getFrameId(HAND_BODY)].placement
    expected = {name: body_inertia(name) for name in ARM_BODIES[:7]}
    # Pinocchio adds what is fixed to a joint: it has one inertia for the last link and the hand.
    expected[ARM_BODIES[7]] = body_inertia(ARM_BODIES[7]) + hand.act(body_inertia(HAND_BODY))
    expected |= {name: body_inertia(name) for name in FINGER_BODIES}
    joints = (0, *(other.getJointId(n) for n in (*ARM_JOINTS, *FINGER_JOINTS)))
    for joint, (name, inertia) in zip(joints, expected.items(), strict=True):
        theirs = other.inertias[joint]
        assert inertia.mass == pytest.approx(theirs.mass, abs=1e-9), name
        np.testing.assert_allclose(inertia.lever, theirs.lever, atol=1e-9, err_msg=name)
        np.testing.assert_allclose(inertia.inertia, theirs.inertia, atol=1e-9, err_msg=name)
    assert body_inertia(HAND_BODY).mass == pytest.approx(0.73)


def test_joint_and_effort_limits_are_the_published_ones():
    model, limits = mj_model(), panda_limits()
    np.testing.assert_allclose(model.jnt_range[:7], np.stack([limits.q_min, limits.q_max], axis=1))
    np.testing.assert_allclose(model.actuator_forcerange[:7, 1], limits.tau)
    np.testing.assert_allclose(model.actuator_forcerange[:7, 0], -limits.tau)
    np.testing.assert_allclose(model.jnt_range[7:], [[0.0, 0.04], [0.0, 0.04]])
    assert model.jnt_limited.all()


def test_the_dynamics_without_armature_are_pinocchios():
    model = panda_spec(meshes=False).compile()
    model.dof_armature[:] = 0.0
    data, other = mujoco.MjData(model), pin_model()
    other_data = other.createData()
    q = np.random.default_rng(1).uniform(model.jnt_range[:, 0], model.jnt_range[:, 1], (20, 9))
    mass = np.zeros((9, 9))
    for row in q:
        data.qpos[:] = row
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, mass)
        theirs = pin.crba(other, other_data, row)
        theirs = np.triu(theirs) + np.triu(theirs, 1).T
        np.testing.assert_allclose(mass, theirs, atol=1e-8)


@pytest.mark.parametrize("step", [0.002, 0.004])
def test_the_arm_tracks_a_fast_motion_and_then_stands_still(step):
    spec = panda_spec(meshes=False)
    spec.option.timestep = step
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:7] = REST_Q
    worst = 0.0
    rest, reach = np.array(REST_Q), np.array([0.5, 0.3, -0.3, 0.3, 0.4, 0.4, 0.6])
    for i in range(round(3.0 / step)):
        s = min((i + 1) * step / 2.0, 1.0)
        share, rate = s**3 * (10 - 15 * s + 6 * s * s), 30 * s * s * (1 - s) ** 2 / 2.0
        wanted = rest + reach * share
        data.ctrl[:7] = wanted + SERVO_LEAD * reach * rate
        mujoco.mj_step(model, data)
        worst = max(worst, float(np.abs(data.qpos[:7] - wanted).max()))
    # Acceleration (up to 0.9 rad/s^2) times inertia over stiffness; without the lead it would trail by 28 mrad.
    assert worst < 5e-3
    # Gravity is compensated, so nothing sags.
    assert np.abs(data.qpos[:7] - rest - reach).max() < 1e-3
    assert np.abs(data.qvel).max() < 1e-2


@pytest.mark.parametrize("step", [0.002, 0.004])
def test_a_sudden_command_leaves_the_simulation_stable(step):
    spec = panda_spec(meshes=False)
    spec.option.timestep = step
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:7] = REST_Q
    jump = np.array([1.0, 0.3, 0.5, 0.4, -1.0, 0.5, 1.0])
    data.ctrl[:7] = REST_Q + jump
    data.ctrl[7] = 0.04
    for _ in range(round(3.0 / step)):
        mujoco.mj_step(model, data)
        # Where damping balances stiffness the speed is jump / SERVO_LEAD; faster means that energy is made.
        assert np.abs(data.qvel[:7]).max() < 1.0 / SERVO_LEAD
    assert not any(w.number for w in data.warning)
    assert np.abs(data.qvel).max() < 1e-2
    assert np.abs(data.qpos[:7] - data.ctrl[:7]).max() < 1e-3


def contacts(q: tuple[float, ...], width: float = 0.04) -> set[frozenset[str]]:
    model, data = mj_model(), mujoco.MjData(mj_model())
    data.qpos[:7] = q
    data.qpos[7:] = width / 2
    mujoco.mj_forward(model, data)
    return {frozenset(model.body(model.geom_bodyid[g]).name for g in c.geom) for c in data.contact}


def test_the_rest_pose_touches_nothing_open_or_closed():
    assert contacts(REST_Q, 0.08) == set()
    assert contacts(REST_Q, 0.0) == set()


def test_a_folded_arm_touches_itself():
    assert frozenset({"panda_hand", "panda_link5"}) in contacts((0.0, 0.0, 0.0, -2.0, 0.0, 0.0, 0.785))
    # The hand reaches down and back into the base.
    assert contacts((0.0, 0.0, 0.0, -3.05, 0.0, 2.0, 0.785)) != set()


def test_links_that_are_not_joined_never_overlap_all_the_time():
    # A pair whose bodies overlap in most configurations would make self-clearance meaningless.
    model, data = mj_model(), mujoco.MjData(mj_model())
    q = np.random.default_rng(2).uniform(model.jnt_range[:7, 0], model.jnt_range[:7, 1], (500, 7))
    count: dict[frozenset[str], int] = {}
    for row in q:
        data.qpos[:7] = row
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        for pair in {frozenset(model.body(model.geom_bodyid[g]).name for g in c.geom) for c in data.contact}:
            count[pair] = count.get(pair, 0) + 1
    assert max(count.values()) < 0.15 * len(q), count


@pytest.mark.parametrize("link", sorted(CAPSULES_PER_LINK))
def test_capsules_contain_their_link(link):
    # Points three times as dense as those of the fit.
    assert outside(link_points(link, spacing=0.003), stored_capsules()[link]).max() < CONTAINED_WITHIN


@pytest.mark.parametrize("link", sorted(SLAB_CUTS))
def test_boxes_contain_their_link(link):
    points = link_points(link, spacing=0.003)
    boxes = stored_boxes()[link]
    beyond = np.min([np.max(np.abs(points - b[:3]) - b[3:], axis=1) for b in boxes], axis=0)
    assert beyond.max() < CONTAINED_WITHIN


@pytest.mark.parametrize("link", sorted(CAPSULES_PER_LINK))
def test_capsules_are_no_balloons(link):
    import trimesh

    hull = trimesh.load_mesh(panda_description() / "meshes" / "collision" / f"{link.removeprefix('panda_')}.stl")
    # A flat flange needs a round end: link 7 is the worst with 1.7 times its hull.
    assert union_volume(stored_capsules()[link]) < 1.8 * hull.convex_hull.volume


def test_fitting_again_gives_the_stored_bodies():
    np.testing.assert_allclose(fit_link("panda_link7"), stored_capsules()["panda_link7"], atol=1e-4)
    for link, cuts in SLAB_CUTS.items():
        np.testing.assert_allclose(slab_boxes(link_points(link), cuts), stored_boxes()[link], atol=1e-4)


def test_a_capsule_fitted_to_a_capsule_is_that_capsule():
    rng = np.random.default_rng(3)
    along = rng.uniform(-0.1, 0.1, 3000)
    normal = rng.normal(size=(3000, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    points = 0.05 * normal + np.outer(along, [0.0, 0.0, 1.0])
    found = fit_capsules(points, 1, np.random.default_rng(0), starts=2)[0]
    assert found[6] == pytest.approx(0.05, abs=2e-3)
    assert np.linalg.norm(found[3:6] - found[:3]) == pytest.approx(0.2, abs=5e-3)


def test_too_few_points_for_a_fit_are_refused():
    with pytest.raises(ValueError, match="5 points are too few for 2 capsules; give at least 8"):
        fit_capsules(np.zeros((5, 3)), 2, np.random.default_rng(0))


def test_pictures_change_neither_weight_nor_contacts(tmp_path):
    plain, dressed = mj_model(), panda_spec(mesh_cache=tmp_path).compile()
    assert plain.nmesh == 0
    np.testing.assert_allclose(dressed.body_mass, plain.body_mass)
    np.testing.assert_allclose(dressed.body_inertia, plain.body_inertia)
    pictures = dressed.geom_group == PICTURE_GROUP
    assert not dressed.geom_contype[pictures].any()
    assert not dressed.geom_conaffinity[pictures].any()
    assert (dressed.geom_group[~pictures] == COLLISION_GROUP).all()
    assert {dressed.body(b).name for b in dressed.geom_bodyid[pictures]} == {*ARM_BODIES, HAND_BODY, *FINGER_BODIES}
    # The second time the thinned meshes come from the folder and are the same.
    assert len(list(tmp_path.iterdir())) == 1
    again = panda_spec(mesh_cache=tmp_path).compile()
    np.testing.assert_array_equal(again.mesh_vert, dressed.mesh_vert)
    np.testing.assert_array_equal(again.geom_rgba, dressed.geom_rgba)


def test_the_picture_of_a_link_fills_the_bounds_of_its_collision_mesh():
    import trimesh

    meshes = panda_description() / "meshes"
    hull = trimesh.load_mesh(meshes / "collision" / "link6.stl")
    vertices = np.vstack([p.vertices for p in load_parts(meshes / "visual" / "link6.dae")])
    np.testing.assert_allclose([vertices.min(axis=0), vertices.max(axis=0)], hull.bounds, atol=2 * CELL)


def test_thinning_moves_no_vertex_farther_than_a_cell():
    rng = np.random.default_rng(4)
    vertices = rng.uniform(0, 0.1, (400, 3))
    faces = rng.integers(0, 400, (300, 3))
    kept, new_faces = thin(vertices, faces, cell=0.02)
    assert len(kept) < 130
    assert new_faces.max() == len(kept) - 1
    to_nearest = np.linalg.norm(kept[:, None] - vertices, axis=2).min(axis=1)
    assert to_nearest.max() < 0.02 * np.sqrt(3)
    assert all(len(set(face)) == 3 for face in new_faces.tolist())
