"""Either gripper is one table of numbers that planning, the twin, dynamics and the robot's side all read."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from benchmarks.robot_side.perfect_robot import perfect_driver, swing
from benchmarks.scenes.tabletop_twins import arm, cubes, red_on_crate
from control.errors import ConfigError, RefusedError
from control.grasping.grasps import grasps
from control.planners.motion_search import plan_motion
from control.retiming.retime import retime
from control.robot.dynamics import RobotModel
from control.robot.gripper import GRIPPERS, PANDA_HAND, ROBOTIQ_2F85, ROBOTIQ_COUPLING, ROBOTIQ_TIP, gripper_model
from control.robot.kinematics import ArmKinematics
from control.robot.limits import REST_Q, panda_limits
from control.safety.certificate import Verdict
from control.safety.certification import issue_certificate, limits_hash
from control.safety.limits import SafetyLimits
from control.simulation.rollouts import gripper_ramp
from control.tasks.subtasks import posed_objects
from control.trajectory.samples import GripperCommand, JointPath, PathSegment
from control.twin_model import FINGER_BODIES, FINGER_JOINTS, HAND_BODY, TCP_SITE
from hw_interface.cell.gate import Gate
from hw_interface.simulated.sim_backend import SimBackend
from replan.run.readiness import check_ready
from sim_check.cells.loading import load_cell
from sim_check.models.panda_mjcf import PICTURE_GROUP, panda_spec
from sim_check.models.robotiq_mjcf import add_robotiq
from tests.support.robot_side.hw_support import joined

SAFETY = SafetyLimits()
BOTH = pytest.mark.parametrize("gripper", GRIPPERS.values(), ids=GRIPPERS)


def test_a_cell_chooses_its_gripper_by_name_and_an_unknown_one_is_refused_with_the_valid_names(tmp_path):
    file = tmp_path / "mine.yaml"
    lines = [
        "name: mine",
        "objects: [red_cube]",
        "cameras: [{name: a, mounting: static, position: [1, 0, 1], look_at: [0, 0, 0], fx: 600}]",
    ]
    file.write_text("\n".join([*lines, "robot: {gripper: robotiq_2f85}"]))
    assert load_cell(file).robot.gripper_model is ROBOTIQ_2F85
    file.write_text("\n".join(lines))
    assert load_cell(file).robot.gripper_model is PANDA_HAND
    file.write_text("\n".join([*lines, "robot: {gripper: robotiq_2f140}"]))
    with pytest.raises(ConfigError, match=r"(?s)robot\.gripper.*'panda_hand'.*'robotiq_2f85'"):
        load_cell(file)
    with pytest.raises(ConfigError, match=r"no gripper 'hook'; there are \['panda_hand', 'robotiq_2f85'\]"):
        gripper_model("hook")


@BOTH
def test_twin_dynamics_and_kinematics_agree_on_the_tool_and_the_weight_of_the_robot(gripper):
    model = panda_spec(meshes=False, gripper=gripper).compile()
    data, robot = mujoco.MjData(model), RobotModel.panda(gripper=gripper)
    q = np.random.default_rng(0).uniform(model.jnt_range[:7, 0], model.jnt_range[:7, 1], (1000, 7))
    positions, rotations = ArmKinematics.from_urdf(gripper=gripper).forward(q)
    poses = robot.tcp_poses(q)
    for k, row in enumerate(q):
        data.qpos[:7] = row
        mujoco.mj_kinematics(model, data)
        site = data.site(TCP_SITE)
        rotation = site.xmat.reshape(3, 3)
        for position, turn in ((poses[k][:3, 3], poses[k][:3, :3]), (positions[k], rotations[k])):
            np.testing.assert_allclose(position, site.xpos, atol=1e-6)
            np.testing.assert_allclose(turn, rotation, atol=1e-6)
    assert robot.mass == pytest.approx(float(model.body_mass.sum()), abs=1e-9)


@BOTH
def test_twin_and_dynamics_need_the_same_torques(gripper):
    spec = panda_spec(meshes=False, gripper=gripper)
    for joint in spec.joints:  # reflected inertia and damping are the motors', not the links'
        joint.armature, joint.damping = 0.0, [0.0, 0.0, 0.0]
    model = spec.compile()
    data, robot = mujoco.MjData(model), RobotModel.panda(gripper=gripper)
    rng = np.random.default_rng(1)
    for _ in range(20):
        q, qd, qdd = rng.uniform(model.jnt_range[:7, 0], model.jnt_range[:7, 1]), *rng.normal(0.0, 1.0, (2, 7))
        data.qpos[:], data.qvel[:], data.qacc[:] = gripper.opening / 2, 0.0, 0.0
        data.qpos[:7], data.qvel[:7] = q, qd
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | mujoco.mjtDisableBit.mjDSBL_ACTUATION
        mujoco.mj_forward(model, data)
        data.qacc[:], data.qacc[:7] = 0.0, qdd
        mujoco.mj_inverse(model, data)
        needed = data.qfrc_inverse[:7] + data.qfrc_passive[:7]
        np.testing.assert_allclose(robot.torque(q, qd, qdd), needed, atol=1e-6)


def test_the_2f85_weighs_what_its_manual_says_and_takes_the_place_of_the_pandas_hand():
    mounting = ROBOTIQ_2F85.mounting
    assert mounting is not None
    assert mounting.base.mass + 2 * mounting.finger.mass == pytest.approx(0.925)
    hand = 0.73 + 2 * 0.015  # of the Panda's URDF
    assert RobotModel.panda(gripper=ROBOTIQ_2F85).mass - RobotModel.panda().mass == pytest.approx(0.925 - hand)


def test_the_2f85s_linear_jaws_err_on_the_safe_side_of_the_arc_of_its_real_fingers():
    mounting = ROBOTIQ_2F85.mounting
    assert mounting is not None
    width = np.linspace(0.0, ROBOTIQ_2F85.opening, 50)
    reach = np.sqrt(0.05715**2 - (width / 2 + 0.0078 - 0.0127) ** 2)  # past the knuckles' axes
    tip = ROBOTIQ_COUPLING + 0.163 - reach.max() + reach
    assert tip[0] - tip[-1] == pytest.approx(0.0139, abs=5e-4)
    # Nothing reaches further than planned for, so nothing touches the table.
    assert np.all(tip <= mounting.tcp + ROBOTIQ_2F85.fingertip + 1e-9) and pytest.approx(tip.max()) == ROBOTIQ_TIP
    # Whatever can be held is held by real pads, 37.5 mm long, from the tool centre point on towards the palm.
    held = width <= ROBOTIQ_2F85.widest(SAFETY.finger_clearance)
    assert np.all(tip[held] >= mounting.tcp + ROBOTIQ_2F85.pad_reach)
    assert np.all(tip[held] - 0.0375 <= mounting.tcp - 0.024)


@BOTH
def test_the_rest_pose_touches_nothing_and_the_pads_meet_when_closed(gripper):
    model = panda_spec(meshes=False, gripper=gripper).compile()
    data = mujoco.MjData(model)
    data.qpos[:7] = REST_Q
    for half in (0.0, gripper.opening / 4, gripper.opening / 2):
        for joint in FINGER_JOINTS:
            data.joint(joint).qpos[:] = half
        mujoco.mj_forward(model, data)
        assert data.ncon == 0
        pads = [model.geom(n).id for n in ("left_pad", "right_pad")]
        assert mujoco.mj_geomDistance(model, data, *pads, 1.0, np.zeros(6)) == pytest.approx(2 * half, abs=2e-4)


def test_cameras_see_the_2f85_whole_and_what_they_see_touches_nothing():
    mounting, spec = ROBOTIQ_2F85.mounting, mujoco.MjSpec()
    assert mounting is not None
    add_robotiq(spec, spec.worldbody, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), mounting, ROBOTIQ_2F85.opening, True)
    model = spec.compile()
    pictures = model.geom_group == PICTURE_GROUP
    assert {model.body(b).name for b in model.geom_bodyid[pictures]} == {HAND_BODY, *FINGER_BODIES}
    assert not model.geom_contype[pictures].any() and not model.geom_conaffinity[pictures].any()
    assert model.body_mass.sum() == pytest.approx(0.925)


def test_a_gripper_that_opens_less_offers_no_grasp_of_what_is_too_wide_for_it():
    twin = cubes()
    cube = posed_objects(twin, twin.start())["red_cube"]
    narrow = replace(PANDA_HAND, opening=float(np.min(cube.extents)) + 2 * SAFETY.finger_clearance - 1e-3)
    assert grasps(cube, SAFETY, twin.support_height)
    assert not grasps(cube, SAFETY, twin.support_height, gripper=narrow)


def test_a_twin_plays_a_gripper_command_at_its_own_grippers_pace():
    twin = cubes()
    slow = replace(twin, gripper=replace(twin.gripper, planned_speed=twin.gripper.planned_speed / 2))
    close = GripperCommand("move", 0.0)
    usual, slowed = (gripper_ramp(t, 0.04, close, 0.004) for t in (twin, slow))
    assert len(slowed) == 2 * len(usual)
    np.testing.assert_allclose(slowed[-1], usual[-1])


def test_kinematics_of_the_other_gripper_are_refused_before_anything_is_planned():
    with pytest.raises(ConfigError, match=r"58\.1 mm from where the twin's gripper 'robotiq_2f85' has it"):
        plan_motion(cubes("robotiq_2f85"), red_on_crate(), SAFETY, np.random.default_rng(0), kinematics=arm())


def of_gripper(gripper):
    """A gate of a robot with this gripper, and a certificate of a swing that was judged for it."""
    limits = panda_limits(gripper)
    digest, motion = limits_hash(limits, SAFETY, gripper), swing()
    passed = Verdict((), 0, 0, (0.0, 1.0), True, 0)
    certificate = issue_certificate(
        motion, passed, profile=limits.profile, firmware=limits.firmware, limits_hash=digest, scene_stamp=0.0, now=0.0
    )
    return Gate(limits.profile, digest, limits, SAFETY, gripper=gripper), motion, certificate


@pytest.mark.parametrize(("planned", "carried"), [(ROBOTIQ_2F85, PANDA_HAND), (PANDA_HAND, ROBOTIQ_2F85)])
def test_a_motion_that_was_planned_for_the_other_gripper_is_refused_with_its_reason(planned, carried):
    own, motion, fitting = of_gripper(carried)
    _, _, other = of_gripper(planned)
    measured = perfect_driver()[1].read()
    own.check(motion, fitting, motion.q[0], measured, 0.0, set())
    names = rf"for a robot of profile '{panda_limits(planned).profile}', this one is '{panda_limits(carried).profile}'"
    with pytest.raises(RefusedError, match=names.replace("+", r"\+")) as error:
        own.check(motion, other, motion.q[0], measured, 0.0, set())
    assert error.value.code == "wrong_profile"
    # The numbers count as well as the name: another version of the same gripper has other ones.
    changed = replace(carried, opening=carried.opening + 0.001)
    assert limits_hash(panda_limits(carried), SAFETY, changed) != own.limits_hash


@pytest.mark.parametrize(
    ("gripper", "command", "able"),
    [
        (PANDA_HAND, GripperCommand("move", 0.085), None),
        (ROBOTIQ_2F85, GripperCommand("move", 0.085), "ok"),
        (ROBOTIQ_2F85, GripperCommand("move", 0.086), None),
        (ROBOTIQ_2F85, GripperCommand("grasp", 0.04, 10.0), None),  # it cannot press more gently than 20 N
        (ROBOTIQ_2F85, GripperCommand("grasp", 0.04, 100.0), "ok"),
        (PANDA_HAND, GripperCommand("grasp", 0.04, 100.0), None),
    ],
)
def test_the_gate_knows_what_its_gripper_can_do(gripper, command, able):
    motion = joined(np.array([REST_Q, REST_Q]), [command])
    gate, _, _ = of_gripper(gripper)
    limits = panda_limits(gripper)
    passed = Verdict((), 0, 0, (0.0, 1.0), True, 0)
    certificate = issue_certificate(
        motion,
        passed,
        profile=limits.profile,
        firmware=limits.firmware,
        limits_hash=gate.limits_hash,
        scene_stamp=0.0,
        now=0.0,
    )
    measured = perfect_driver()[1].read()
    if able:
        gate.check(motion, certificate, motion.q[0], measured, 0.0, set())
    else:
        with pytest.raises(RefusedError, match=rf"'{gripper.name}' is able to do 0 to"):
            gate.check(motion, certificate, motion.q[0], measured, 0.0, set())


def test_the_simulated_2f85_opens_fully_within_the_time_that_a_trajectory_gives_it():
    opened = PathSegment("reach", np.array([REST_Q]), GripperCommand("move", ROBOTIQ_2F85.opening))
    robot = RobotModel.panda(gripper=ROBOTIQ_2F85)
    trajectory = retime(JointPath((opened,)), robot, panda_limits(ROBOTIQ_2F85), SAFETY)
    model = panda_spec(meshes=False, gripper=ROBOTIQ_2F85).compile()
    data = mujoco.MjData(model)
    data.qpos[:7], data.ctrl[:7] = REST_Q, REST_Q
    backend = SimBackend(model, data, ROBOTIQ_2F85)
    backend.gripper(trajectory.gripper[0].command)
    for _ in range(round(trajectory.gripper[0].dwell * 1000)):
        backend.command(np.array(REST_Q), np.zeros(7))
    measured = backend.read()
    assert not measured.gripper_busy and measured.gripper_width == pytest.approx(ROBOTIQ_2F85.opening, abs=1e-3)


def test_a_run_against_a_robot_with_the_other_gripper_is_refused_before_it_looks():
    limits = panda_limits()
    state = SimpleNamespace(cell="mine", profile=limits.profile, firmware=limits.firmware, mode="idle")
    client = SimpleNamespace(state=lambda: state)
    ready = partial(check_ready, client, "mine", acknowledge=False)  # type: ignore[arg-type]
    ready(limits.profile, limits.firmware)
    with pytest.raises(ConfigError, match=r"profile is 'panda/5', but the cell file makes it 'panda/5\+robotiq_2f85'"):
        ready(panda_limits(ROBOTIQ_2F85).profile, limits.firmware)
    with pytest.raises(ConfigError, match=r"runs firmware 'panda .*profile is for 'panda system 3\.x'"):
        ready(limits.profile, "panda system 3.x")
