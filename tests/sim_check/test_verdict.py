"""A verdict passes what the search found and turns down what breaks a promise, naming check, bodies and time."""

from functools import cache

import numpy as np
import pytest

from benchmarks.scenes.tabletop_twins import arm, ball_in_bowl, cubes, hand_at, only, red_on_crate
from control.path_planning.rrt_connect import straight
from control.planners.motion_search import plan_motion
from control.planners.result import MotionPlan
from control.retiming.retime import retime
from control.robot.dynamics import RobotModel
from control.robot.limits import REST_Q, panda_limits
from control.safety.limits import SafetyLimits
from control.trajectory.samples import JointPath, PathSegment, Trajectory
from sim_check.twin.payloads import held_payloads
from sim_check.verdict.verdict import judge_trajectory, wilson_interval

SAFETY, LIMITS = SafetyLimits(), panda_limits()


@cache
def robot():
    return RobotModel.panda()


@cache
def placing() -> Trajectory:
    plan = plan_motion(cubes(), red_on_crate(), SAFETY, np.random.default_rng(0), kinematics=arm(), nthread=1)
    assert isinstance(plan, MotionPlan)
    return retime(plan.path, robot(), LIMITS, SAFETY, payloads=held_payloads(cubes()))


def judge(trajectory, spec, perturbed=0, seed=0, nthread=1):
    return judge_trajectory(
        trajectory,
        cubes(),
        spec,
        SAFETY,
        LIMITS,
        np.random.default_rng(seed),
        perturbed=perturbed,
        nthread=nthread,
        robot=robot(),
    )


def test_a_motion_from_the_search_passes_with_every_check_listed_once():
    verdict = judge(placing(), red_on_crate(), perturbed=3)
    assert verdict.passed and verdict.failed_checks == ()
    assert (verdict.successes, verdict.trials) == (3, 3) and verdict.interval == pytest.approx((0.4385, 1.0), abs=1e-3)
    names = [c.name for c in verdict.checks]
    assert len(names) == len(set(names))
    assert {
        "joint_velocity",
        "torque_rate",
        "hand_speed",
        "start_state",
        "unwanted_contact",
        "moved",
        "settled",
    } <= set(names)
    assert {"arm_clearance", "held_clearance", "held_kept", "released", "reward_met"} <= set(names)
    assert verdict.steps > 3000


def test_taking_a_ball_out_from_between_close_walls_keeps_every_clearance_while_it_is_played():
    spec, twin = only("maximize_l2_distance", "ball", "bowl", 0.2), ball_in_bowl()
    plan = plan_motion(twin, spec, SAFETY, np.random.default_rng(0), kinematics=arm(), nthread=1)
    assert isinstance(plan, MotionPlan)
    trajectory = retime(plan.path, robot(), LIMITS, SAFETY, payloads=held_payloads(twin))
    rng = np.random.default_rng(0)
    verdict = judge_trajectory(trajectory, twin, spec, SAFETY, LIMITS, rng, perturbed=2, nthread=1, robot=robot())
    assert verdict.passed and verdict.failed_checks == () and verdict.successes == 2


def test_the_verdict_does_not_depend_on_the_number_of_threads():
    assert judge(placing(), red_on_crate(), 2, 5, nthread=1) == judge(placing(), red_on_crate(), 2, 5, nthread=2)


def test_a_hand_that_sweeps_through_a_neighbour_is_turned_down_and_the_neighbour_named():
    beside, beyond = hand_at(0.58, -0.20, 0.04), hand_at(0.58, 0.05, 0.04)
    above, over = hand_at(0.58, -0.20, 0.20), hand_at(0.58, 0.05, 0.20)
    ways = [straight(a, b) for a, b in [(np.array(REST_Q), above), (above, beside), (beside, beyond), (beyond, over)]]
    ways.append(straight(over, np.array(REST_Q)))
    path = JointPath(tuple(PathSegment(f"part{i}", q) for i, q in enumerate(ways)))
    verdict = judge(retime(path, robot(), LIMITS, SAFETY), only("minimize_l2_distance", "palm", "rest_position"))
    failed = {c.name: c for c in verdict.failed_checks}
    assert not verdict.passed and {"moved", "unwanted_contact"} <= set(failed)
    assert failed["moved"].bodies == ("yellow_cube",) and failed["moved"].worst > 0.05
    assert "yellow_cube" in failed["unwanted_contact"].bodies and (failed["unwanted_contact"].at or 0.0) > 0.5


def test_a_hand_that_only_passes_too_near_is_turned_down_by_clearance_alone():
    # One open finger comes down over the cube. Fingertips end 9.5 mm below the tool centre point: 2.5 mm above
    # the cube's top, where 2 mm are asked for; the servos of the twin overshoot the stop by up to 2 mm more.
    above, low = hand_at(0.58, -0.003, 0.20), hand_at(0.58, -0.003, 0.062)
    ways = [
        straight(a, b) for a, b in [(np.array(REST_Q), above), (above, low), (low, above), (above, np.array(REST_Q))]
    ]
    path = JointPath(tuple(PathSegment(f"part{i}", q) for i, q in enumerate(ways)))
    verdict = judge(retime(path, robot(), LIMITS, SAFETY), only("minimize_l2_distance", "palm", "rest_position"))
    assert not verdict.passed and [c.name for c in verdict.failed_checks] == ["finger_clearance"]
    assert 0.0005 < verdict.failed_checks[0].worst < 0.002
    assert verdict.failed_checks[0].bodies == ("panda_hand", "yellow_cube")


def test_a_motion_that_leaves_the_cube_where_it_is_misses_the_reward():
    path = JointPath((PathSegment("home", straight(np.array(REST_Q), np.array(REST_Q) + 0.05)),))
    verdict = judge(retime(path, robot(), LIMITS, SAFETY), red_on_crate(), perturbed=1)
    assert not verdict.passed and [c.name for c in verdict.failed_checks] == ["reward_met"]
    assert (verdict.successes, verdict.trials) == (0, 1)


def test_a_motion_that_does_not_let_go_is_turned_down():
    whole = placing()
    kept = Trajectory(whole.q, whole.qd, whole.qdd, whole.gripper[:1], whole.segments, whole.joint_names)
    assert "released" in {c.name for c in judge(kept, red_on_crate()).failed_checks}


def test_a_trajectory_that_starts_elsewhere_is_turned_down():
    path = JointPath((PathSegment("home", straight(np.array(REST_Q) + 0.02, np.array(REST_Q))),))
    verdict = judge(retime(path, robot(), LIMITS, SAFETY), only("minimize_l2_distance", "palm", "rest_position"))
    failed = {c.name: c for c in verdict.failed_checks}
    assert set(failed) == {"start_state"} and failed["start_state"].worst == pytest.approx(0.02)


@pytest.mark.parametrize(
    "successes, trials, low, high", [(0, 0, 0.0, 1.0), (6, 6, 0.6097, 1.0), (4, 6, 0.3000, 0.9032), (0, 6, 0.0, 0.3903)]
)
def test_wilson_intervals_are_the_published_ones(successes, trials, low, high):
    assert wilson_interval(successes, trials) == pytest.approx((low, high), abs=1e-4)
