"""A motion file is played as it is, or retimed along its path; what is wrong with it is not smoothed away."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.motion.arm_paths import pick_and_place
from control.motion_files.paths import to_path
from control.motion_files.reading import read_motion
from control.motion_files.resampling import to_trajectory, to_trajectory_with_report
from control.motion_files.trajectory_file import write_trajectory
from control.retiming.retime import retime
from control.robot.dynamics import RobotModel
from control.robot.limits import REST_Q, panda_limits
from control.safety.limits import SafetyLimits
from control.safety.trajectory_checks import check_trajectory
from control.trajectory.samples import GripperCommand, Trajectory, TrajectorySegment
from tests.support.scenes.motion_files import (
    STEP,
    as_motion,
    columns,
    retimed_pick_and_place,
    rows,
    there_and_back,
    write_csv,
)


@pytest.fixture(scope="module")
def picked() -> Trajectory:
    return retimed_pick_and_place()


# -- as it would be played ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("derivatives", [0, 1, 2])
def test_rows_a_millisecond_apart_are_played_exactly(tmp_path, derivatives):
    truth = there_and_back(rows(0.001))
    shifted = [("t", truth.times + 1234.5), *columns(truth, derivatives)[1:]]
    motion = read_motion(write_csv(tmp_path / "m.csv", shifted))
    trajectory, report = to_trajectory_with_report(motion)
    assert motion.times[0] == 1234.5
    assert np.array_equal(trajectory.q, motion.q) and report.departure == 0.0
    assert motion.qd is None or np.array_equal(trajectory.qd, motion.qd)
    assert motion.qdd is None or np.array_equal(trajectory.qdd, motion.qdd)
    assert np.max(np.abs(trajectory.qd - truth.qd)) < 1e-5 and np.max(np.abs(trajectory.qdd - truth.qdd)) < 2e-3
    assert trajectory.segments == (TrajectorySegment("motion", 0, 5001),)
    missing = ["; velocities and accelerations by central differences", "; accelerations by central differences", ""]
    assert report.method == "the file's rows, 1 ms apart" + missing[derivatives]


# Largest errors of positions [rad], velocities [rad/s] and accelerations [rad/s^2] at any millisecond; about twice
# what was measured, so that they hold elsewhere and nothing worse does.
@pytest.mark.parametrize(
    ("derivatives", "step", "position", "speed", "acceleration"),
    [
        (0, 0.01, 7e-10, 3e-7, 2e-3),
        (0, 0.1, 6e-6, 2e-4, 0.02),
        (0, 0.5, 3e-3, 0.02, 0.3),
        (1, 0.01, 7e-10, 3e-7, 2e-3),
        (1, 0.1, 7e-6, 2e-4, 0.02),
        (1, 0.5, 3e-3, 0.02, 0.5),
        (2, 0.01, 1e-13, 1e-11, 2e-3),  # samples of the acceleration are differences, see there
        (2, 0.1, 1e-13, 1e-11, 2e-3),
    ],
)
def test_coarser_rows_are_met_exactly_and_interpolated_closely(derivatives, step, position, speed, acceleration):
    truth, rows_of = there_and_back(rows(0.001)), there_and_back(rows(step))
    motion = as_motion(rows_of, derivatives)
    trajectory, report = to_trajectory_with_report(motion)
    assert len(trajectory.q) == 5001
    assert np.max(np.abs(trajectory.q[:: round(step * 1000)] - rows_of.q)) < 1e-12
    errors = [np.max(np.abs(a - b)) for a, b in zip(
        (trajectory.q, trajectory.qd, trajectory.qdd), (truth.q, truth.qd, truth.qdd), strict=True
    )]  # fmt: skip
    assert errors[0] < position and errors[1] < speed and errors[2] < acceleration, errors
    method = ["cubic spline through the positions, from rest to rest", "cubic polynomials", "quintic polynomials"]
    assert report.method.startswith(method[derivatives])


@pytest.mark.parametrize("step", [0.001, 0.01, 0.05])
@pytest.mark.parametrize("derivatives", [0, 1, 2])
def test_a_sound_motion_passes_all_checks_whatever_its_rows(step, derivatives):
    trajectory = to_trajectory(as_motion(there_and_back(rows(step)), derivatives))
    robot = RobotModel.panda()
    safety = replace(SafetyLimits(), hand_speed=2.0)
    checks = check_trajectory(trajectory, panda_limits(), safety, robot.torque, robot.tcp_poses)
    assert not [c for c in checks if not c.ok]


@pytest.mark.parametrize("step", [0.001, 0.01, 0.05])
@pytest.mark.parametrize("derivatives", [0, 1, 2])
def test_a_jump_stays_a_jump(step, derivatives):
    jumping = there_and_back(rows(step))
    q = jumping.q.copy()
    q[len(q) // 3 :, 3] += 0.2
    trajectory = to_trajectory(as_motion(replace(jumping, q=q), derivatives))
    checks = {c.name: c for c in check_trajectory(trajectory, panda_limits(), SafetyLimits())}
    fastest = checks["joint_velocity"]
    assert not fastest.ok and fastest.bodies == ("panda_joint4",) and fastest.worst > 0.2 / step * 0.9
    assert fastest.at is not None and abs(fastest.at - times_of_jump(step)) <= 2 * step


def times_of_jump(step: float) -> float:
    times = rows(step)
    return float(times[len(times) // 3])


@pytest.mark.parametrize("derivatives", [0, 1])
def test_a_motion_that_is_cut_off_while_moving_does_not_come_to_rest(derivatives):
    cut = there_and_back(rows(0.001)[:1000])
    checks = {
        c.name: c for c in check_trajectory(to_trajectory(as_motion(cut, derivatives)), panda_limits(), SafetyLimits())
    }
    assert not checks["ends_at_rest"].ok and checks["starts_at_rest"].ok


def test_rests_stay_rests_between_the_curves_of_a_file_without_velocities():
    trajectory = to_trajectory(as_motion(there_and_back(rows(0.25))))
    assert np.max(np.abs(trajectory.q[2000:3001] - trajectory.q[2000])) == 0.0
    assert np.max(np.abs(trajectory.qd[2000:3001])) == 0.0


def test_curves_between_coarse_rows_say_how_far_they_leave_the_straight_line():
    motion = as_motion(there_and_back(rows(0.5)))
    trajectory, report = to_trajectory_with_report(motion)
    line = np.interp(report.at, motion.times, motion.q[:, report.joint])
    assert report.departure == pytest.approx(abs(trajectory.q[round(report.at * 1000), report.joint] - line))
    assert 0.005 < report.departure < 0.05 and report.joint == int(np.argmax(np.abs(STEP)))


def test_rounded_positions_a_millisecond_apart_are_named_as_the_noise_that_they_are(tmp_path):
    truth = there_and_back(rows(0.001))
    for digits, said in ((6, "rounded to 1e-06 rad, which alone makes jerks of up to 4000 rad/s^3"), (9, None)):
        motion = read_motion(write_csv(tmp_path / "m.csv", columns(truth), digits))
        method = to_trajectory_with_report(motion)[1].method
        assert said in method if said else "rounded" not in method
    single = replace(truth, q=truth.q.astype(np.float32).astype(float))
    assert "rounded to 2e-07 rad" in to_trajectory_with_report(as_motion(single))[1].method


@pytest.mark.parametrize("duration", [0.0105, 0.0101, 0.0004])
def test_a_last_row_between_two_milliseconds_is_reached(duration):
    times = np.linspace(0.0, duration, 4)
    q = np.array(REST_Q) + np.linspace(0.0, 1e-4, 4)[:, None]
    trajectory = to_trajectory(as_motion(replace(there_and_back(times), q=q)))
    assert np.array_equal(trajectory.q[-1], q[-1]) and 0 <= trajectory.duration - duration < 1e-3


# -- the gripper -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("step", [0.001, 0.02, 0.1])
def test_a_change_of_width_is_a_command_at_the_row_where_it_begins(step):
    (event,) = to_trajectory(as_motion(there_and_back(rows(step)), width=True)).gripper
    assert event.time == pytest.approx(2.2) and event.command.kind == "move"
    assert event.command.width == pytest.approx(0.04)
    assert event.dwell == pytest.approx(0.8, abs=2e-3)  # the arm rests from 2 to 3 s


def test_a_closing_is_a_grasp_only_where_the_file_or_the_caller_says_so():
    moving = there_and_back(rows(0.01))
    force = np.where((moving.times > 2.2) & (moving.times < 4.0), 30.0, 0.0)
    commands = [
        to_trajectory(as_motion(moving, width=True)).gripper[0].command,
        to_trajectory(as_motion(moving, width=True), grasp_force=20.0).gripper[0].command,
        to_trajectory(as_motion(moving, width=True, force=force)).gripper[0].command,
    ]
    width = commands[0].width
    assert commands == [
        GripperCommand("move", width), GripperCommand("grasp", width, 20.0), GripperCommand("grasp", width, 30.0)
    ]  # fmt: skip
    opening = replace(moving, width=0.12 - moving.width)
    (event,) = to_trajectory(as_motion(opening, width=True), grasp_force=20.0).gripper
    assert event.command == GripperCommand("move", opening.width[-1])


def test_noise_of_the_width_is_no_command_and_closing_and_opening_are_two():
    times = rows(0.01)
    rng = np.random.default_rng(0)
    width = np.interp(times, [0.0, 1.0, 1.4, 1.6, 2.0, 5.0], [0.08, 0.08, 0.04, 0.04, 0.08, 0.08])
    noisy = replace(there_and_back(times), width=width + rng.uniform(-1e-4, 1e-4, len(times)))
    events = to_trajectory(as_motion(noisy, width=True)).gripper
    assert [round(e.time, 1) for e in events] == [1.0, 1.6]
    assert [e.command.width for e in events] == [pytest.approx(0.04, abs=2e-4), pytest.approx(0.08, abs=2e-4)]
    still = replace(noisy, width=0.08 + rng.uniform(-1e-4, 1e-4, len(times)))
    assert to_trajectory(as_motion(still, width=True)).gripper == ()


def test_a_step_of_the_width_while_the_arm_moves_is_a_command_too():
    moving = there_and_back(rows(0.01))
    (event,) = to_trajectory(
        as_motion(replace(moving, width=np.where(moving.times < 1.0, 0.08, 0.02)), width=True)
    ).gripper
    assert event.time == pytest.approx(0.99) and event.dwell == pytest.approx(0.01)
    assert event.command == GripperCommand("move", 0.02)


# -- as a path ---------------------------------------------------------------------------------------------------------


def test_a_path_is_cut_where_the_gripper_acts_and_nowhere_else():
    moving = there_and_back(rows(0.001))
    whole = to_path(as_motion(moving))
    assert [s.name for s in whole.segments] == ["motion"] and whole.segments[0].gripper is None
    path = to_path(as_motion(moving, width=True), grasp_force=25.0)
    assert [s.name for s in path.segments] == ["motion 1", "motion 2"]
    command = path.segments[0].gripper
    assert command is not None and (command.kind, command.force) == ("grasp", 25.0)
    assert command.width == pytest.approx(0.04) and path.segments[1].gripper is None
    assert np.array_equal(path.segments[0].q[-1], path.segments[1].q[0])
    assert np.array_equal(path.segments[0].q[0], moving.q[0]) and np.array_equal(path.segments[1].q[-1], moving.q[-1])
    for segment in path.segments:
        assert np.min(np.max(np.abs(np.diff(segment.q, axis=0)), axis=1)) > 0


def test_a_path_goes_through_the_rows_of_a_file_without_velocities():
    coarse = there_and_back(rows(0.25))
    distinct = coarse.q[(coarse.times <= 2.0) | (coarse.times > 3.0)]
    assert np.array_equal(to_path(as_motion(coarse)).segments[0].q, distinct)


def test_a_path_follows_the_curve_of_a_file_with_velocities():
    path = to_path(as_motion(there_and_back(rows(0.5)), derivatives=1)).segments[0].q
    dense = to_trajectory(as_motion(there_and_back(rows(0.5)), derivatives=1)).q
    nearest = np.min(np.max(np.abs(dense[::100, None, :] - path[None]), axis=2), axis=1)
    assert nearest.max() <= 2e-4 and len(path) > 1000


def test_a_path_of_our_own_file_keeps_what_is_held_and_what_may_touch(tmp_path, picked):
    write_trajectory(tmp_path / "t.npz", picked)
    path, original = to_path(read_motion(tmp_path / "t.npz")), pick_and_place(RobotModel.panda())
    for made, wanted in zip(path.segments, original.segments, strict=True):
        assert (made.name, made.gripper, made.held, made.touching) == (
            wanted.name, wanted.gripper, wanted.held, wanted.touching
        )  # fmt: skip


@pytest.mark.parametrize("own", [True, False])
def test_a_path_of_a_file_can_be_retimed(tmp_path, picked, own):
    if own:
        write_trajectory(tmp_path / "t.npz", picked)
        path = to_path(read_motion(tmp_path / "t.npz"))
    else:
        path = to_path(as_motion(there_and_back(rows(0.1)), width=True))
    robot, limits, safety = RobotModel.panda(), panda_limits(), SafetyLimits()
    again = retime(path, robot, limits, safety)
    assert not [c for c in check_trajectory(again, limits, safety, robot.torque, robot.tcp_poses) if not c.ok]
    assert len(again.gripper) == (2 if own else 1)
