"""Retimed paths keep every limit, stay on the path, and stop where the gripper acts."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.sparse import csr_matrix
from scipy.spatial import KDTree

from benchmarks.motion.arm_paths import GRASP, OPEN, REST, noisy, pick_and_place, polyline, random_path
from control.errors import ConfigError, RetimingError
from control.retiming import path_dynamics
from control.retiming.bounds import MotionBounds
from control.retiming.path_smoothing import smooth_path
from control.retiming.retime import retime, retime_with_report
from control.retiming.segment_timing import RetimingOptions
from control.retiming.toppra_profile import LARGE_SPEED, PathBounds, fastest_profile
from control.robot.dynamics import Payload, RobotModel
from control.robot.limits import panda_limits
from control.safety.limits import SafetyLimits
from control.safety.trajectory_checks import check_trajectory
from control.trajectory.samples import SAMPLE_TIME, JointPath, PathSegment, Trajectory

pytestmark = pytest.mark.filterwarnings("ignore:invalid escape sequence:DeprecationWarning")  # toppra's docstrings
LIMITS = panda_limits()
SAFETY = SafetyLimits()
TOLERANCE = RetimingOptions().tolerance


@pytest.fixture(scope="module")
def robot() -> RobotModel:
    return RobotModel.panda()


@pytest.fixture(scope="module")
def placed(robot):
    path = pick_and_place(robot)
    return path, *retime_with_report(path, robot, LIMITS, SAFETY)


def single(q: np.ndarray, **changes) -> JointPath:
    return JointPath((PathSegment("reach", q, **changes),))


def assert_all_limits_kept(trajectory: Trajectory, robot: RobotModel, safety: SafetyLimits = SAFETY) -> None:
    results = check_trajectory(trajectory, LIMITS, safety, robot.torque, robot.tcp_poses)
    assert len(results) == 15
    assert not [r for r in results if not r.ok]


def distance_from_polyline(q: np.ndarray, waypoints: np.ndarray) -> float:
    """Largest joint difference of any sample from the nearest point of the polyline, in [rad]."""
    dense = polyline(waypoints, 5e-4)
    _, nearest = KDTree(dense).query(q)
    return float(np.max(np.abs(q - dense[nearest])))


# The nearest of points 0.5 mrad apart may be 0.25 mrad off along the path.
SEARCH_ERROR = 2.5e-4


@pytest.mark.parametrize("seed", range(6))
def test_random_polylines_keep_every_limit_and_stay_within_the_tolerance(seed, robot):
    rng = np.random.default_rng(seed)
    waypoints = random_path(rng, 3, spread=None if seed % 2 else 0.3)
    trajectory, report = retime_with_report(single(waypoints), robot, LIMITS, SAFETY)
    assert_all_limits_kept(trajectory, robot)
    assert report.deviation <= TOLERANCE
    assert distance_from_polyline(trajectory.q, waypoints) <= TOLERANCE + SEARCH_ERROR


@pytest.mark.parametrize("seed", range(4))
def test_noisy_waypoints_are_smoothed_within_the_tolerance_and_keep_every_limit(seed, robot):
    rng = np.random.default_rng(100 + seed)
    waypoints = noisy(polyline(random_path(rng, 2, spread=0.3), 0.02), rng, 0.0005)
    trajectory, report = retime_with_report(single(waypoints), robot, LIMITS, SAFETY)
    assert_all_limits_kept(trajectory, robot)
    assert report.deviation <= TOLERANCE
    # Noise of half a milliradian must not make the arm creep along it: compare with the clean path's duration.
    clean = retime(single(polyline(waypoints[[0, -1]])), robot, LIMITS, SAFETY)
    assert trajectory.duration < 6.0 * clean.duration


def test_every_corner_of_the_path_is_visited_within_the_tolerance(robot):
    waypoints = random_path(np.random.default_rng(7), 3)
    trajectory = retime(single(waypoints), robot, LIMITS, SAFETY)
    _, nearest = KDTree(trajectory.q).query(waypoints)
    assert np.max(np.abs(trajectory.q[nearest] - waypoints)) <= TOLERANCE + 2e-3  # samples are up to 2 mrad apart


def test_a_straight_joint_segment_stays_straight(robot):
    goal = REST + np.array([0.4, 0.3, -0.2, 0.5, 0.1, 0.3, -0.6])
    trajectory, report = retime_with_report(single(polyline(np.array([REST, goal]))), robot, LIMITS, SAFETY)
    share = (trajectory.q - REST) @ (goal - REST) / np.sum((goal - REST) ** 2)
    assert np.max(np.abs(trajectory.q - REST - share[:, None] * (goal - REST))) < 1e-9
    assert report.deviation < 1e-9


def test_a_tighter_tolerance_is_kept_too(robot):
    waypoints = random_path(np.random.default_rng(3), 2, spread=0.3)
    options = RetimingOptions(tolerance=0.0005)
    trajectory, report = retime_with_report(single(waypoints), robot, LIMITS, SAFETY, options)
    assert 0.0 < report.deviation <= 0.0005
    assert distance_from_polyline(trajectory.q, waypoints) <= 0.0005 + SEARCH_ERROR
    assert_all_limits_kept(trajectory, robot)


def test_pick_and_place_keeps_every_limit_and_is_near_the_bound(placed, robot):
    _, trajectory, report = placed
    assert_all_limits_kept(trajectory, robot)
    assert 1.0 <= report.ratio < 1.06
    assert 5.0 < trajectory.duration < 10.0


def test_first_and_last_sample_are_the_first_and_last_waypoint_exactly(placed):
    path, trajectory, _ = placed
    assert np.array_equal(trajectory.q[0], path.segments[0].q[0])
    assert np.array_equal(trajectory.q[-1], path.segments[-1].q[-1])


def test_segments_join_at_rest_exactly_on_their_shared_waypoint(placed):
    path, trajectory, _ = placed
    moving = [s for s in trajectory.segments if s.name not in ("grasp", "move")]
    assert [s.name for s in moving] == [s.name for s in path.segments]
    for stretch, segment in zip(moving, path.segments, strict=True):
        last = stretch.stop - 1
        assert np.array_equal(trajectory.q[last], segment.q[-1])
        assert not trajectory.qd[last].any()
        assert not trajectory.qdd[last].any()


def test_stretches_cover_all_samples_and_carry_what_is_held_and_may_touch(placed):
    _, trajectory, _ = placed
    stretches = trajectory.segments
    assert stretches[0].start == 0
    assert stretches[-1].stop == len(trajectory.q)
    assert all(a.stop == b.start for a, b in itertools.pairwise(stretches))
    held = {s.name: s.held for s in stretches}
    assert held["carry"] == "red_cube"
    assert held["grasp"] is None and held["move"] is None and held["home"] is None
    assert {s.name: s.touching for s in stretches}["move"] == (("red_cube", "crate"),)


def test_the_arm_rests_for_the_whole_dwell_of_each_gripper_event(placed):
    _, trajectory, _ = placed
    assert [e.command for e in trajectory.gripper] == [GRASP, OPEN]
    assert [e.dwell for e in trajectory.gripper] == [0.8, 0.5]
    for event in trajectory.gripper:
        first, last = round(event.time / SAMPLE_TIME), round((event.time + event.dwell) / SAMPLE_TIME)
        assert np.ptp(trajectory.q[first : last + 1], axis=0).max() == 0.0
        assert not trajectory.qd[first : last + 1].any()
        assert np.ptp(trajectory.q[first - 20 : first], axis=0).max() > 0.0  # and it moved until then


def test_hand_speeds_are_kept_where_they_bind(robot):
    slow = replace(SAFETY, hand_speed=0.1, hand_angular_speed=0.3)
    trajectory = retime(single(random_path(np.random.default_rng(1), 1, 0.3)), robot, LIMITS, slow)
    checks = {c.name: c for c in check_trajectory(trajectory, LIMITS, slow, robot.torque, robot.tcp_poses)}
    assert all(c.ok for c in checks.values())
    used = max(checks["hand_speed"].worst / 0.1, checks["hand_angular_speed"].worst / 0.3)
    assert used > 0.95  # a limit that is kept by creeping would be no use


@pytest.mark.parametrize("scale", [0.5, 0.1])
def test_speed_scale_slows_a_segment_down(scale, robot):
    waypoints = random_path(np.random.default_rng(2), 2, 0.3)
    full = retime(single(waypoints), robot, LIMITS, SAFETY)
    slowed = retime(single(waypoints, speed_scale=scale), robot, LIMITS, SAFETY)
    slower = replace(
        SAFETY,
        velocity_scale=SAFETY.velocity_scale * scale,
        hand_speed=SAFETY.hand_speed * scale,
        hand_angular_speed=SAFETY.hand_angular_speed * scale,
    )
    assert_all_limits_kept(slowed, robot, slower)
    assert slowed.duration > full.duration


@pytest.mark.parametrize("size", [1e-3, 1e-4, 1e-5, 1e-7])
def test_tiny_moves_arrive_and_keep_every_limit(size, robot):
    goal = REST + size * np.array([1.0, -1.0, 0.5, 1.0, -0.3, 0.2, 1.0])
    trajectory = retime(single(np.array([REST, goal])), robot, LIMITS, SAFETY)
    assert np.array_equal(trajectory.q[-1], goal)
    assert trajectory.duration < 0.2
    assert_all_limits_kept(trajectory, robot)


def test_repeated_waypoints_make_no_difference(robot):
    waypoints = random_path(np.random.default_rng(4), 2, 0.3)
    once = retime(single(waypoints), robot, LIMITS, SAFETY)
    thrice = retime(single(np.repeat(waypoints, 3, axis=0)), robot, LIMITS, SAFETY)
    assert np.array_equal(once.q, thrice.q)


def test_a_path_that_turns_back_on_itself_is_retimed(robot):
    waypoints = polyline(np.array([REST, REST + 0.3, REST]))
    trajectory = retime(single(waypoints), robot, LIMITS, SAFETY)
    assert_all_limits_kept(trajectory, robot)
    assert np.max(trajectory.q - REST) >= 0.3 - TOLERANCE


def test_a_path_along_the_joint_margin_never_leaves_it(robot):
    edge = LIMITS.q_max[6] - SAFETY.joint_margin
    corners = np.array([REST, [*REST[:6], edge], [*(REST[:6] + 0.2), edge], REST + 0.1])
    assert_all_limits_kept(retime(single(polyline(corners)), robot, LIMITS, SAFETY), robot)


def test_a_segment_without_motion_is_dropped(robot):
    still = PathSegment("escape", np.repeat(REST[None], 4, axis=0))
    move = PathSegment("reach", np.array([REST, REST + 0.1]))
    trajectory = retime(JointPath((still, move)), robot, LIMITS, SAFETY)
    assert [s.name for s in trajectory.segments] == ["reach"]
    assert trajectory.segments[0].start == 0


def test_a_segment_without_motion_but_a_gripper_command_is_one_dwell(robot):
    still = PathSegment("approach", REST[None], GRASP)
    trajectory = retime(JointPath((still,)), robot, LIMITS, SAFETY, RetimingOptions(grasp_dwell=0.3))
    assert [s.name for s in trajectory.segments] == ["grasp"]
    assert trajectory.duration == pytest.approx(0.3)
    assert trajectory.gripper[0].time == 0.0
    assert_all_limits_kept(trajectory, robot)


def test_a_path_without_any_motion_is_a_trajectory_that_rests(robot):
    trajectory = retime(single(REST[None]), robot, LIMITS, SAFETY)
    assert len(trajectory.q) == 2
    assert [(s.start, s.stop) for s in trajectory.segments] == [(0, 2)]
    assert_all_limits_kept(trajectory, robot)


def test_retiming_is_deterministic(placed, robot):
    path, trajectory, _ = placed
    assert retime(path, robot, LIMITS, SAFETY).content_hash() == trajectory.content_hash()


def test_a_payload_makes_the_motion_no_faster_and_still_keeps_torques():
    loaded = RobotModel.panda(payload_mass=3.0, payload_com=(0.0, 0.0, 0.05))
    waypoints = random_path(np.random.default_rng(5), 2, 0.4)
    trajectory = retime(single(waypoints), loaded, LIMITS, SAFETY)
    assert_all_limits_kept(trajectory, loaded)


def test_a_load_that_the_arm_cannot_hold_is_refused_by_segment_and_limit():
    heavy = RobotModel.panda(payload_mass=30.0)
    with pytest.raises(
        RetimingError,
        match=r"segment 'reach' breaks torque even at rest at waypoint \d \(\d+ % of .*\): joint \d needs .* Nm",
    ):
        retime(single(np.array([REST, REST + 0.2])), heavy, LIMITS, SAFETY)


def test_a_limit_that_no_stretch_can_keep_is_named(robot):
    frozen = replace(LIMITS, taud=np.full(7, 1e-6))
    with pytest.raises(
        RetimingError,
        match=r"segment 'reach' has no timing that keeps torque_rate of joint \d at waypoint \d \(\d+ % of .*\)",
    ):
        retime(single(np.array([REST, REST + 0.05])), robot, frozen, SAFETY)


def test_waypoints_outside_the_joint_margin_are_refused_by_joint_and_value(robot):
    outside = REST.copy()
    outside[3] = -0.05
    with pytest.raises(
        RetimingError, match=r"segment 'reach' breaks joint_position at waypoint 1: joint 4 is at -0\.05"
    ):
        retime(single(np.array([REST, outside])), robot, LIMITS, SAFETY)


def test_segments_that_do_not_join_are_refused(robot):
    first = PathSegment("reach", np.array([REST, REST + 0.1]))
    second = PathSegment("approach", np.array([REST + 0.2, REST]))
    with pytest.raises(RetimingError, match=r"segment 'approach' starts 0\.1 rad away from where the segment before"):
        retime(JointPath((first, second)), robot, LIMITS, SAFETY)


@pytest.mark.parametrize(
    ("segment", "text"),
    [
        (PathSegment("reach", np.zeros((0, 7))), r"has waypoints of shape \(0, 7\)"),
        (PathSegment("reach", np.zeros((3, 6))), r"has waypoints of shape \(3, 6\)"),
        (PathSegment("reach", np.array([REST, REST * np.nan])), "is not finite at waypoint 1, joint 1"),
        (PathSegment("reach", np.array([REST, REST + 0.1]), speed_scale=0.0), "has speed_scale 0.0"),
    ],
)
def test_malformed_segments_are_refused_by_name(segment, text, robot):
    with pytest.raises(RetimingError, match=f"segment 'reach' {text}"):
        retime(JointPath((segment,)), robot, LIMITS, SAFETY)


def test_a_path_without_segments_is_refused(robot):
    with pytest.raises(RetimingError, match="the path has no segments"):
        retime(JointPath(()), robot, LIMITS, SAFETY)


def corner_bounds(parts: int) -> PathBounds:
    """Speed and acceleration bounds along a path round three corners, on a grid that cuts its knot intervals evenly."""
    waypoints = random_path(np.random.default_rng(11), 3, 0.4)
    path = smooth_path(waypoints, TOLERANCE, LIMITS.q_min, LIMITS.q_max, MotionBounds.of(LIMITS, SAFETY, 1.0))
    cuts = np.diff(path.breaks)[:, None] * np.arange(parts) / parts
    grid = np.append((path.breaks[:-1, None] + cuts).ravel(), path.length)
    first, second = path(grid, 1), path(grid, 2)
    wide = np.broadcast_to(LIMITS.qdd, first.shape)
    return PathBounds(grid, first, second, -wide, wide, 1.0 / np.max(np.abs(first) / LIMITS.qd, axis=1) ** 2)


def test_the_toppra_profile_is_the_optimum_that_a_general_linear_programme_finds():
    bounds = corner_bounds(4)
    profile = fastest_profile(bounds)
    # All grid points at once, in x alone: u of an interval is (x_next - x) / (2 delta), and its rows hold at both ends.
    n = len(bounds.s)
    identity = np.eye(n)
    u = (identity[1:] - identity[:-1]) / (2.0 * np.diff(bounds.s))[:, None]
    rows = [
        bounds.a[end][:, :, None] * u[:, None] + bounds.b[end][:, :, None] * identity[end][:, None]
        for end in (slice(None, -1), slice(1, None))
    ]
    matrix = np.concatenate(rows).reshape(-1, n) / np.tile(LIMITS.qdd, 2 * (n - 1))[:, None]
    assert np.max(np.abs(matrix @ profile.speed**2)) <= 1.0 + 1e-5
    assert np.all(profile.speed**2 <= bounds.cap * (1.0 + 1e-6))
    rest = np.where(np.arange(n) % (n - 1) == 0, 0.0, bounds.cap)
    best = linprog(
        -np.ones(n),
        A_ub=csr_matrix(np.concatenate([matrix, -matrix])),
        b_ub=np.ones(2 * len(matrix)),
        bounds=np.stack([np.zeros(n), rest], axis=1),
    )
    assert best.success
    speed = np.sqrt(np.maximum(best.x, 0.0))
    assert profile.duration == pytest.approx(np.sum(2.0 * np.diff(bounds.s) / (speed[1:] + speed[:-1])), rel=1e-3)
    assert np.count_nonzero(np.abs(matrix @ profile.speed**2) > 0.999) > n / 4  # it is rows that bind


@pytest.mark.parametrize("length", [1e-7, 1.0, 1e4])
@pytest.mark.parametrize("acceleration", [1e-3, 1.0, 1e4])
def test_a_straight_move_takes_the_time_of_the_textbook_at_any_size(length, acceleration):
    s = np.linspace(0.0, length, 201)
    one, top = np.ones((201, 1)), np.sqrt(0.4 * length * acceleration)  # reached after a fifth of the way
    profile = fastest_profile(
        PathBounds(s, one, 0.0 * one, -acceleration * one, acceleration * one, top**2 * one[:, 0])
    )
    assert profile.duration == pytest.approx(length / top + top / acceleration, rel=1e-5)
    free = PathBounds(s, one, 0.0 * one, -acceleration * one, acceleration * one, np.full(201, LARGE_SPEED))
    if length * acceleration < LARGE_SPEED:
        assert fastest_profile(free).duration == pytest.approx(2.0 * np.sqrt(length / acceleration), rel=1e-5)


def test_where_resting_is_not_allowed_there_is_no_timing():
    bounds = corner_bounds(1)
    with pytest.raises(RetimingError, match=r"has no TOPP-RA profile on \d+ grid points \(FailUncontrollable\); r"):
        fastest_profile(replace(bounds, low=bounds.low + 2.0 * LIMITS.qdd, high=bounds.high + 3.0 * LIMITS.qdd))


def test_a_segment_without_a_timing_is_named(robot, monkeypatch):
    def refuse(bounds: PathBounds) -> None:
        raise RetimingError(f"has no TOPP-RA profile on {len(bounds.s)} grid points")

    monkeypatch.setattr(path_dynamics, "fastest_profile", refuse)
    with pytest.raises(RetimingError, match=r"segment 'reach' has no TOPP-RA profile on \d+ grid points"):
        retime(single(np.array([REST, REST + 0.1])), robot, LIMITS, SAFETY)


def test_torques_are_the_same_one_by_one_and_all_at_once(robot):
    q, qd, qdd = np.random.default_rng(0).normal(0.0, 0.5, (3, 20, 7))
    together = robot.torque(q, qd, qdd)
    assert np.array_equal(together, [robot.torque(*row) for row in zip(q, qd, qdd, strict=True)])
    assert np.allclose(robot.gravity(q[0]), robot.torque(q[0], np.zeros(7), np.zeros(7)))


def test_torques_of_many_rows_are_the_same_in_one_call(robot):
    for rows in (0, 1, 2, 500):
        q, qd, qdd = np.random.default_rng(rows).normal(0.0, 0.5, (3, rows, 7))
        assert np.array_equal(robot.torques(q, qd, qdd), robot.torque(q, qd, qdd))
        by_joint = [np.asfortranarray(x) for x in (q, qd, qdd)]
        assert np.array_equal(robot.torques(*by_joint), robot.torque(q, qd, qdd))


def test_a_payload_adds_its_weight_to_the_torques_by_the_jacobian(robot):
    mass = 1.5
    loaded = RobotModel.panda(payload_mass=mass)
    weight = robot.tcp_jacobian(REST)[:3].T @ np.array([0.0, 0.0, 9.81 * mass])
    assert np.allclose(loaded.gravity(REST) - robot.gravity(REST), weight, atol=1e-9)


def test_the_jacobian_is_the_derivative_of_the_pose(robot):
    step = 1e-6
    jacobian, moved = robot.tcp_jacobian(REST), REST
    for joint in range(7):
        moved = REST + step * np.eye(7)[joint]
        change = robot.tcp_pose(moved) - robot.tcp_pose(REST)
        assert np.allclose(change[:3, 3] / step, jacobian[:3, joint], atol=1e-5)
        spin = change[:3, :3] @ robot.tcp_pose(REST)[:3, :3].T / step  # the skew matrix of the angular velocity
        assert np.allclose([spin[2, 1], spin[0, 2], spin[1, 0]], jacobian[3:, joint], atol=1e-5)
    assert np.allclose(robot.tcp_poses(np.array([REST, moved])), [robot.tcp_pose(REST), robot.tcp_pose(moved)])


@pytest.mark.parametrize("changes", [{"payload_mass": -1.0}, {"payload_mass": np.nan}, {"finger_width": 0.1}])
def test_impossible_hands_and_payloads_are_refused(changes):
    with pytest.raises(ConfigError, match=next(iter(changes))):
        RobotModel.panda(**changes)


def test_the_hands_acceleration_and_jerk_are_kept_where_they_bind(robot):
    wide = replace(SAFETY, hand_speed=1.7, hand_angular_speed=2.5)
    path = single(random_path(np.random.default_rng(1), 1, 0.4))
    for names, changes in (
        (
            ("hand_acceleration", "hand_angular_acceleration"),
            {"cartesian_acceleration": 2.0, "angular_acceleration": 4.0},
        ),
        (("hand_jerk", "hand_angular_jerk"), {"cartesian_jerk": 30.0, "angular_jerk": 60.0}),
    ):
        limits = replace(LIMITS, **changes)
        trajectory = retime(path, robot, limits, wide)
        checks = {c.name: c for c in check_trajectory(trajectory, limits, wide, robot.torque, robot.tcp_poses)}
        assert not [c for c in checks.values() if not c.ok]
        assert max(checks[name].worst / checks[name].limit for name in names) > 0.95
        assert trajectory.duration > 1.1 * retime(path, robot, LIMITS, wide).duration


def test_only_segments_that_hold_a_thing_are_timed_with_its_weight(robot):
    payload = Payload(3.0, (0.0, 0.0, 0.05))
    there = polyline(np.vstack([REST, REST + np.array([0.0, 0.5, 0.0, 0.4, 0.0, 0.0, 0.0])]))
    path = JointPath((PathSegment("carry", there, held="brick"), PathSegment("home", there[::-1])))
    fast = replace(SAFETY, velocity_scale=1.0, acceleration_scale=1.0, hand_speed=1.7)
    tight = replace(LIMITS, tau=0.6 * LIMITS.tau)  # so that the weight counts
    _, bare = retime_with_report(path, robot, tight, fast)
    _, other = retime_with_report(path, robot, tight, fast, payloads={"cup": payload})
    trajectory, loaded = retime_with_report(path, robot, tight, fast, payloads={"brick": payload})
    assert [s.duration for s in other.segments] == [s.duration for s in bare.segments]
    assert loaded.segments[0].duration > bare.segments[0].duration
    assert loaded.segments[1].duration == bare.segments[1].duration
    carrying = robot.with_payload(payload)
    held = trajectory.segments[0]
    samples = slice(held.start, held.stop)
    carried = Trajectory(trajectory.q[samples], trajectory.qd[samples], trajectory.qdd[samples])
    checks = check_trajectory(carried, tight, fast, carrying.torque, carrying.tcp_poses)
    assert not [c for c in checks if not c.ok]


def test_a_thing_too_heavy_for_one_segment_is_refused_by_segment_place_and_joint(robot):
    there = polyline(np.vstack([REST, REST + np.array([0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0])]))
    path = JointPath((PathSegment("reach", there), PathSegment("carry", there[::-1], held="anvil")))
    text = (
        r"segment 'carry' breaks torque even at rest at waypoint \d+ \(\d+ % of its length\): joint \d needs \d+\.\d Nm"
    )
    with pytest.raises(RetimingError, match=text):
        retime(path, robot, LIMITS, SAFETY, payloads={"anvil": Payload(12.0)})


@pytest.mark.parametrize("factor", [20.0, 10.0])
def test_at_tight_jerk_limits_a_move_takes_little_more_than_its_joints_need(factor, robot):
    gentle = replace(SAFETY, velocity_scale=0.5, acceleration_scale=0.25, hand_speed=1.7)
    limits = replace(LIMITS, qddd=factor * 0.25 * LIMITS.qdd)
    goal = REST + np.array([0.9, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    trajectory, report = retime_with_report(single(polyline(np.vstack([REST, goal]))), robot, limits, gentle)
    # Up, hold and down with a trapezoid of acceleration: d / v + v / a + a / j.
    v, a = 0.5 * LIMITS.qd[0], 0.25 * LIMITS.qdd[0]
    textbook = 0.9 / v + v / a + 1.0 / factor
    assert textbook - 2e-3 <= report.segments[0].duration < 1.02 * textbook
    checks = check_trajectory(trajectory, limits, gentle, robot.torque, robot.tcp_poses)
    assert not [c for c in checks if not c.ok]
