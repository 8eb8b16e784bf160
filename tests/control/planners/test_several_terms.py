"""Several terms at once: what one manipulation can do is one, the rest is done in turn, and nothing is dropped."""

import numpy as np
import pytest

from benchmarks.scenes.furniture_twins import cabinet, with_cube
from benchmarks.scenes.tabletop_twins import PALM_TO_CUBE, arm, blocked, cubes
from control.planners.motion_search import plan_motion
from control.planners.result import MotionPlan
from control.planners.several_terms import stages_of
from control.retiming.retime import retime
from control.robot.dynamics import RobotModel
from control.robot.limits import panda_limits
from control.safety.limits import SafetyLimits
from control.tasks.failure import FailureCause
from control.tasks.reward_spec import RewardSpec, RewardTerm
from sim_check.twin.payloads import held_payloads
from sim_check.verdict.verdict import judge_trajectory

SAFETY, LIMITS = SafetyLimits(), panda_limits()
LEFT = RewardTerm("set_joint_fraction", "cabinet_left_door", None, 0.9)
INTO = RewardTerm("minimize_l2_distance", "cube", "cabinet", primary=True)
ON_CRATE = RewardTerm("minimize_l2_distance", "red_cube", "crate", primary=True)


def plan(twin, *terms):
    return plan_motion(twin, RewardSpec(terms), SAFETY, np.random.default_rng(0), kinematics=arm(), nthread=1)


def verdict_on(found, twin, *terms):
    robot = RobotModel.panda()
    trajectory = retime(found.path, robot, LIMITS, SAFETY, payloads=held_payloads(twin))
    rng, spec = np.random.default_rng(0), RewardSpec(terms)
    return judge_trajectory(trajectory, twin, spec, SAFETY, LIMITS, rng, perturbed=0, nthread=1, robot=robot)


def test_a_door_is_opened_and_the_cube_put_inside_in_one_motion_that_passes_the_verdict():
    twin = with_cube(0.0, 0.9)
    found = plan(twin, LEFT, INTO)
    assert isinstance(found, MotionPlan), found
    assert "; then " in found.description
    assert found.end is not None and twin.joint_fractions(found.end)["cabinet_left_door"] == pytest.approx(
        0.9, abs=0.05
    )
    verdict = verdict_on(found, twin, LEFT, INTO)
    assert verdict.passed, verdict.failed_checks


def test_the_verdict_refuses_a_motion_that_meets_the_primary_term_alone_and_names_the_other():
    twin = with_cube(0.0, 0.9)
    found = plan(twin, INTO)
    assert isinstance(found, MotionPlan), found
    failed = {c.name: c for c in verdict_on(found, twin, LEFT, INTO).failed_checks}
    assert set(failed) == {"reward_met"} and failed["reward_met"].bodies == ("cabinet_left_door",)


def test_terms_that_hold_already_are_no_stages_but_have_to_last():
    stays = RewardTerm("set_joint_fraction", "cabinet_right_door", None, 0.9)
    stages = stages_of(RewardSpec((stays, LEFT, INTO)), with_cube(0.0, 0.9))
    assert isinstance(stages, list)
    assert [s.primary.subject for s in stages] == ["cabinet_left_door", "cube"]
    assert stays in stages[0].terms


def test_a_cube_is_put_down_turned_over_where_both_are_asked_for():
    turned = RewardTerm("set_obj_orientation", "red_cube", None, np.pi / 2)
    twin = cubes()
    found = plan(twin, turned, ON_CRATE)
    assert isinstance(found, MotionPlan), found
    assert verdict_on(found, twin, turned, ON_CRATE).passed


def test_a_place_meets_every_term_about_the_thing():
    away = RewardTerm("maximize_l2_distance", "yellow_cube", "crate", 0.2, primary=True)
    too = RewardTerm("maximize_l2_distance", "yellow_cube", "red_cube", 0.25)
    twin = blocked()
    found = plan(twin, too, away)
    assert isinstance(found, MotionPlan), found
    assert verdict_on(found, twin, too, away).passed


def test_a_term_about_the_palm_that_the_motion_does_not_come_by_is_named():
    elsewhere = RewardTerm("minimize_l2_distance", "palm", "yellow_cube")
    cause = plan(cubes(), elsewhere, ON_CRATE)
    assert isinstance(cause, FailureCause) and cause.kind == "no_candidate"
    assert "mm from yellow_cube" in cause.message


def test_a_stage_that_cannot_be_planned_is_named_by_its_term():
    high = RewardTerm("set_obj_z_position", "yellow_cube", None, 0.3)
    cause = plan(cubes(), PALM_TO_CUBE, high, ON_CRATE)
    assert isinstance(cause, FailureCause)
    assert cause.message.startswith("of 2 terms in turn, minimize_l2_distance(red_cube, crate): the hand holds")


def test_the_palm_at_a_handle_is_at_its_furniture():
    twin = cabinet()
    near = RewardTerm("minimize_l2_distance", "palm", "cabinet")
    assert isinstance(
        plan(twin, near, RewardTerm("set_joint_fraction", "cabinet_left_door", None, 0.5, primary=True)), MotionPlan
    )
