"""Things leave what holds them: lifted where that is free, else sideways or through an opening; by a handle; rolled."""

from functools import cache

import mujoco
import numpy as np
import pytest

from benchmarks.scenes.estimates import estimate
from benchmarks.scenes.furniture_twins import CABINET, barred, furnished
from benchmarks.scenes.tabletop_twins import arm, cubes, only, twin_of
from control.grasping.retreat import ways_out
from control.path_planning.planning_context import PlanningContext
from control.planners.motion_search import plan_motion
from control.planners.result import MotionPlan
from control.retiming.retime import retime
from control.robot.dynamics import RobotModel
from control.robot.limits import panda_limits
from control.safety.limits import SafetyLimits
from control.tasks.failure import FailureCause
from control.tasks.reward_spec import RewardSpec
from control.tasks.subtasks import posed_objects, read_subtask
from control.twin_model import TwinModel
from sim_check.twin.payloads import held_payloads
from sim_check.verdict.verdict import judge_trajectory

SAFETY, LIMITS = SafetyLimits(), panda_limits()


@cache
def robot() -> RobotModel:
    return RobotModel.panda()


def plan(twin: TwinModel, spec: RewardSpec) -> MotionPlan | FailureCause:
    return plan_motion(twin, spec, SAFETY, np.random.default_rng(0), kinematics=arm(), nthread=1)


def passes(twin: TwinModel, spec: RewardSpec) -> MotionPlan:
    """A plan whose retimed motion the verdict lets pass in the nominal twin."""
    found = plan(twin, spec)
    assert isinstance(found, MotionPlan), found
    trajectory = retime(found.path, robot(), LIMITS, SAFETY, payloads=held_payloads(twin))
    rng = np.random.default_rng(0)
    verdict = judge_trajectory(trajectory, twin, spec, SAFETY, LIMITS, rng, perturbed=0, nthread=1, robot=robot())
    assert verdict.passed, verdict.failed_checks
    return found


def context(twin: TwinModel, spec: RewardSpec) -> PlanningContext:
    return PlanningContext(twin, read_subtask(spec), SAFETY, LIMITS, arm(), np.random.default_rng(0), spec=spec)


def test_what_stands_free_is_lifted_and_nothing_else_is_tried():
    (way,) = ways_out(context(cubes(), only("minimize_l2_distance", "red_cube", "crate")))
    assert way.moves.tolist() == [[0.0, 0.0, 0.06]]


def test_a_bar_behind_two_handles_slides_out_along_itself_though_it_could_be_lifted_a_little():
    ways = ways_out(context(barred(), only("maximize_l2_distance", "bar", "cabinet", 0.5)))
    assert len(ways) == 2
    for way in ways:
        assert way.moves[0] == pytest.approx([0.0, 0.0, 0.005])
        assert abs(way.moves[1][1]) > 0.18 and np.abs(way.moves[1][[0, 2]]).max() < 1e-6
    assert np.sign(ways[0].moves[1][1]) != np.sign(ways[1].moves[1][1])


def test_a_cube_in_an_open_cabinet_comes_out_through_the_opening():
    cube = estimate("cube", (0.72, 0.05, 0.195), (0.05, 0.05, 0.05))
    doors = {"cabinet_left_door": 1.0, "cabinet_right_door": 1.0}
    twin = furnished("cabinet", CABINET, 0.62, 0.0, 0.0, doors, cube)
    (way,) = ways_out(context(twin, only("set_obj_z_position", "cube", None, 0.4)))
    assert way.moves[1][0] == pytest.approx(-(0.72 - 0.62 + 0.12), abs=2e-3)


def test_a_bar_is_taken_out_from_behind_handles_and_laid_on_the_table_cleanly_and_the_doors_stay_shut():
    twin, spec = barred(), only("maximize_l2_distance", "bar", "cabinet", 0.5)
    found = passes(twin, spec)
    assert found.end is not None
    assert max(twin.joint_fractions(found.end).values()) < 0.01


def test_a_kettle_is_taken_by_its_handle():
    twin = twin_of(
        estimate("kettle", (0.46, 0.12, 0.10), (0.13, 0.10, 0.20), yaw=0.3),
        estimate("crate", (0.55, 0.25, 0.03), (0.11, 0.11, 0.06)),
    )
    found = passes(twin, only("maximize_l2_distance", "kettle", "crate", 0.35))
    assert "width 18 mm" in found.description


@pytest.mark.parametrize("angle", [np.pi / 2, -np.pi / 2])
def test_a_cube_is_turned_over_either_way(angle):
    twin = cubes()
    found = passes(twin, only("set_obj_orientation", "red_cube", None, angle))
    assert found.end is not None
    data = twin.start()
    before = posed_objects(twin, data)["red_cube"].pose[:3, :3]
    data.qpos[:] = found.end
    mujoco.mj_kinematics(twin.model, data)
    after = posed_objects(twin, data)["red_cube"].pose[:3, :3]
    # What was up is now level, along the object's own y axis.
    up = after.T @ np.array([0.0, 0.0, 1.0])
    assert up == pytest.approx([0.0, np.sin(angle) * before[2, 2], 0.0], abs=0.05)
