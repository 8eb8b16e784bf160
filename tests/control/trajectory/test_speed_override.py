"""The rest of a motion is played slower or as fast as it was judged: on its path, within the limits, at any moment."""

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
from control.trajectory.change_of_rate import ramp
from control.trajectory.on_path_stop import stop_on_path
from control.trajectory.playback import PROGRESS, RATE, SLOPE, Playback, at_progress
from control.trajectory.samples import SAMPLE_TIME, JointPath, PathSegment, Trajectory
from control.trajectory.speed_override import override_speed
from tests.support.robot_side.played_paths import distance_from_path

LIMITS = panda_limits()
SAFETY = SafetyLimits()
ALLOWED = LIMITS.scaled(SAFETY.velocity_scale, SAFETY.acceleration_scale)


@pytest.fixture(scope="module")
def robot() -> RobotModel:
    return RobotModel.panda()


@pytest.fixture(scope="module")
def placed(robot) -> Trajectory:
    return retime(pick_and_place(robot), robot, LIMITS, SAFETY)


def assert_changes(playback: Playback, index: int, rate: float, robot: RobotModel | None = None) -> Playback:
    models = (robot.torque, robot.tcp_poses) if robot else (None, None)
    result = override_speed(playback, index, rate, ALLOWED, models[0])
    broken = [c for c in check_trajectory(result.as_trajectory(), LIMITS, SAFETY, *models) if not c.ok]
    assert not broken
    assert np.array_equal(result.q[: index + 1], playback.q[: index + 1]), "what was commanded is over"
    assert np.array_equal(result.q[-1], playback.trajectory.q[-1])
    assert np.all(np.diff(result.clock[:, PROGRESS]) >= 0.0), "it does not turn back"
    assert result.clock[:, RATE].min() >= 0.0
    assert result.clock[:, RATE].max() <= 1.0 + 1e-9
    assert distance_from_path(result, index) < 1e-7
    return result


@pytest.mark.parametrize("rate", [0.05, 0.1, 0.3, 0.7, 0.99])
def test_a_whole_motion_at_one_speed_keeps_every_limit_with_torques(rate, placed, robot):
    slowed = Playback.of(placed, rate)
    checks = check_trajectory(slowed.as_trajectory(), LIMITS, SAFETY, robot.torque, robot.tcp_poses)
    assert not [c for c in checks if not c.ok]
    assert len(slowed.q) - 1 == pytest.approx((len(placed.q) - 1) / rate, abs=2)
    assert distance_from_path(slowed) < 1e-7


@pytest.mark.parametrize("rate", [0.05, 0.1, 0.3, 0.7])
def test_speeds_scale_with_the_rate_accelerations_with_its_square_and_jerks_with_its_cube(rate, placed):
    q, own = Playback.of(placed, rate).q, placed.q
    for order in (1, 2, 3):
        worst = np.abs(np.diff(q, order, axis=0)).max(axis=0) / np.abs(np.diff(own, order, axis=0)).max(axis=0)
        # Between two samples a jerk that changes from one to the next reaches beyond both.
        assert np.all(worst <= rate**order * {1: 1.001, 2: 1.02, 3: 1.6}[order])


def test_at_speed_one_a_playback_is_the_trajectory_bit_for_bit(placed):
    playback = Playback.of(placed)
    assert playback.q is placed.q
    assert playback.as_trajectory() is placed
    assert override_speed(playback, 1000, 1.0, ALLOWED) is playback


def test_changes_of_speed_at_random_moments_of_a_pick_and_place_keep_path_and_limits(placed, robot):
    rng = np.random.default_rng(3)
    for _ in range(12):
        playback = Playback.of(placed)
        index = int(rng.integers(0, len(playback.q)))
        for rate in (*rng.uniform(0.05, 1.0, 2), 1.0):  # each often in the middle of the one before
            playback = assert_changes(playback, index, float(rate), robot)
            index = min(index + int(rng.integers(1, 250)), len(playback.q) - 1)


@pytest.mark.parametrize("seed", range(4))
def test_changes_of_speed_on_random_trajectories_keep_path_and_limits(seed, robot):
    rng = np.random.default_rng(seed)
    waypoints = random_path(rng, 2, spread=None if seed % 2 else 0.3)
    trajectory = retime(JointPath((PathSegment("reach", waypoints),)), robot, LIMITS, SAFETY)
    for index in rng.integers(0, len(trajectory.q), 6):
        slower = assert_changes(Playback.of(trajectory), int(index), float(rng.uniform(0.05, 0.9)))
        assert_changes(slower, int(rng.integers(index, len(slower.q))), 1.0)


def test_a_change_goes_on_from_what_is_commanded_and_ends_with_exactly_the_rate_asked_for(placed):
    index = int(np.argmax(np.linalg.norm(placed.qd[:5000], axis=1)))
    result = assert_changes(Playback.of(placed), index, 0.3)
    np.testing.assert_allclose(result.qd[index], placed.qd[index], atol=5e-3)
    np.testing.assert_allclose(result.qdd[index], placed.qdd[index], atol=4.0)
    reached = index + int(np.argmax(result.clock[index:, RATE] == 0.3))
    assert reached - index < 300
    assert np.all(result.clock[reached:, RATE] == 0.3)
    middle = slice(reached + 100, reached + 200)
    own = at_progress(placed.qd, result.clock[middle, PROGRESS])
    np.testing.assert_allclose(result.qd[middle], 0.3 * own, atol=1e-6)


def test_changes_of_speed_are_quick(placed):
    playback = Playback.of(placed)
    waits = []
    for index in range(0, len(placed.q) - 1, 150):
        result = override_speed(playback, index, 0.3, ALLOWED)
        waits.append(int(np.argmax(np.append(result.clock[index:, RATE] == 0.3, True))))
    # Within half of the acceleration limits, which the arm often uses up by itself already.
    assert np.median(waits) < 200
    assert max(waits) < 2500


def test_a_slower_clock_only_lengthens_dwells_and_moves_events_and_segments_with_the_samples(placed):
    event = placed.gripper[0]
    for index in (500, round(event.time / SAMPLE_TIME) + 100, len(placed.q) - 500):
        playback = override_speed(Playback.of(placed), index, 0.4, ALLOWED)
        slowed = playback.as_trajectory()
        assert len(slowed.gripper) == len(placed.gripper)
        assert [s.name for s in slowed.segments] == [s.name for s in placed.segments]
        assert [s.held for s in slowed.segments] == [s.held for s in placed.segments]
        assert slowed.segments[0].start == 0
        assert slowed.segments[-1].stop == len(slowed.q)
        assert all(a.stop == b.start for a, b in zip(slowed.segments, slowed.segments[1:], strict=False))
        for mine, own in zip(slowed.gripper, placed.gripper, strict=True):
            assert mine.command == own.command
            assert mine.dwell >= own.dwell
            if own.time / SAMPLE_TIME > index + 500:  # the speed has changed by then
                assert mine.dwell == pytest.approx(own.dwell / 0.4, abs=2 * SAMPLE_TIME)
            row = round(mine.time / SAMPLE_TIME)
            assert 0.0 <= playback.clock[row, PROGRESS] - own.time / SAMPLE_TIME < 1.0
            over = row + round(mine.dwell / SAMPLE_TIME)
            np.testing.assert_allclose(slowed.q[row:over], np.tile(placed.q[round(own.time * 1000)], (over - row, 1)),
                                       atol=1e-9)  # fmt: skip


def test_events_after_a_stop_are_left_out(placed):
    first = round(placed.gripper[0].time / SAMPLE_TIME)
    clock = np.array([[first - 100.0, 0.0, 0.0]])
    stopped = Playback.of(placed).continued(first - 100, clock).as_trajectory()
    assert stopped.gripper == ()
    assert stopped.segments[-1].stop == len(stopped.q)


@pytest.mark.parametrize("rate", [0.0, -0.1, 1.0001, 2.0, float("nan"), float("inf")])
def test_a_speed_that_was_not_judged_is_refused(rate, placed):
    with pytest.raises(TrajectoryError, match=r"speed .* must be above 0 and at most 1 .* a verdict of its own"):
        override_speed(Playback.of(placed), 100, rate, ALLOWED)
    with pytest.raises(TrajectoryError, match="must be above 0 and at most 1"):
        Playback.of(placed, rate)


def test_a_motion_that_would_last_too_long_is_refused_with_the_least_speed(placed):
    with pytest.raises(TrajectoryError, match=r"would last \d+ s; at most 300 s .* ask for 0\.025 or more"):
        override_speed(Playback.of(placed), 100, 0.001, ALLOWED)


@pytest.mark.parametrize("index", [-1, 10_000_000])
def test_a_moment_outside_of_what_is_commanded_is_refused(index, placed):
    with pytest.raises(TrajectoryError, match=rf"cannot change the speed at sample {index}; .* 0 to \d+"):
        override_speed(Playback.of(placed), index, 0.5, ALLOWED)


def test_where_no_change_keeps_the_limits_that_is_said(placed):
    tight = replace(LIMITS, qdd=np.max(np.abs(placed.qdd), axis=0) * 0.5, qddd=np.full(7, 1.0))
    with pytest.raises(TrajectoryError, match=r"no change from speed 1 to 0\.5 keeps .* the speed stays"):
        override_speed(Playback.of(placed), int(np.argmax(np.linalg.norm(placed.qd, axis=1))), 0.5, tight)


def test_a_speed_whose_later_part_breaks_a_limit_is_refused_even_where_its_change_does_not(placed):
    slow = Playback.of(placed, 0.3)
    event = placed.gripper[0]
    dwelling = int(np.searchsorted(slow.clock[:, PROGRESS], (event.time + event.dwell / 3) / SAMPLE_TIME))
    narrow = replace(LIMITS, qd=np.abs(placed.qd).max(axis=0) * 0.6)
    assert override_speed(slow, dwelling, 0.5, narrow).clock[-1, RATE] == 0.5
    with pytest.raises(TrajectoryError, match="the speed stays"):
        override_speed(slow, dwelling, 1.0, narrow)


def test_a_change_within_the_rise_of_another_never_goes_faster_than_what_was_judged(placed):
    for begin in range(1000, 6500, 1100):
        rising = override_speed(Playback.of(placed, 0.9), begin, 1.0, ALLOWED)
        for index in np.flatnonzero(rising.clock[:, SLOPE])[::5]:
            slower = override_speed(rising, int(index), 0.3, ALLOWED)
            stop = stop_on_path(rising, int(index), LIMITS)
            for rate in (slower.clock[:, RATE], stop.clock[:, RATE]):
                assert 0.0 <= rate.min() <= rate.max() <= 1.0 + 1e-9


def test_a_resting_trajectory_changes_its_speed_at_once():
    rest = Trajectory(np.tile(REST, (500, 1)), np.zeros((500, 7)), np.zeros((500, 7)))
    result = assert_changes(Playback.of(rest), 100, 0.5)
    assert result.clock[105, RATE] == 0.5


@pytest.mark.parametrize("now", [(10.0, 1.0, 0.0), (3.5, 0.4, 0.002), (7.2, 0.8, -0.003)])
@pytest.mark.parametrize("target", [0.0, 0.3, 1.0])
def test_a_ramp_is_a_continuous_clock_with_a_bounded_bend_from_what_is_to_the_target(now, target):
    clock = np.vstack([now, ramp(np.array(now), target, 0.2)])
    assert clock[-1, RATE] == target
    assert clock[-1, SLOPE] == 0.0
    # Progress is the integral of the rate, the rate that of the slope: exact for cubics but for the two bends.
    rate, slope = clock[:, RATE], clock[:, SLOPE]
    bend = np.abs(np.diff(slope)).max()
    assert np.abs(np.diff(clock[:, PROGRESS]) - (rate[1:] + rate[:-1]) / 2.0).max() <= bend + 1e-12
    assert np.abs(np.diff(rate) - (slope[1:] + slope[:-1]) / 2.0).max() <= bend + 1e-12
    assert bend <= (abs(slope[0]) + 2.0 * abs(target - now[1]) / 160.0 + 1e-12) / 40.0 * 2.0
