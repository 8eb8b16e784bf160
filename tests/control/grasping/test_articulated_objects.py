"""Doors, sliding doors and levers are moved by their handles: cleanly, as far as asked, and nothing else moves."""

from functools import cache

import numpy as np
import pytest

from benchmarks.scenes.estimates import estimate
from benchmarks.scenes.furniture_twins import CABINET, cabinet, furnished, lever, sliding
from benchmarks.scenes.tabletop_twins import arm, only
from control.grasping.articulation import JointMotion
from control.grasping.handle_grasps import handle_grasps
from control.path_planning.collision_filter import CollisionFilter, JointAt, Phase
from control.planners.motion_search import plan_motion
from control.planners.result import MotionPlan
from control.retiming.retime import retime
from control.robot.dynamics import RobotModel
from control.robot.limits import REST_Q, panda_limits
from control.safety.limits import SafetyLimits
from control.tasks.failure import FailureCause
from control.tasks.reward_spec import RewardSpec, RewardTerm
from control.twin_model import FINGER_JOINTS, TwinModel
from sim_check.twin.payloads import held_payloads
from sim_check.verdict.replay import replay
from sim_check.verdict.verdict import judge_trajectory

SAFETY, LIMITS = SafetyLimits(), panda_limits()


def asked(joint: str, fraction: float) -> RewardSpec:
    return only("set_joint_fraction", joint, value=fraction)


def plan(twin: TwinModel, spec: RewardSpec, seed: int = 0) -> MotionPlan | FailureCause:
    return plan_motion(twin, spec, SAFETY, np.random.default_rng(seed), kinematics=arm(), nthread=1)


@cache
def robot() -> RobotModel:
    return RobotModel.panda()


def judge(found: MotionPlan, twin: TwinModel, spec: RewardSpec, perturbed: int = 0):
    trajectory = retime(found.path, robot(), LIMITS, SAFETY, payloads=held_payloads(twin))
    rng = np.random.default_rng(0)
    return judge_trajectory(
        trajectory, twin, spec, SAFETY, LIMITS, rng, perturbed=perturbed, nthread=1, robot=robot(), success_share=1.0
    )


@pytest.mark.parametrize(
    "twin, joint, fraction",
    [
        (lambda: cabinet(), "cabinet_left_door", 0.6),
        (lambda: cabinet(0.63, 0.02, right=0.7), "cabinet_right_door", 0.0),
        (lambda: sliding(), "cabinet_door", 1.0),
        (lambda: lever(), "lever_rod", 1.0),
        (lambda: lever(opened=1.0), "lever_rod", 0.0),
    ],
)
def test_a_joint_is_driven_to_its_fraction_cleanly_and_the_verdict_agrees(twin, joint, fraction):
    spec = asked(joint, fraction)
    found = plan(twin(), spec)
    assert isinstance(found, MotionPlan), found
    assert found.stats.counts["clean"] >= 1
    assert np.allclose(found.path.segments[-1].q[-1], REST_Q)
    verdict = judge(found, twin(), spec)
    assert verdict.passed, verdict.failed_checks


def test_a_door_that_one_hold_cannot_open_all_the_way_is_taken_twice():
    twin = cabinet(0.62, 0.05, yaw=0.15)
    found = plan(twin, asked("cabinet_right_door", 1.0))
    assert isinstance(found, MotionPlan), found
    assert [s.name for s in found.path.segments].count("drive") == 2
    assert judge(found, twin, asked("cabinet_right_door", 1.0)).passed


def test_a_door_that_no_two_holds_open_all_the_way_is_a_cause_that_says_how_far_it_goes():
    twin = cabinet(0.74, 0.0, yaw=0.15)
    cause = plan(twin, asked("cabinet_right_door", 1.0))
    assert isinstance(cause, FailureCause)
    assert cause.message == (
        "cabinet_right_door can be driven to 81% at most: no hold of its handle, nor two one after the other, takes it "
        "further; ask for less"
    )
    assert cause.evidence["driven_to"] == pytest.approx(0.81, abs=0.005)
    assert isinstance(plan(twin, asked("cabinet_right_door", 0.81)), MotionPlan)


@pytest.mark.parametrize("yaw", [0.0, -0.3, 0.4])
def test_a_lever_does_not_pry_the_fingers_apart_and_they_open_at_once(yaw):
    twin = lever(yaw=yaw)
    found = plan(twin, asked("lever_rod", 1.0))
    assert isinstance(found, MotionPlan), found
    trajectory = retime(found.path, robot(), LIMITS, SAFETY, payloads=held_payloads(twin))
    (rollout,), _ = replay(trajectory, [twin], 0.5, nthread=1)
    fingers = [int(twin.model.joint(name).qposadr[0]) for name in FINGER_JOINTS]
    width = rollout.qpos[:, fingers].sum(axis=1)
    grasp, release = (event for event in trajectory.gripper[-2:])
    gripped = float(np.interp(release.time - 0.02, rollout.time, width))
    assert gripped < grasp.command.width + 0.004
    assert float(np.interp(release.time + 0.5, rollout.time, width)) == pytest.approx(release.command.width, abs=0.002)


def test_a_door_that_was_opened_stays_open_while_the_other_one_is_opened():
    twin, spec = cabinet(right=0.9), asked("cabinet_left_door", 0.7)
    found = plan(twin, spec)
    assert isinstance(found, MotionPlan), found
    rollouts, _ = replay(
        retime(found.path, robot(), LIMITS, SAFETY, payloads=held_payloads(twin)), [twin], 0.5, nthread=1
    )
    fractions = twin.joint_fractions(rollouts[0].qpos[-1])
    assert fractions["cabinet_right_door"] == pytest.approx(0.9, abs=0.01)
    assert fractions["cabinet_left_door"] == pytest.approx(0.7, abs=0.05)


def test_a_motion_that_is_good_in_the_twin_is_good_in_perturbed_ones():
    spec = asked("cabinet_door", 0.9)
    found = plan(sliding(), spec)
    assert isinstance(found, MotionPlan), found
    verdict = judge(found, sliding(), spec, perturbed=3)
    assert (verdict.passed, verdict.successes, verdict.trials) == (True, 3, 3)


def test_a_door_left_half_way_fails_the_verdict_on_the_reward_alone():
    found = plan(cabinet(), asked("cabinet_left_door", 0.4))
    assert isinstance(found, MotionPlan), found
    verdict = judge(found, cabinet(), asked("cabinet_left_door", 0.7))
    failed = {c.name: c for c in verdict.failed_checks}
    assert set(failed) == {"reward_met"}
    assert failed["reward_met"].worst == pytest.approx(0.25, abs=0.03)


def test_driving_a_joint_that_the_spec_does_not_name_is_a_side_effect():
    found = plan(cabinet(), asked("cabinet_left_door", 0.4))
    assert isinstance(found, MotionPlan), found
    verdict = judge(found, cabinet(), only("minimize_l2_distance", "palm", "rest_position"))
    caught = {c.name: c for c in verdict.failed_checks}
    assert caught["joint_moved"].bodies == ("cabinet_left_door",)
    assert caught["joint_moved"].worst > 0.1


def test_a_joint_that_stands_where_it_should_asks_for_no_drive():
    found = plan(cabinet(), asked("cabinet_left_door", 0.0))
    assert isinstance(found, MotionPlan) and found.stats.steps == 0
    assert found.description.startswith("met already: cabinet_left_door is 0% open")


def test_a_joint_that_does_not_exist_is_a_cause_that_lists_those_that_do():
    failure = plan(cabinet(), asked("cabinet_drawer", 1.0))
    assert isinstance(failure, FailureCause) and failure.kind == "not_seen"
    assert "seen were ['cabinet_left_door', 'cabinet_right_door']" in failure.message


def test_a_secondary_term_about_a_joint_shapes_the_cost_and_does_not_break_the_search():
    reach = RewardTerm("set_joint_fraction", "cabinet_right_door", None, 0.0)
    spec = RewardSpec((reach, RewardTerm("set_joint_fraction", "cabinet_left_door", None, 0.5, primary=True)))
    assert isinstance(plan(cabinet(), spec), MotionPlan)


def test_out_of_reach_handles_are_told_within_the_geometry():
    failure = plan(cabinet(1.2), asked("cabinet_left_door", 0.5))
    assert isinstance(failure, FailureCause) and failure.kind == "no_candidate"
    assert "out of reach" in failure.message and failure.evidence["steps"] == 0


def test_a_tool_is_carried_as_the_simulated_door_moves():
    twin = cabinet()
    joint = twin.joint("cabinet_left_door")
    assert joint is not None
    start, end = JointMotion.of(twin, joint), JointMotion.of(twin, joint, 1.2)
    assert np.allclose(start.carried(start.world_T_body, 1.2), end.world_T_body, atol=1e-9)
    half = start.carried(start.world_T_body, 1.2, share=0.5)
    assert np.allclose(half[:3, 3], end.world_T_body[:3, 3], atol=1e-9)
    assert np.allclose(half[:3, :3] @ start.world_T_body[:3, :3].T @ half[:3, :3], end.world_T_body[:3, :3], atol=1e-9)


def test_pads_close_across_the_bar_from_its_outward_side():
    twin = cabinet()
    joint = twin.joint("cabinet_left_door")
    assert joint is not None
    offered = handle_grasps(joint.handle, JointMotion.of(twin, joint).world_T_body)
    closing = np.array([g.world_T_tcp[:3, 1] for g in offered])
    approach = np.array([g.world_T_tcp[:3, 2] for g in offered])
    assert np.abs(closing[:, 2]).max() < 1e-9  # the bar is upright
    assert (approach[:, 0] > 0).all()  # and stands off towards the robot


def test_the_filter_sees_what_the_swinging_door_would_hit():
    post = estimate("post", (0.50, 0.18, 0.20), (0.05, 0.05, 0.40))
    twin = furnished("cabinet", CABINET, 0.62, 0.0, 0.0, {}, post)
    look = CollisionFilter(twin, SAFETY, "cabinet_left_door")
    rest = np.array(REST_Q)
    assert look.clear(rest, Phase.ARTICULATE, 0.08, JointAt(0.0))
    assert not look.clear(rest, Phase.ARTICULATE, 0.08, JointAt(0.6))
    assert look.rejected_by["post"] == 1
