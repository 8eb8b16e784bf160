"""Predictive sampling, the baseline, finds motions in the twin or says how near it came, and counts what it spends."""

from dataclasses import replace
from itertools import pairwise

import mujoco
import numpy as np
import pytest

from benchmarks.scenes.furniture_twins import cabinet, sliding
from benchmarks.scenes.tabletop_twins import arm, cubes, fruit, only, red_on_crate
from control.errors import ConfigError, RetimingError
from control.planners.choice import PLANNERS, planner_named
from control.planners.predictive_sampling import plan_by_sampling
from control.planners.result import MotionPlan
from control.planners.sampling_cost import CostWeights, RunningCost
from control.planners.spline_sampler import SamplingSettings
from control.planners.splines import SplineBasis
from control.retiming.retime import retime
from control.robot.dynamics import RobotModel
from control.robot.limits import panda_limits
from control.safety.limits import SafetyLimits
from control.simulation.batches import SimulatedBatch
from control.simulation.executed_motion import Contact, MotionPiece, joint_path
from control.tasks.failure import FailureCause
from control.tasks.predicates import judge_term
from control.tasks.reward_spec import RewardSpec, RewardTerm
from control.tasks.subtasks import palm_at, posed_objects, read_subtask
from control.trajectory.samples import GripperCommand

SAFETY = SafetyLimits()
SMALL = SamplingSettings(trajectories=16, horizon=0.4, points=4, time_limit=4.0)
TO_CRATE = only("minimize_l2_distance", "palm", "crate")
OFF_CRATE = only("maximize_l2_distance", "palm", "crate", 0.65)
OPEN_DOOR = only("set_joint_fraction", "cabinet_left_door", value=0.3)
SHUT_DOOR = only("set_joint_fraction", "cabinet_right_door", value=0.0)


def sample(twin, spec, seed=0, nthread=1, settings=SMALL, observe=None):
    rng = np.random.default_rng(seed)
    return plan_by_sampling(twin, spec, SAFETY, rng, arm(), nthread=nthread, observe=observe, settings=settings)


def test_the_palm_comes_to_an_object():
    plan = sample(cubes(), TO_CRATE)
    assert isinstance(plan, MotionPlan)
    assert [s.name for s in plan.path.segments] == ["move"]
    np.testing.assert_array_equal(plan.path.segments[0].q[0], cubes().q)
    start = posed_objects(cubes(), cubes().start())
    assert start["crate"].distance_to(palm_at(cubes(), plan.path.segments[-1].q[-1])) < 0.04
    assert "palm is" in plan.description and "from crate" in plan.description


def test_a_door_is_shut_and_its_path_can_be_retimed_or_says_why_not():
    plan = sample(cabinet(0.63, 0.02, right=0.4), SHUT_DOOR)
    assert isinstance(plan, MotionPlan) and plan.stats.counts["path_meets"] in (0, 1)
    try:
        trajectory = retime(plan.path, RobotModel.panda(), panda_limits(), SAFETY)
    except RetimingError as error:
        assert "segment 'move'" in str(error)
    else:
        np.testing.assert_allclose(trajectory.q[-1], plan.path.segments[-1].q[-1], atol=1e-6)


def test_the_same_seed_gives_the_same_plan_with_one_and_with_two_threads():
    one, two = sample(cubes(), OFF_CRATE, 3, nthread=1), sample(cubes(), OFF_CRATE, 3, nthread=2)
    assert isinstance(one, MotionPlan) and isinstance(two, MotionPlan)
    assert (one.cost, one.stats.steps, one.stats.counts) == (two.cost, two.stats.steps, two.stats.counts)
    for a, b in zip(one.path.segments, two.path.segments, strict=True):
        np.testing.assert_array_equal(a.q, b.q)


def test_another_seed_gives_another_plan():
    one, two = sample(cubes(), OFF_CRATE, 0), sample(cubes(), OFF_CRATE, 1)
    assert isinstance(one, MotionPlan) and isinstance(two, MotionPlan)
    assert one.cost != two.cost


def test_out_of_time_it_says_how_near_it_came_and_when():
    cause = sample(cubes(), only("set_obj_z_position", "red_cube", None, 0.25), settings=replace(SMALL, time_limit=0.3))
    assert isinstance(cause, FailureCause) and (cause.kind, cause.subject) == ("no_candidate", "red_cube")
    assert "did not reach the goal in 0.3 s of simulated motion (3 re-plans of 16 trajectories)" in cause.message
    assert "the centre of red_cube is at" in cause.message and "(asked for 250)" in cause.message
    assert cause.evidence["left_at_start"] == pytest.approx(0.215, abs=0.002)
    assert 0.0 < cause.evidence["left_at_nearest"] <= cause.evidence["left_at_start"]
    assert cause.evidence["steps"] == 3 * (16 * 100 + 25) and cause.evidence["unit"] == "m"


def test_steps_that_are_counted_are_those_that_were_simulated():
    batches: list[SimulatedBatch] = []
    plan = sample(cubes(), OFF_CRATE, observe=batches.append)
    assert isinstance(plan, MotionPlan)
    assert plan.stats.steps == sum(len(b.models) * b.controls.shape[1] for b in batches)
    sampled = [b for b in batches if len(b.models) == SMALL.trajectories]
    assert len(sampled) == plan.stats.counts["replans"]
    assert all(b.controls.shape[1] == 100 for b in sampled)  # 0.4 s in steps of 4 ms


def test_a_name_without_a_pose_is_not_seen():
    cause = sample(cubes(), only("minimize_l2_distance", "palm", "green_cube"))
    assert isinstance(cause, FailureCause) and (cause.kind, cause.subject) == ("not_seen", "green_cube")


def test_what_is_met_already_stays_where_it_is():
    plan = sample(cubes(), only("maximize_l2_distance", "red_cube", "crate", 0.15))
    assert isinstance(plan, MotionPlan) and plan.stats.counts["replans"] == 0
    np.testing.assert_allclose(plan.path.segments[0].q, np.tile(cubes().q, (len(plan.path.segments[0].q), 1)))


def test_planners_have_names_and_an_unknown_one_is_answered_with_them():
    assert planner_named("predictive-sampling") is plan_by_sampling and len(PLANNERS) == 2
    with pytest.raises(
        ConfigError, match=r"no motion planner named 'rrt'; there are \['candidates', 'predictive-sampling'\]"
    ):
        planner_named("rrt")


def test_settings_that_cannot_work_say_what_would():
    with pytest.raises(ConfigError, match=r"re-plans every 0.7 s; the period must be above 0 and at most the horizon"):
        SamplingSettings(period=0.7)
    with pytest.raises(ConfigError, match="it needs at least one trajectory and two points"):
        SamplingSettings(points=1)


@pytest.mark.parametrize("order", ["linear", "cubic"])
def test_splines_go_through_their_points_and_their_slopes_are_their_derivatives(order):
    points, speed = np.array([[0.0, 1.0], [0.5, 0.2], [0.1, 0.3], [0.4, 0.4]]), np.array([0.7, -0.3])
    at_points, _ = SplineBasis.of(order, 4, 0.6, np.linspace(0.0, 0.6, 4)).sample(points, speed)
    np.testing.assert_allclose(at_points, points, atol=1e-12)
    times = np.array([0.03, 0.17, 0.33, 0.55])
    (before, _), (_, slope), (after, _) = (
        SplineBasis.of(order, 4, 0.6, times + shift).sample(points, speed) for shift in (-1e-6, 0.0, 1e-6)
    )
    np.testing.assert_allclose((after - before) / 2e-6, slope, atol=1e-5)
    if order == "cubic":
        np.testing.assert_allclose(SplineBasis.of(order, 4, 0.6, np.zeros(1)).sample(points, speed)[1][0], speed)


def cost_of(twin, spec, qpos, weights):
    task = read_subtask(spec)
    cost = RunningCost(twin, spec, task, SAFETY, arm(), palm_at(twin, twin.q), weights)
    return float(cost.of(qpos[None, None], np.zeros((1, 1, 7)), np.zeros((1, 1), bool))[0])


@pytest.mark.parametrize(
    ("twin", "spec"),
    [
        (cubes, red_on_crate()),
        (cubes, only("set_obj_z_position", "red_cube", None, 0.25)),
        (fruit, only("minimize_l2_distance", "apple", "bowl")),
        (sliding, only("set_joint_fraction", "cabinet_door", value=1.0)),
        (cubes, only("minimize_l2_distance", "palm", "crate")),
        (cubes, only("maximize_l2_distance", "palm", "crate", 0.7)),
    ],
)
def test_the_cost_of_the_primary_term_is_at_least_what_the_goal_still_lacks(twin, spec):
    weights = CostWeights(secondary=0.0, hold=0.0, fingers=0.0, side_effects=0.0, smoothing=1e-6)
    twin = twin()
    paid = cost_of(twin, spec, twin.qpos, weights)
    data = twin.start()
    palm = palm_at(twin, twin.q)
    judged = judge_term(spec.primary, posed_objects(twin, data), palm, palm, fractions=twin.joint_fractions())
    left = judged.residual
    if spec.primary.kind == "set_joint_fraction":  # a share there, the way of the handle here
        assert paid > 0.1
    else:
        assert left - 1e-4 <= paid < left + 0.1  # a place has some extent, its middle none


def test_a_cube_on_its_place_and_a_joint_at_its_fraction_cost_nothing_more():
    weights = CostWeights(secondary=0.0, hold=0.0, fingers=0.0, side_effects=0.0)
    twin = cubes()
    address = int(twin.model.jnt_qposadr[twin.model.body_jntadr[twin.model.body("red_cube").id]])
    qpos = twin.qpos.copy()
    qpos[address : address + 3] = 0.50, 0.15, 0.085
    assert cost_of(twin, red_on_crate(), qpos, weights) == pytest.approx(0.0, abs=1e-3)
    door = cabinet()
    qpos = door.qpos.copy()
    joint = door.joint("cabinet_left_door")
    assert joint is not None
    qpos[door.model.joint(joint.name).qposadr[0]] = joint.position(0.3)
    assert cost_of(door, OPEN_DOOR, qpos, weights) == pytest.approx(0.0, abs=1e-6)


def test_the_handle_that_the_cost_pulls_at_is_where_the_simulator_has_it():
    twin = cabinet()
    joint = twin.joint("cabinet_left_door")
    assert joint is not None
    qpos = twin.qpos.copy()
    qpos[twin.model.joint(joint.name).qposadr[0]] = 0.8
    data = mujoco.MjData(twin.model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(twin.model, data)
    body = data.body(joint.body)
    handle = body.xpos + body.xmat.reshape(3, 3) @ joint.handle.centre
    weights = CostWeights(primary=0.0, fingers=0.0, side_effects=0.0, smoothing=1e-9)
    paid = cost_of(twin, OPEN_DOOR, qpos, weights)
    assert paid == pytest.approx(float(np.linalg.norm(data.site("tcp").xpos - handle)), abs=1e-6)


def test_what_a_spec_does_not_name_costs_when_it_is_displaced():
    twin = cubes()
    address = int(twin.model.jnt_qposadr[twin.model.body_jntadr[twin.model.body("yellow_cube").id]])
    qpos = twin.qpos.copy()
    qpos[address] += 0.05
    weights = CostWeights(smoothing=1e-9)
    spec = RewardSpec((RewardTerm("minimize_l2_distance", "palm", "crate", primary=True),))
    assert cost_of(twin, spec, qpos, weights) - cost_of(twin, spec, twin.qpos, weights) == pytest.approx(0.05, abs=1e-6)


def test_a_path_is_cut_where_closing_fingers_came_to_a_stop_and_where_they_opened():
    twin = cubes()
    dt = twin.model.opt.timestep
    arm_at = twin.q + np.linspace(0.0, 0.2, 251)[1:, None]
    closed = np.zeros(250, bool)
    closed[50:200] = True
    width = np.full(250, 0.08)
    width[50:150] = np.maximum(0.08 - 0.1 * dt * np.arange(1, 101), 0.05)  # stops after 75 steps
    width[150:200] = 0.05
    free, grasped = Contact(None, ()), Contact("red_cube", ("table",))
    cuts = [(0, 50, free), (50, 150, grasped), (150, 200, Contact("red_cube", ())), (200, 250, free)]
    pieces = [MotionPiece(arm_at[a:b], closed[a:b], width[a:b], contact) for a, b, contact in cuts]
    path = joint_path(twin, pieces, 0.08)
    assert [s.held for s in path.segments] == [None, "red_cube", "red_cube", None]
    commands = [s.gripper for s in path.segments]
    assert commands[0] is not None and commands[0].kind == "grasp"
    assert commands[0].width == pytest.approx(0.05, abs=0.002)
    assert commands[1:] == [None, GripperCommand("move", 0.08), None]
    assert [s.touching for s in path.segments] == [(), (("red_cube", "table"),), (), ()]
    for before, after in pairwise(path.segments):
        np.testing.assert_array_equal(before.q[-1], after.q[0])
