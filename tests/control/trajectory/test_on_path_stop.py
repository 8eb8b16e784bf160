"""From any moment of a motion the arm comes to rest on its own path, within the limits."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.motion.arm_paths import REST, pick_and_place, random_path
from control.errors import TrajectoryError
from control.retiming.retime import retime
from control.robot.dynamics import RobotModel
from control.robot.limits import panda_limits
from control.safety.limits import SafetyLimits
from control.safety.trajectory_checks import check_trajectory
from control.trajectory.on_path_stop import stop_on_path
from control.trajectory.playback import PROGRESS, SLOPE, Playback
from control.trajectory.samples import JointPath, PathSegment, Trajectory
from control.trajectory.speed_override import override_speed
from tests.support.robot_side.played_paths import distance_from_path

LIMITS = panda_limits()
SAFETY = SafetyLimits()
PUBLISHED = replace(SAFETY, velocity_scale=1.0, acceleration_scale=1.0, joint_margin=0.0)


@pytest.fixture(scope="module")
def robot() -> RobotModel:
    return RobotModel.panda()


@pytest.fixture(scope="module")
def placed(robot) -> Trajectory:
    return retime(pick_and_place(robot), robot, LIMITS, SAFETY)


def assert_stops(commanded: Trajectory | Playback, index: int) -> Playback:
    playback = commanded if isinstance(commanded, Playback) else Playback.of(commanded)
    stop = stop_on_path(playback, index, LIMITS)
    assert not [c for c in check_trajectory(stop.as_trajectory(), LIMITS, PUBLISHED) if not c.ok]
    assert np.array_equal(stop.q[: index + 1], playback.q[: index + 1]), "what was commanded is over"
    assert len(stop.q) > index + 1
    assert np.all(np.diff(stop.clock[index:, PROGRESS]) >= 0.0), "it does not turn back"
    assert stop.clock[-1, PROGRESS] <= len(playback.trajectory.q) - 1
    assert not stop.qd[-1].any()
    assert not stop.qdd[-1].any()
    # Interpolation between samples a millisecond apart is good to far less than a microradian.
    assert distance_from_path(stop, index) < 1e-7
    return stop


def rows_to_rest(stop: Playback, index: int) -> int:
    return len(stop.q) - 1 - index


@pytest.mark.parametrize("seed", range(8))
def test_stopping_anywhere_on_random_trajectories_keeps_path_and_limits(seed, robot):
    rng = np.random.default_rng(seed)
    waypoints = random_path(rng, 2, spread=None if seed % 2 else 0.3)
    trajectory = retime(JointPath((PathSegment("reach", waypoints),)), robot, LIMITS, SAFETY)
    for index in rng.integers(0, len(trajectory.q), 8):
        assert_stops(trajectory, int(index))


def test_stopping_anywhere_in_a_pick_and_place_keeps_path_and_limits(placed):
    for index in np.random.default_rng(0).integers(0, len(placed.q), 40):
        assert_stops(placed, int(index))


def test_stops_are_quick(placed):
    playback = Playback.of(placed)
    lengths = [rows_to_rest(stop_on_path(playback, index, LIMITS), index) for index in range(0, len(placed.q), 50)]
    # From the fastest allowed speed a joint needs 0.8 qd / qdd, at most 0.24 s, plus the ramps.
    assert max(lengths) < 450
    assert np.median(lengths) < 250


def test_samples_of_the_stop_advance_along_the_trajectory_without_turning_back(placed):
    index = int(np.argmax(np.linalg.norm(placed.qd, axis=1)))
    stop = assert_stops(placed, index)
    forward = placed.qd[index]
    steps = np.diff(stop.q[index:], axis=0) @ forward
    assert np.all(steps >= -1e-9)
    assert stop.clock[-1, PROGRESS] > index + 5  # it was moving, so it cannot stop at once


def test_an_arm_that_dwells_stops_at_once(placed):
    for event in placed.gripper:
        for moment in (event.time, event.time + event.dwell / 2, event.time + event.dwell):
            index = round(moment / 1e-3)
            stop = assert_stops(placed, index)
            assert stop.clock[-1, PROGRESS] == index
            assert np.array_equal(stop.q[index + 1 :], np.tile(placed.q[index], (2, 1)))


def test_before_the_start_and_at_the_end_it_stops_at_once(placed):
    assert np.array_equal(assert_stops(placed, 0).q, np.tile(placed.q[0], (3, 1)))
    stop = assert_stops(placed, len(placed.q) - 1)
    assert np.array_equal(stop.q[-1], placed.q[-1])
    assert stop.clock[-1, PROGRESS] == len(placed.q) - 1


def test_shortly_before_the_end_it_never_passes_the_end(placed):
    for before in range(1, 120, 7):
        stop = assert_stops(placed, len(placed.q) - 1 - before)
        assert rows_to_rest(stop, len(placed.q) - 1 - before) <= before + 60


def test_a_trajectory_without_room_below_its_limits_is_played_to_its_end(placed):
    tight = replace(
        LIMITS,
        qdd=np.max(np.abs(placed.qdd), axis=0) * 0.5,
        qddd=np.full(7, 1.0),
    )
    index = int(np.argmax(np.linalg.norm(placed.qd, axis=1)))
    playback = Playback.of(placed)
    assert stop_on_path(playback, index, tight) is playback


@pytest.mark.parametrize("index", [-1, 10_000_000])
def test_a_moment_outside_the_trajectory_is_refused(index, placed):
    with pytest.raises(
        TrajectoryError, match=rf"cannot stop at sample {index}; what is commanded has samples 0 to \d+"
    ):
        stop_on_path(Playback.of(placed), index, LIMITS)


def test_a_resting_trajectory_stops_at_once():
    rest = Trajectory(np.tile(REST, (10, 1)), np.zeros((10, 7)), np.zeros((10, 7)))
    for index in range(10):
        assert assert_stops(rest, index).clock[-1, PROGRESS] == index


@pytest.mark.parametrize("rate", [0.05, 0.3, 0.9])
def test_stopping_anywhere_at_another_speed_keeps_path_and_limits(rate, placed):
    playback = Playback.of(placed, rate)
    for index in np.random.default_rng(1).integers(0, len(playback.q), 12):
        stop = assert_stops(playback, int(index))
        assert rows_to_rest(stop, int(index)) < 450


@pytest.mark.parametrize(("before", "after"), [(1.0, 0.1), (0.1, 1.0), (0.6, 0.5), (0.97, 1.0)])
def test_stopping_in_the_middle_of_a_change_of_speed_keeps_path_and_limits(before, after, placed):
    rng = np.random.default_rng(2)
    allowed = LIMITS.scaled(SAFETY.velocity_scale, SAFETY.acceleration_scale)
    playback = Playback.of(placed, before)
    waits = []
    for begin in rng.integers(0, len(playback.q) - 1, 8):
        changing = override_speed(playback, int(begin), after, allowed)
        for index in np.flatnonzero(changing.clock[:, SLOPE])[::20]:
            stop = assert_stops(changing, int(index))
            waits.append(rows_to_rest(stop, int(index)))
    assert max(waits) < 600
    assert np.median(waits) < 250
