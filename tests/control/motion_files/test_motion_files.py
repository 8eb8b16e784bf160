"""Motion files of every format are read as they are, and our own come back bit for bit."""

import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from control.errors import TrajectoryError
from control.motion_files.contents import MAX_DURATION, MotionFile
from control.motion_files.reading import read_motion
from control.motion_files.resampling import to_trajectory
from control.motion_files.trajectory_file import write_trajectory
from control.robot.limits import JOINT_NAMES
from control.trajectory.samples import Trajectory
from tests.control.trajectory.test_trajectory import some_trajectory
from tests.support.robot_side.ros2_messages import (
    DISPLAY,
    ROBOT_TRAJECTORY,
    STATE,
    STRING,
    TRAJECTORY,
    header,
    joint_state,
    write_mcap,
)
from tests.support.scenes.motion_files import (
    Motion,
    at_rest,
    columns,
    planned,
    refused,
    retimed_pick_and_place,
    rows,
    there_and_back,
    write_csv,
    write_npz,
)

DOC = Path(__file__).resolve().parents[3] / "docs" / "motion-files.md"
PERMUTED = [3, 0, 6, 1, 5, 2, 4]


def agree(motion: MotionFile, truth, tolerance: float = 1e-11) -> None:
    """Times and positions, and derivatives where the file has them."""
    assert np.max(np.abs(motion.times - truth.times)) < tolerance
    for read, written in ((motion.q, truth.q), (motion.qd, truth.qd), (motion.qdd, truth.qdd)):
        assert read is None or np.max(np.abs(read - written)) < tolerance


# -- our own format ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def picked() -> Trajectory:
    return retimed_pick_and_place()


def test_a_written_trajectory_comes_back_bit_for_bit(tmp_path, picked):
    for k, trajectory in enumerate((picked, some_trajectory(), at_rest(2))):
        path = tmp_path / f"{k}.npz"
        write_trajectory(path, trajectory)
        motion = read_motion(path)
        back = to_trajectory(motion)
        assert back.content_hash() == trajectory.content_hash()
        assert (back.gripper, back.segments) == (trajectory.gripper, trajectory.segments)
        assert (motion.gripper, motion.segments) == (trajectory.gripper, trajectory.segments)
        assert motion.source == "replan-trajectory 1" and motion.joint_names == JOINT_NAMES
        assert motion.duration == pytest.approx(trajectory.duration) and motion.row(1) == "row 1"


def test_a_written_trajectory_is_an_ordinary_npz_file(tmp_path, picked):
    write_trajectory(tmp_path / "t.npz", picked)
    with np.load(tmp_path / "t.npz", allow_pickle=False) as data:
        assert set(data.files) == {
            "format", "version", "joint_names", "sample_time", "q", "qd", "qdd", "gripper", "segments"
        }  # fmt: skip
        assert (str(data["format"]), int(data["version"])) == ("replan-trajectory", 1)
        assert np.array_equal(data["q"], picked.q)


def test_a_trajectory_is_written_to_an_npz_file_in_the_robots_joint_order_only(tmp_path):
    with pytest.raises(TrajectoryError, match=r"to a file that ends in \.npz, not to '.*t\.dat'"):
        write_trajectory(tmp_path / "t.dat", some_trajectory())
    with pytest.raises(TrajectoryError, match="write them as"):
        write_trajectory(tmp_path / "t.npz", replace(some_trajectory(), joint_names=JOINT_NAMES[::-1]))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"version": np.array(2)}, "has version 2 of replan-trajectory; this program reads version 1"),
        ({"format": np.array("rgbd-frames-1")}, "has format 'rgbd-frames-1'; a trajectory has 'replan-trajectory'"),
        ({"qd": None}, "lacks qd; replan-trajectory 1 has format, version"),
        ({"speed": np.array(1)}, "has unknown arrays speed; replan-trajectory 1 has"),
        ({"joint_names": np.array(JOINT_NAMES[::-1])}, "they must be ('panda_joint1'"),
        ({"sample_time": np.array(0.002)}, "has sample_time 0.002; it must be 0.001 s"),
        ({"q": np.zeros((3, 6))}, "trajectory field q has shape (3, 6); it needs (n >= 2, 7)"),
        ({"q": np.full((50, 7), np.nan)}, "trajectory field q is not finite in row 0, joint 'panda_joint1'"),
        ({"q": np.array("x")}, "array 'q' holds <U1; it must hold numbers"),
        ({"gripper": np.array("[")}, "gripper: Invalid JSON: EOF while parsing"),
        (
            {"gripper": np.array('[{"time":0,"dwell":0,"kind":"wave","width":0,"force":0}]')},
            "gripper.0.kind: Input should be 'move' or 'grasp'",
        ),
        (
            {"gripper": np.array('[{"time":9,"dwell":0,"kind":"move","width":0,"force":0}]')},
            "gripper event 0 is at 9 s; it must be between 0 s and the end at 0.049 s",
        ),
        (
            {"segments": np.array('[{"name":"a","start":0,"stop":60,"held":null,"touching":[]}]')},
            "segment 'a' has samples 0 to 60; it must start at 0",
        ),
        (
            {"segments": np.array('[{"name":"a","start":0,"stop":9,"held":null,"touching":[]}]')},
            "the segments end at sample 9; they must cover all 50",
        ),
        ({"segments": np.array('[{"name":"a"}]')}, "segments.0.start: Field required"),
    ],
)
def test_one_of_our_files_that_was_changed_is_refused_by_what_was_changed(tmp_path, changes, message):
    write_trajectory(tmp_path / "t.npz", some_trajectory())
    with np.load(tmp_path / "t.npz", allow_pickle=False) as data:
        arrays = {**{key: data[key] for key in data.files}, **changes}
    np.savez(tmp_path / "t.npz", **{key: array for key, array in arrays.items() if array is not None})
    assert message in refused(tmp_path / "t.npz")


# -- reading other people's files --------------------------------------------------------------------------------------


@pytest.mark.parametrize("prefix", ["panda_", "fr3_", ""])
@pytest.mark.parametrize("derivatives", [0, 1, 2])
def test_csv_columns_may_stand_in_any_order_under_any_of_three_names(tmp_path, prefix, derivatives):
    truth = there_and_back(rows(0.01))
    named = [(name.replace("panda_", prefix), column) for name, column in columns(truth, derivatives, width=True)]
    order = np.random.default_rng(0).permutation(len(named))
    motion = read_motion(write_csv(tmp_path / "m.csv", [named[k] for k in order]))
    agree(motion, truth)
    assert (motion.qd is None, motion.qdd is None) == (derivatives < 1, derivatives < 2)
    assert motion.gripper_width is not None and np.allclose(motion.gripper_width, truth.width, atol=1e-11)
    assert motion.joint_names == tuple(f"{prefix}joint{i}" for i in range(1, 8)) and motion.source == "CSV"


def test_csv_rows_are_counted_as_lines_with_header_comments_and_blank_lines(tmp_path):
    truth = there_and_back(rows(0.5))
    text = write_csv(tmp_path / "m.csv", columns(truth)).read_text().splitlines()
    text[2:2] = ["# a comment", "", "  # another"]
    (tmp_path / "m.csv").write_text("\ufeff# exported\r\n" + "\r\n".join(text), encoding="utf-8")
    motion = read_motion(tmp_path / "m.csv")
    agree(motion, truth)
    assert [motion.row(k) for k in range(3)] == ["line 3", "line 7", "line 8"]


@pytest.mark.parametrize("time_name", ["t", "time", "time_from_start"])
def test_a_time_column_may_have_three_names(tmp_path, time_name):
    truth = there_and_back(rows(0.1))
    agree(read_motion(write_csv(tmp_path / "m.csv", [(time_name, truth.times), *columns(truth)[1:]])), truth)


@pytest.mark.parametrize("names", [("t", "q", "qd", "qdd"), ("times", "positions", "velocities", "accelerations")])
def test_npz_arrays_may_have_two_names_and_joints_any_order(tmp_path, names):
    truth = there_and_back(rows(0.01))
    arrays = (truth.times, *(a[:, PERMUTED] for a in (truth.q, truth.qd, truth.qdd)))
    path = write_npz(
        tmp_path / "m.npz",
        **dict(zip(names, arrays, strict=True)),
        joint_names=np.array(JOINT_NAMES)[PERMUTED],
        gripper_width=truth.width,
    )
    motion = read_motion(path)
    agree(motion, truth, 1e-15)
    assert motion.row(0) == "row 0" and motion.source == "NPZ"


@pytest.mark.parametrize("derivatives", [0, 1, 2])
@pytest.mark.parametrize("options", [{}, {"compression": 0}])
def test_a_ros_2_trajectory_is_read_with_joints_in_any_order(tmp_path, derivatives, options):
    truth = there_and_back(rows(0.01))
    turned = replace(truth, q=truth.q[:, PERMUTED], qd=truth.qd[:, PERMUTED], qdd=truth.qdd[:, PERMUTED])
    message = planned(turned, [JOINT_NAMES[k] for k in PERMUTED], derivatives)
    motion = read_motion(write_mcap(tmp_path / "m.mcap", [("/plan", TRAJECTORY, message)], **options))
    agree(motion, truth)
    assert (motion.qd is None, motion.qdd is None) == (derivatives < 1, derivatives < 2)
    assert motion.source == "trajectory_msgs/msg/JointTrajectory, message 0 of topic '/plan'"
    assert motion.row(2) == "point 2"


def test_moveits_trajectories_are_read_too(tmp_path):
    truth = there_and_back(rows(0.1))
    inside = {
        "joint_trajectory": planned(truth),
        "multi_dof_joint_trajectory": {"header": header(), "joint_names": [], "points": []},
    }
    agree(read_motion(write_mcap(tmp_path / "robot.mcap", [("/plan", ROBOT_TRAJECTORY, inside)])), truth)
    shown = {"model_id": "panda", "trajectory": [inside], "trajectory_start": {}}
    agree(read_motion(write_mcap(tmp_path / "shown.mcap", [("/shown", DISPLAY, shown)])), truth)
    twice = {**shown, "trajectory": [inside, inside]}
    message = refused(write_mcap(tmp_path / "twice.mcap", [("/shown", DISPLAY, twice)]))
    assert "message 0 of topic '/shown' (moveit_msgs/msg/DisplayTrajectory, 1 message) has 2 trajectories" in message


def recorded(tmp_path: Path, times: np.ndarray, base: float = 1_700_000_000.0) -> tuple[Path, Motion]:
    """A recording in which the fingers and another device publish on the arm's topic."""
    truth = there_and_back(times)
    messages = []
    for k in range(len(times)):
        stamp = base + truth.times[k]
        fingers = np.full(2, truth.width[k] / 2)
        messages.append(
            ("/joint_states", STATE, joint_state(stamp, ["panda_finger_joint1", "panda_finger_joint2"], fingers))
        )
        arm = [JOINT_NAMES[j] for j in PERMUTED]
        messages.append(("/joint_states", STATE, joint_state(stamp, arm, truth.q[k, PERMUTED], truth.qd[k, PERMUTED])))
        messages.append(("/joint_states", STATE, joint_state(stamp, ["turntable"], np.zeros(1))))
        messages.append(("/log", STRING, {"data": "hello"}))
    return write_mcap(tmp_path / "recorded.mcap", messages), truth


def test_recorded_joint_states_are_one_motion_with_the_fingers_that_come_in_messages_of_their_own(tmp_path):
    path, truth = recorded(tmp_path, rows(0.02))
    motion = read_motion(path)
    agree(replace(motion, times=motion.times - motion.times[0]), truth, 1e-9)
    assert motion.qd is not None and motion.qdd is None
    assert motion.gripper_width is not None and np.allclose(motion.gripper_width, truth.width)
    assert motion.row(1) == "message 4"
    assert motion.notes == (
        "positions were measured, not commanded: noise of the sensors counts as motion",
        "joints of other devices were left out: turntable",
    )
    assert "is a recording, all of whose messages are one motion; leave out the index" in refused(path, index=1)


def test_where_a_recording_holds_several_motions_they_are_listed_until_one_is_chosen(tmp_path):
    first, second = there_and_back(rows(0.1)), there_and_back(rows(0.05))
    path = write_mcap(
        tmp_path / "m.mcap",
        [
            ("/plan", TRAJECTORY, planned(first)),
            ("/log", STRING, {"data": "hello"}),
            ("/plan", TRAJECTORY, planned(second)),
            ("/other", TRAJECTORY, planned(first)),
        ],
    )
    plan, other = f"'/plan' ({TRAJECTORY}, 2 messages)", f"'/other' ({TRAJECTORY}, 1 message)"
    assert f"holds several motions: {other}; {plan}; choose a topic" in refused(path)
    assert f"holds several motions: topic {plan}; choose an index, 0 to 1" in refused(path, topic="/plan")
    agree(read_motion(path, topic="/plan", index=1), second)
    agree(read_motion(path, topic="/plan", index=0), first)
    agree(read_motion(path, topic="/other"), first)
    assert f"topic {plan} has no message 2; valid are 0 to 1" in refused(path, topic="/plan", index=2)
    assert "has no message -1" in refused(path, topic="/plan", index=-1)
    assert "has no motion on topic '/log'; topics with motions are '/other', '/plan'" in refused(path, topic="/log")


def test_a_recording_without_a_motion_says_what_it_has(tmp_path):
    path = write_mcap(tmp_path / "m.mcap", [("/log", STRING, {"data": "hello"})])
    assert f"holds no motion: none of {TRAJECTORY}, " in refused(path)
    assert "it has '/log' (std_msgs/msg/String, 1 message)" in refused(path)
    assert "it has no topics" in refused(write_mcap(tmp_path / "none.mcap", []))


def test_finger_joints_give_the_width_between_the_pads(tmp_path):
    truth = there_and_back(rows(0.1))
    one = [*columns(truth), ("panda_finger_joint1", truth.width / 2)]
    two = [*one, ("panda_finger_joint2", truth.width / 2)]
    for k, chosen in enumerate((one, two)):
        motion = read_motion(write_csv(tmp_path / f"{k}.csv", chosen))
        assert motion.gripper_width is not None and np.allclose(motion.gripper_width, truth.width, atol=1e-11)
    message = refused(write_csv(tmp_path / "both.csv", [*two, ("gripper_width", truth.width)]))
    assert "has both gripper_width and finger joints; give one of them" in message


# -- the documentation -------------------------------------------------------------------------------------------------


def test_the_documented_examples_are_read(tmp_path):
    csv_text, python = re.findall(r"```(?:csv|python)\n(.*?)```", DOC.read_text(), re.DOTALL)[:2]
    (tmp_path / "m.csv").write_text(csv_text)
    motion = read_motion(tmp_path / "m.csv")
    assert motion.gripper_width is not None and to_trajectory(motion).gripper
    there = os.getcwd()
    os.chdir(tmp_path)
    try:
        exec(python, {})
    finally:
        os.chdir(there)
    assert read_motion(tmp_path / "motion.npz").q.shape[1] == 7


def test_the_documented_limits_are_those_of_the_code():
    text = DOC.read_text()
    assert f"{MAX_DURATION:g} s" in text and "360 000 rows" in text
