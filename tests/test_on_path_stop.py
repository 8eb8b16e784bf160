"""From any moment of a motion the arm comes to rest on its own path, within the limits."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from control.errors import TrajectoryError
from control.limits import panda_limits
from control.on_path_stop import StopMotion, stop_on_path
from control.retime import retime
from control.robot import RobotModel
from control.safety import SafetyLimits
from control.trajectory import SAMPLE_TIME, JointPath, PathSegment, Trajectory
from control.trajectory_checks import check_trajectory
from tests.arm_paths import REST, pick_and_place, random_path

LIMITS = panda_limits()
SAFETY = SafetyLimits()
PUBLISHED = replace(SAFETY, velocity_scale=1.0, acceleration_scale=1.0, joint_margin=0.0)


@pytest.fixture(scope="module")
def robot() -> RobotModel:
    return RobotModel.panda()


@pytest.fixture(scope="module")
def placed(robot) -> Trajectory:
    return retime(pick_and_place(robot), robot, LIMITS, SAFETY)


def played(trajectory: Trajectory, index: int, stop: StopMotion) -> Trajectory:
    """What the arm was commanded in all: the trajectory up to `index`, then the stop."""
    kept = slice(0, index + 1)
    q, qd, qdd = (
        np.concatenate([before[kept], after])
        for before, after in ((trajectory.q, stop.q), (trajectory.qd, stop.qd), (trajectory.qdd, stop.qdd))
    )
    if index > 0:  # where they meet, the trajectory's own derivatives still tell of how it would have gone on
        qd[index] = (q[index + 1] - q[index - 1]) / (2.0 * SAMPLE_TIME)
        qdd[index] = (q[index + 1] - 2.0 * q[index] + q[index - 1]) / SAMPLE_TIME**2
    return Trajectory(q, qd, qdd)


def distance_from_path(trajectory: Trajectory, q: np.ndarray, low: float, high: float) -> float:
    """Largest joint difference of samples from the trajectory's own curve between two moments, in [rad].

    The curve is the cubic spline through the samples; along it each sample's nearest point is found by projecting on
    the tangent a few times.
    """
    first, last = max(0, int(low) - 30), min(len(trajectory.q), int(np.ceil(high)) + 31)
    curve = make_interp_spline(np.arange(first, last), trajectory.q[first:last], k=3)
    dense = np.linspace(low, high, 20 * max(2, int(high - low)))
    points = curve(dense)
    worst = 0.0
    for sample in q:
        at = dense[np.argmin(np.sum((points - sample) ** 2, axis=1))]
        for _ in range(3):
            tangent = curve(at, nu=1)
            at = np.clip(at + (sample - curve(at)) @ tangent / max(tangent @ tangent, 1e-18), low, high)
        worst = max(worst, float(np.max(np.abs(sample - curve(at)))))
    return worst


def assert_stops(trajectory: Trajectory, index: int) -> StopMotion:
    stop = stop_on_path(trajectory, index, LIMITS)
    assert not [c for c in check_trajectory(played(trajectory, index, stop), LIMITS, PUBLISHED) if not c.ok]
    assert index <= stop.progress <= len(trajectory.q) - 1
    assert not stop.qd[-1].any()
    assert not stop.qdd[-1].any()
    # Interpolation between samples a millisecond apart is good to far less than a microradian.
    assert distance_from_path(trajectory, stop.q, index, stop.progress) < 1e-6
    return stop


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
    lengths = [len(stop_on_path(placed, index, LIMITS).q) for index in range(0, len(placed.q), 50)]
    # From the fastest allowed speed a joint needs 0.8 qd / qdd, at most 0.24 s, plus the ramps.
    assert max(lengths) < 450
    assert np.median(lengths) < 250


def test_samples_of_the_stop_advance_along_the_trajectory_without_turning_back(placed):
    index = int(np.argmax(np.linalg.norm(placed.qd, axis=1)))
    stop = stop_on_path(placed, index, LIMITS)
    forward = placed.qd[index]
    steps = np.diff(np.concatenate([placed.q[index : index + 1], stop.q]), axis=0) @ forward
    assert np.all(steps >= -1e-9)
    assert stop.progress > index + 5  # it was moving, so it cannot stop at once


def test_an_arm_that_dwells_stops_at_once(placed):
    for event in placed.gripper:
        for moment in (event.time, event.time + event.dwell / 2, event.time + event.dwell):
            index = round(moment / 1e-3)
            stop = assert_stops(placed, index)
            assert stop.progress == index
            assert np.array_equal(stop.q, placed.q[index : index + 1])


def test_before_the_start_and_at_the_end_it_stops_at_once(placed):
    assert len(assert_stops(placed, 0).q) == 1
    stop = assert_stops(placed, len(placed.q) - 1)
    assert np.array_equal(stop.q, placed.q[-1:])
    assert stop.progress == len(placed.q) - 1


def test_shortly_before_the_end_it_never_passes_the_end(placed):
    for before in range(1, 120, 7):
        stop = assert_stops(placed, len(placed.q) - 1 - before)
        assert len(stop.q) <= before + 60


def test_a_trajectory_without_room_below_its_limits_is_played_to_its_end(placed):
    tight = replace(
        LIMITS,
        qdd=np.max(np.abs(placed.qdd), axis=0) * 0.5,
        qddd=np.full(7, 1.0),
    )
    index = int(np.argmax(np.linalg.norm(placed.qd, axis=1)))
    stop = stop_on_path(placed, index, tight)
    assert stop.progress == len(placed.q) - 1
    assert np.array_equal(stop.q[:-1], placed.q[index + 1 :])


@pytest.mark.parametrize("index", [-1, 10_000_000])
def test_a_moment_outside_the_trajectory_is_refused(index, placed):
    with pytest.raises(TrajectoryError, match=rf"cannot stop at sample {index}; the trajectory has samples 0 to \d+"):
        stop_on_path(placed, index, LIMITS)


def test_a_resting_trajectory_stops_at_once():
    rest = Trajectory(np.tile(REST, (5, 1)), np.zeros((5, 7)), np.zeros((5, 7)))
    for index in range(5):
        assert stop_on_path(rest, index, LIMITS).progress == index
