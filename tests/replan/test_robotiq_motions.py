"""With the Robotiq 2F-85 the same search picks, places and opens doors, and a whole run reaches its goal."""

import json
import subprocess
import sys
from functools import cache

import numpy as np
import pytest

from benchmarks.scenes.estimates import estimate
from benchmarks.scenes.furniture_twins import cabinet, lever
from benchmarks.scenes.tabletop_twins import CRATE, arm, cubes, only, red_on_crate, twin_of
from control.planners.motion_search import plan_motion
from control.planners.result import MotionPlan
from control.retiming.retime import retime
from control.robot.dynamics import RobotModel
from control.robot.gripper import PANDA_HAND, ROBOTIQ_2F85
from control.robot.limits import panda_limits
from control.safety.limits import SafetyLimits
from control.tasks.failure import FailureCause
from control.tasks.reward_spec import RewardSpec
from control.twin_model import TwinModel
from sim_check.twin.payloads import held_payloads
from sim_check.verdict.verdict import judge_trajectory
from tests.support.scenes.arc_fingers import use_arc_fingers

SAFETY, LIMITS, NAME = SafetyLimits(), panda_limits(ROBOTIQ_2F85), ROBOTIQ_2F85.name


@cache
def robot() -> RobotModel:
    return RobotModel.panda(gripper=ROBOTIQ_2F85)


def search(twin: TwinModel, spec: RewardSpec) -> MotionPlan | FailureCause:
    return plan_motion(twin, spec, SAFETY, np.random.default_rng(0), kinematics=arm(twin.gripper), nthread=1)


def judge(twin: TwinModel, spec: RewardSpec, perturbed: int):
    """Search, retime and judge."""
    found = search(twin, spec)
    assert isinstance(found, MotionPlan), found
    trajectory = retime(found.path, robot(), LIMITS, SAFETY, payloads=held_payloads(twin))
    rng = np.random.default_rng(0)
    return judge_trajectory(trajectory, twin, spec, SAFETY, LIMITS, rng, perturbed, nthread=1, robot=robot())


def test_a_cube_is_picked_placed_and_judged_safe():
    verdict = judge(cubes(NAME), red_on_crate(), perturbed=4)
    assert verdict.passed and verdict.successes == 4, verdict.failed_checks


def box_and_crate(width: float, height: float, gripper: str = NAME) -> TwinModel:
    """A box of these sizes in [m], which stands free, and a crate."""
    box = estimate("box", (0.45, -0.15, height / 2), (width, width, height), yaw=0.3, std=0.002)
    return twin_of(estimate("crate", (0.50, 0.15, 0.03), CRATE, yaw=0.2), box, gripper=gripper)


def test_a_box_that_is_too_wide_for_the_pandas_hand_is_taken_with_the_2f85():
    spec = only("minimize_l2_distance", "box", "crate")
    refused = search(box_and_crate(0.078, 0.06, PANDA_HAND.name), spec)
    assert isinstance(refused, FailureCause) and "is 78 mm, the fingers take 76 mm" in refused.message
    assert judge(box_and_crate(0.078, 0.06), spec, perturbed=4).passed


def test_a_box_that_is_wider_than_the_2f85_opens_is_refused_with_both_widths():
    box = estimate("box", (0.45, -0.15, 0.03), (0.084, 0.084, 0.06))
    cause = search(twin_of(box, gripper=NAME), only("set_obj_z_position", "box", value=0.2))
    assert isinstance(cause, FailureCause) and "is 84 mm, the fingers take 81 mm" in cause.message


@pytest.mark.parametrize(
    ("twin", "joint", "fraction"),
    [
        (lambda: cabinet(gripper=NAME), "cabinet_left_door", 0.6),
        (lambda: lever(gripper=NAME), "lever_rod", 1.0),
    ],
)
def test_a_door_and_a_lever_are_driven_by_their_handles(twin, joint, fraction):
    spec = only("set_joint_fraction", joint, value=fraction)
    assert judge(twin(), spec, perturbed=2).passed


@pytest.mark.parametrize(("width", "height"), [(0.03, 0.03), (0.05, 0.05), (0.078, 0.06)])
def test_what_was_planned_with_linear_jaws_succeeds_with_fingers_on_the_real_arc(monkeypatch, width, height):
    spec = only("minimize_l2_distance", "box", "crate")
    twin = box_and_crate(width, height)
    found = search(twin, spec)
    assert isinstance(found, MotionPlan), found
    trajectory = retime(found.path, robot(), LIMITS, SAFETY, payloads=held_payloads(twin))
    use_arc_fingers(monkeypatch, ROBOTIQ_2F85.opening)
    real = box_and_crate(width, height)
    assert real.model.neq == 3  # both arcs and the coupling of the fingers
    tips = real.start().body("panda_leftfinger").xpos[2] - real.start().body("panda_hand").xpos[2]
    assert tips == pytest.approx(0.0141, abs=2e-4)  # open tips are drawn back; the hand points down
    rng = np.random.default_rng(0)
    verdict = judge_trajectory(trajectory, real, spec, SAFETY, LIMITS, rng, 2, nthread=1, robot=robot())
    assert verdict.passed, verdict.failed_checks


def test_a_whole_run_in_a_cell_with_the_2f85_reaches_its_goal(tmp_path):
    command = [sys.executable, "-m", "replan.main", "run", "place the red cube on the crate", "--cell", "cubes-2f85"]
    run = subprocess.run(
        [*command, "--speed", "0", "--no-video", "--json"], capture_output=True, text=True, cwd=tmp_path
    )
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout)["reached"]
    (folder,) = (tmp_path / "runs").iterdir()
    events = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
    (issued,) = (e["certificate"] for e in events if e["event"] == "certificate")
    assert issued["profile"] == "panda/5+robotiq_2f85"
