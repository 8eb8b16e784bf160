"""Things go into furniture through its open doors: judged, planned, and refused by name while it is closed."""

import numpy as np
import pytest

from benchmarks.scenes.furniture_twins import with_cube
from benchmarks.scenes.tabletop_twins import arm, only
from control.grasping.placements import on_or_in
from control.planners.motion_search import plan_motion
from control.planners.result import MotionPlan
from control.retiming.retime import retime
from control.robot.dynamics import RobotModel
from control.robot.limits import panda_limits
from control.safety.limits import SafetyLimits
from control.tasks.failure import FailureCause
from control.tasks.posed_object import Inside, PosedObject
from control.tasks.predicates import judge_term
from control.tasks.reward_spec import RewardTerm
from control.tasks.subtasks import posed_objects
from sim_check.twin.payloads import held_payloads
from sim_check.verdict.verdict import judge_trajectory

SAFETY, LIMITS = SafetyLimits(), panda_limits()
INTO = only("minimize_l2_distance", "cube", "cabinet")


def plan(twin, spec=INTO):
    return plan_motion(twin, spec, SAFETY, np.random.default_rng(0), kinematics=arm(), nthread=1)


@pytest.mark.parametrize("left, right", [(1.0, 1.0), (0.9, 0.0)])
def test_a_cube_goes_in_through_open_doors_and_the_doors_stay_open(left, right):
    twin = with_cube(left, right)
    found = plan(twin)
    assert isinstance(found, MotionPlan), found
    robot = RobotModel.panda()
    trajectory = retime(found.path, robot, LIMITS, SAFETY, payloads=held_payloads(twin))
    rng = np.random.default_rng(0)
    verdict = judge_trajectory(trajectory, twin, INTO, SAFETY, LIMITS, rng, perturbed=0, nthread=1, robot=robot)
    assert verdict.passed, verdict.failed_checks
    assert next(c for c in verdict.checks if c.name == "joint_moved").worst < 0.005


def test_a_closed_cabinet_is_a_cause_that_names_its_doors():
    failure = plan(with_cube(0.0, 0.1))
    assert isinstance(failure, FailureCause) and failure.kind == "blocked_by"
    assert failure.bodies == ("cabinet_left_door", "cabinet_right_door")
    assert "open 'cabinet_left_door' or 'cabinet_right_door' before 'cube' can go in" in failure.message


def test_every_place_that_is_offered_in_furniture_counts_as_in_it():
    twin = with_cube(1.0, 1.0)
    objects = posed_objects(twin, twin.start())
    places = on_or_in(objects["cube"], objects["cabinet"], np.random.default_rng(0))
    assert len(places) > 100
    for place in places:
        cube = PosedObject("cube", place.world_T_object, objects["cube"].extents)
        assert judge_term(INTO.primary, {**objects, "cube": cube}, np.zeros(3), np.zeros(3)).met


@pytest.mark.parametrize(
    "at, met, text",
    [
        ((0.62, 0.1, 0.195), True, "cube is in box"),
        ((0.62, 0.1, 0.265), False, "its underside +70 mm from the floor"),
        ((0.45, 0.1, 0.195), False, "50 mm outside"),
        ((0.62, 0.1, 0.625), False, "from the floor"),  # on its roof
    ],
)
def test_in_furniture_means_on_its_floor_behind_its_opening(at, met, text):
    inside = Inside(np.array([-0.2, -0.2, -0.13]), np.array([0.2, 0.2, 0.28]), np.array([-1.0, 0.0, 0.0]))
    box, cube = np.eye(4), np.eye(4)
    box[:3, 3], cube[:3, 3] = (0.70, 0.1, 0.30), at
    things = {
        "box": PosedObject("box", box, np.array([0.4, 0.4, 0.6]), inside=inside),
        "cube": PosedObject("cube", cube, np.array([0.05, 0.05, 0.05])),
    }
    judged = judge_term(RewardTerm("minimize_l2_distance", "cube", "box"), things, np.zeros(3), np.zeros(3))
    assert judged.met is met and text in judged.text
