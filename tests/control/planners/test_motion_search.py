"""Motions are found for each kind of subtask, the same every time, and refusals say why."""

from dataclasses import replace
from itertools import pairwise

import mujoco
import numpy as np
import pytest

from benchmarks.scenes.estimates import estimate
from benchmarks.scenes.tabletop_twins import (
    CRATE,
    CUBE,
    arm,
    ball_in_bowl,
    blocked,
    cubes,
    fruit,
    hand_at,
    only,
    red_on_crate,
    twin_of,
)
from control.grasping.grasps import BETWEEN_WALLS, STEEPEST_HOLD, grasps
from control.path_planning.collision_filter import CollisionFilter, Phase
from control.path_planning.planning_context import PlanningContext
from control.path_planning.rrt_connect import free_path, rrt_connect
from control.planners.candidates import candidates
from control.planners.motion_search import plan_motion
from control.planners.refinement import vary
from control.planners.result import MotionPlan
from control.robot.gripper import PANDA_HAND
from control.robot.limits import REST_Q, panda_limits
from control.safety.limits import SafetyLimits
from control.simulation.rollouts import commands_for, roll_out
from control.tasks.failure import FailureCause
from control.tasks.subtasks import posed_objects, read_subtask
from sim_check.twin.twin import perturbed_twin

SAFETY = SafetyLimits()


def search(twin, spec, seed=0, nthread=1):
    return plan_motion(twin, spec, SAFETY, np.random.default_rng(seed), kinematics=arm(), nthread=nthread)


def final_positions(twin, plan):
    """Where everything is after the plan's path was simulated."""
    rollouts, _ = roll_out([twin], [commands_for(plan.path.segments, twin, panda_limits())], 1)
    data = mujoco.MjData(twin.model)
    data.qpos[:] = rollouts[0].qpos[-1]
    mujoco.mj_kinematics(twin.model, data)
    return {o.name: data.body(o.name).xpos.copy() for o in twin.objects} | {"palm": data.site("tcp").xpos.copy()}


def test_a_cube_is_put_on_the_crate_and_the_arm_comes_home():
    plan = search(cubes(), red_on_crate())
    assert isinstance(plan, MotionPlan)
    ends = final_positions(cubes(), plan)
    assert np.linalg.norm(ends["red_cube"] - [0.50, 0.15, 0.085]) < 0.012
    names = [s.name for s in plan.path.segments]
    assert names == ["reach", "approach", "lift", "carry", "lower", "retreat", "home"]
    np.testing.assert_allclose(plan.path.segments[0].q[0], cubes().q)
    np.testing.assert_allclose(plan.path.segments[-1].q[-1], REST_Q)
    for before, after in pairwise(plan.path.segments):
        np.testing.assert_allclose(before.q[-1], after.q[0], atol=1e-9)
    assert [s.gripper.kind for s in plan.path.segments if s.gripper] == ["grasp", "move"]
    assert plan.stats.steps < 15000 and plan.stats.counts["clean"] >= 1


def test_the_same_seed_gives_the_same_plan_with_one_and_with_two_threads():
    one, two = search(cubes(), red_on_crate(), 3, nthread=1), search(cubes(), red_on_crate(), 3, nthread=2)
    assert isinstance(one, MotionPlan) and isinstance(two, MotionPlan)
    assert one.cost == two.cost and one.stats.steps == two.stats.steps
    for a, b in zip(one.path.segments, two.path.segments, strict=True):
        np.testing.assert_array_equal(a.q, b.q)


def test_an_apple_is_put_in_the_bowl():
    plan = search(fruit(), only("minimize_l2_distance", "apple", "bowl"))
    assert isinstance(plan, MotionPlan)
    apple, bowl = (final_positions(fruit(), plan)[n] for n in ("apple", "bowl"))
    assert np.linalg.norm(apple[:2] - bowl[:2]) < 0.04 and apple[2] < 0.06


def test_a_cube_on_the_crate_is_moved_away_from_it_onto_free_table():
    plan = search(blocked(), only("maximize_l2_distance", "yellow_cube", "crate", 0.2))
    assert isinstance(plan, MotionPlan)
    ends = final_positions(blocked(), plan)
    assert np.linalg.norm(ends["yellow_cube"][:2] - ends["crate"][:2]) > 0.19
    assert ends["yellow_cube"][2] == pytest.approx(0.025, abs=0.003)


def test_a_lifted_cube_stays_in_the_hand_at_the_height_asked_for():
    plan = search(cubes(), only("set_obj_z_position", "red_cube", None, 0.25))
    assert isinstance(plan, MotionPlan)
    ends = final_positions(cubes(), plan)
    assert ends["red_cube"][2] > 0.24 and np.linalg.norm(ends["red_cube"] - ends["palm"]) < 0.03
    assert plan.path.segments[-1].held == "red_cube" and plan.path.segments[-1].gripper is None


def test_the_palm_reaches_an_object_wider_than_the_gripper_without_touching_it():
    plan = search(cubes(), only("minimize_l2_distance", "palm", "crate"))
    assert isinstance(plan, MotionPlan)
    ends = final_positions(cubes(), plan)
    np.testing.assert_allclose(ends["crate"], [0.50, 0.15, 0.03], atol=0.001)
    assert 0.06 < ends["palm"][2] < 0.15


def test_what_is_met_already_takes_no_simulation():
    plan = search(cubes(), only("maximize_l2_distance", "red_cube", "crate", 0.15))
    assert isinstance(plan, MotionPlan) and plan.stats.steps == 0
    assert plan.description.startswith("met already: red_cube is")


def test_an_occupied_crate_is_reported_with_counts_and_with_what_was_too_close():
    cause = search(blocked(), red_on_crate())
    assert isinstance(cause, FailureCause) and cause.kind == "no_candidate"
    assert "cannot be put there" in cause.message and "'yellow_cube'" in cause.message
    assert cause.evidence["counts"]["places_reachable"] > 0 and cause.evidence["counts"].get("places_free", 0) == 0


def test_something_out_of_reach_is_said_to_be_so():
    twin = twin_of(estimate("red_cube", (1.1, 0.2, 0.025), CUBE), estimate("crate", (0.5, 0.0, 0.03), CRATE))
    cause = search(twin, red_on_crate())
    assert isinstance(cause, FailureCause) and cause.kind == "no_candidate"
    assert "'red_cube' is out of reach: it is 1.12 m away from the base" in cause.message


def test_something_too_wide_for_the_gripper_is_refused_with_its_width():
    cause = search(cubes(), only("minimize_l2_distance", "crate", "red_cube"))
    assert isinstance(cause, FailureCause) and cause.kind == "no_candidate"
    assert "its smallest width is 110 mm, the fingers take 76 mm" in cause.message


def test_a_name_without_a_pose_is_not_seen():
    cause = search(cubes(), only("minimize_l2_distance", "green_cube", "crate"))
    assert isinstance(cause, FailureCause) and (cause.kind, cause.subject) == ("not_seen", "green_cube")
    assert "seen were ['crate', 'red_cube', 'yellow_cube']" in cause.message


def test_a_full_hand_is_asked_to_put_down_what_it_holds():
    cause = search(replace(cubes(), held="yellow_cube"), red_on_crate())
    assert isinstance(cause, FailureCause)
    assert cause.message == "the hand holds 'yellow_cube'; put it down before 'red_cube' can be handled"


def test_no_grasp_is_wider_than_the_hand_or_below_the_table():
    objects = posed_objects(fruit(), fruit().start())
    offered = grasps(objects["apple"], SAFETY, 0.0)
    assert len(offered) > 50 and grasps(objects["bowl"], SAFETY, 0.0) == []
    for grasp in offered:
        assert grasp.width <= PANDA_HAND.widest(SAFETY.finger_clearance)
        assert grasp.world_T_tcp[2, 3] > 0.01 and grasp.approach[2] < -0.4
        rotation = grasp.world_T_tcp[:3, :3]
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)


def test_a_ball_between_the_close_walls_of_a_bowl_is_taken_out_within_the_clearances_of_the_safety_table():
    twin = ball_in_bowl()
    plan = search(twin, only("maximize_l2_distance", "ball", "bowl", 0.2))
    assert isinstance(plan, MotionPlan) and plan.stats.counts["looks_between_walls"] >= 1
    ends = final_positions(twin, plan)
    assert np.linalg.norm(ends["ball"][:2] - ends["bowl"][:2]) > 0.19
    assert ends["ball"][2] == pytest.approx(0.0285, abs=0.003)
    np.testing.assert_allclose(ends["bowl"][:2], [0.50, 0.05], atol=0.002)
    reach, approach = plan.path.segments[:2]
    opening = reach.gripper.width if reach.gripper else PANDA_HAND.opening
    assert opening >= 0.057 + 2 * SAFETY.finger_clearance
    judge = CollisionFilter(twin, SAFETY, "ball", ["bowl"], margin=0.0)
    assert judge.path_clear(approach.q, Phase.GRASP, opening)


@pytest.mark.parametrize(
    ("diameter", "aside", "finger_clearance"), [(0.03, 0.02, SAFETY.finger_clearance), (0.057, 0.012, 0.010)]
)
def test_a_ball_is_refused_and_its_bowl_named_where_walls_or_the_safety_table_leave_fingers_no_room(
    diameter, aside, finger_clearance
):
    safety = SafetyLimits(finger_clearance=finger_clearance)
    away = only("maximize_l2_distance", "ball", "bowl", 0.2)
    twin = ball_in_bowl(diameter, aside)
    cause = plan_motion(twin, away, safety, np.random.default_rng(0), kinematics=arm(), nthread=1)
    assert isinstance(cause, FailureCause) and cause.kind == "no_candidate"
    assert "'ball' cannot be taken: all " in cause.message and "too close to 'bowl'" in cause.message


def test_where_there_is_room_nobody_looks_for_ways_between_walls():
    plan = search(fruit(), only("set_obj_z_position", "apple", None, 0.2))
    assert isinstance(plan, MotionPlan) and "looks_between_walls" not in plan.stats.counts


def test_higher_holds_of_a_round_thing_stay_where_friction_holds_it():
    ball = posed_objects(fruit(), fruit().start())["apple"]
    usual, more = grasps(ball, SAFETY, 0.0), grasps(ball, SAFETY, 0.0, BETWEEN_WALLS)
    assert len(more) > 3 * len(usual)
    raised = [-float((g.world_T_tcp[:3, 3] - ball.position) @ g.approach) for g in more]
    radius = ball.extents[0] / 2
    edge = max(raised) - PANDA_HAND.fingertip  # of the pads, above the ball's middle
    assert 0.003 < edge <= radius * np.sin(STEEPEST_HOLD) + 1e-9


def test_the_filter_keeps_the_hand_off_the_table_and_names_what_is_too_close():
    look = CollisionFilter(cubes(), SAFETY)
    assert look.clear(np.array(REST_Q), Phase.FREE, 0.08)
    assert look.clear(hand_at(0.4, 0.35, 0.03), Phase.FREE, 0.08)
    assert not look.clear(hand_at(0.4, 0.35, 0.012), Phase.FREE, 0.08)
    assert look.rejected_by.most_common(1)[0][0] == "table"


def test_a_planner_finds_a_way_around_where_the_straight_one_is_obstructed():
    limits, rng = panda_limits(), np.random.default_rng(0)
    start, end = np.array(REST_Q), np.array(REST_Q)
    start[0], end[0] = -0.6, 0.6

    def clear(q):  # a wall across joint 1 with a gap where joint 2 is lifted
        return abs(q[0]) > 0.2 or q[1] < -1.2

    assert free_path(start, end, clear, []) is None
    path = rrt_connect(start, end, clear, limits, rng)
    assert path is not None and all(clear(q) for q in path)
    np.testing.assert_array_equal(path[[0, -1]], [start, end])
    assert np.abs(np.diff(path, axis=0)).max() < 0.06
    assert rrt_connect(start, end, lambda q: abs(q[0]) > 0.2, limits, rng, budget=500) is None


def test_variants_of_a_motion_stay_in_one_piece_and_start_where_the_arm_is():
    spec = red_on_crate()
    context = PlanningContext(cubes(), read_subtask(spec), SAFETY, panda_limits(), arm(), np.random.default_rng(0))
    first = next(candidates(context))
    varied = vary(context, [first], 4)
    assert len(varied) == 4
    for variant in varied:
        np.testing.assert_allclose(variant.segments[0].q[0], cubes().q, atol=1e-9)
        np.testing.assert_allclose(variant.segments[-1].q[-1], REST_Q, atol=1e-9)
        for before, after in pairwise(variant.segments):
            np.testing.assert_allclose(before.q[-1], after.q[0], atol=1e-9)
        grasped, was = (arm().poses(c.segments[1].q[-1:])[0, :3, 3] for c in (variant, first))
        assert 0.0005 < np.linalg.norm(grasped - was) < 0.04


def test_with_perturbed_twins_the_motion_that_succeeds_in_most_of_them_is_chosen():
    variants = [perturbed_twin(cubes(), np.random.default_rng(i)) for i in range(2)]
    rng = np.random.default_rng(0)
    plan = plan_motion(cubes(), red_on_crate(), SAFETY, rng, kinematics=arm(), nthread=1, variants=variants)
    plain = search(cubes(), red_on_crate())
    assert isinstance(plan, MotionPlan) and isinstance(plain, MotionPlan)
    assert plan.stats.steps > plain.stats.steps  # the variants were simulated
    assert len(plan.alternatives) == len(plain.alternatives)
