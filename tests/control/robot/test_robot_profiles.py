"""Robot profiles are read strictly, and motions keep to speeds that depend on where a joint is."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from control.errors import ConfigError, RetimingError
from control.retiming.retime import retime
from control.robot.dynamics import RobotModel
from control.robot.gripper import ROBOTIQ_2F85
from control.robot.limits import REST_Q, panda_limits
from control.robot.profiles import FOLDER, known_profiles, load_profile
from control.safety.limits import SafetyLimits
from control.safety.trajectory_checks import check_trajectory
from control.trajectory.samples import SAMPLE_TIME, JointPath, PathSegment, Trajectory
from sim_check.cells.loading import load_cell

REST = np.array(REST_Q)
FR3 = load_profile("fr3/10")
# All of the speed that is left near an end may be used, and the joint may go all the way.
FULL = SafetyLimits(velocity_scale=1.0, acceleration_scale=1.0, hand_speed=3.0, hand_angular_speed=2.5)


def profile_file(folder: Path, **changes) -> Path:
    """The Panda's profile with changes; None takes a key out."""
    content = yaml.safe_load((FOLDER / "panda-5.yaml").read_text()) | changes
    path = folder / "mine.yaml"
    path.write_text(yaml.safe_dump({k: v for k, v in content.items() if v is not None}))
    return path


def test_the_known_profiles_are_the_panda_and_the_fr3_with_their_firmware():
    assert known_profiles() == ("fr3/10", "panda/5")
    for name in known_profiles():
        limits = load_profile(name)
        assert limits.profile == name and limits.firmware
    assert panda_limits().velocity_ends is None
    assert panda_limits().qdd[3] == 12.5 and panda_limits().cartesian_jerk == 6500.0
    assert FR3.q_min[5] == 0.4398 and FR3.qd[4] == 5.26


def test_a_gripper_of_ones_own_choice_is_named_in_the_profile():
    assert load_profile("fr3/10", ROBOTIQ_2F85).profile == "fr3/10+robotiq_2f85"


def test_a_file_of_ones_own_is_a_profile(tmp_path):
    limits = load_profile(profile_file(tmp_path, profile="ours/1", qd=[1.0] * 7))
    assert limits.profile == "ours/1"
    assert np.array_equal(limits.qd, np.ones(7)) and np.array_equal(limits.tau, panda_limits().tau)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"quick": 1}, "unknown key 'quick'; valid keys there are profile, firmware, q_min"),
        ({"qdd": None}, "key 'qdd' is missing"),
        ({"qdd": [1.0] * 6}, "qdd needs 7 numbers, one for each joint, not 6"),
        ({"qd": [1.0] * 6 + [0.0]}, "qd.joint 7: Input should be greater than 0"),
        ({"angular_jerk": -1.0}, "angular_jerk: Input should be greater than 0"),
        ({"tau": [float("nan")] * 7}, "tau.joint 1: Input should be"),
        ({"q_max": [-3.0] * 7}, "joint 1: q_min is -2.8973, it must be below q_max, -3.0"),
        ({"profile": "Panda"}, "profile: String should match"),
        ({"velocity_ends": {"slope": 1.0}}, "unknown key 'velocity_ends.slope'; valid keys there are q_low, q_high"),
    ],
)
def test_mistakes_in_a_profile_are_told_by_file_key_and_what_is_valid(changes, text, tmp_path):
    path = profile_file(tmp_path, **changes)
    with pytest.raises(ConfigError) as error:
        load_profile(path)
    assert any(line.startswith(f"{path}: {text}") for line in str(error.value).splitlines()), str(error.value)


def test_a_profile_that_does_not_exist_names_those_that_do(tmp_path):
    with pytest.raises(ConfigError, match=r"no robot profile 'panda/4'; known profiles are fr3/10, panda/5 \(or give"):
        load_profile("panda/4")
    with pytest.raises(ConfigError, match=r"no robot profile '.*gone\.yaml'; known profiles are fr3/10, panda/5"):
        load_profile(tmp_path / "gone.yaml")


def cell_file(folder: Path, profile: str) -> Path:
    path = folder / "cell.yaml"
    camera = "{name: eye, mounting: static, position: [1, 0, 1], look_at: [0, 0, 0], fx: 500}"
    path.write_text(f"name: mine\nrobot: {{profile: {profile}}}\ncameras: [{camera}]\nobjects: [red_cube]\n")
    return path


def test_a_cell_takes_a_known_profile_or_a_file_beside_it(tmp_path):
    assert load_cell(cell_file(tmp_path, "fr3/10")).robot.limits().profile == "fr3/10"
    profile_file(tmp_path, profile="ours/1")
    assert load_cell(cell_file(tmp_path, "mine.yaml")).robot.limits().profile == "ours/1"


def test_a_cell_with_a_profile_that_does_not_exist_or_is_not_valid_is_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"cell\.yaml: robot\.profile: there is no robot profile 'fr4/1'; known"):
        load_cell(cell_file(tmp_path, "fr4/1"))
    profile_file(tmp_path, qd=[1.0])
    with pytest.raises(ConfigError, match=r"cell\.yaml: robot\.profile: .*mine\.yaml: qd needs 7 numbers"):
        load_cell(cell_file(tmp_path, "mine.yaml"))


def towards_end(joint: int, goal: float) -> JointPath:
    q = np.array([REST, REST])
    q[1, joint] = goal
    return JointPath((PathSegment("reach", q),))


@pytest.fixture(scope="module")
def robot() -> RobotModel:
    return RobotModel.panda()


@pytest.mark.parametrize(("joint", "goal"), [(0, 2.6), (1, -1.7), (5, 4.45), (3, -2.95)])
def test_speeds_near_the_end_of_a_joint_are_kept_and_used(joint, goal, robot):
    trajectory = retime(towards_end(joint, goal), robot, FR3, FULL)
    checks = check_trajectory(trajectory, FR3, FULL, robot.torque, robot.tcp_poses)
    assert not [c for c in checks if not c.ok]
    # Without the ends the same motion is faster, and the checker sees that it then brakes too late.
    free = replace(FR3, velocity_ends=None)
    faster = retime(towards_end(joint, goal), robot, free, FULL)
    assert faster.duration < trajectory.duration
    late = {c.name: c for c in check_trajectory(faster, FR3, FULL)}["joint_velocity"]
    assert not late.ok and late.bodies == (f"panda_joint{joint + 1}",)
    assert late.limit < FR3.qd[joint]


def test_a_path_into_the_stretch_where_no_speed_is_left_is_refused_by_joint_and_place(robot):
    text = r"segment 'reach' breaks joint_velocity at waypoint 1 \(\d+ % of its length\): joint 1 is at 2\.8\d+ rad"
    with pytest.raises(RetimingError, match=text):
        retime(towards_end(0, 2.88), robot, FR3, FULL)


def test_the_checker_holds_each_direction_against_its_own_end():
    t = np.arange(400) * SAMPLE_TIME
    q = np.tile(REST, (400, 1))
    q[:, 1] = -1.7 + 0.9 * t  # away from the lower end, where it may not be approached that fast
    qd = np.tile(0.9 * np.eye(7)[1], (400, 1))

    def velocity(q: np.ndarray, qd: np.ndarray):
        checks = check_trajectory(Trajectory(q, qd, np.zeros_like(q)), FR3, FULL)
        return {c.name: c for c in checks}["joint_velocity"]

    assert velocity(q, qd).ok
    back = velocity(q[::-1], -qd)
    assert not back.ok
    # -offset + sqrt(2 deceleration distance), at the end of the motion
    assert back.limit == pytest.approx(-0.2517 + np.sqrt(2 * 2.585 * (q[0, 1] + 1.8361)), rel=2e-2)
