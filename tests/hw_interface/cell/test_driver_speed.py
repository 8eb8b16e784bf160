"""The driver at other speeds: the certified path by a slower clock, within limits, watched by the same samples."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.robot_side.perfect_robot import certificate, gate, perfect_driver, swing
from control.errors import RefusedError
from control.robot.limits import REST_Q, panda_limits
from control.safety.limits import SafetyLimits
from control.trajectory.samples import SAMPLE_TIME, Trajectory
from hw_interface.cell.driver import Driver
from hw_interface.simulated.fake_backend import PerfectRobot
from tests.hw_interface.cell.test_driver import PICK, play, ticks

SAFETY = SafetyLimits()


def started(motion: Trajectory, speed: float | None = None) -> tuple[Driver, PerfectRobot, str]:
    driver, robot = perfect_driver(object_width=0.04)
    return driver, robot, driver.submit(motion, certificate(motion), speed).serial


def to_rest(driver: Driver, most: int = 60_000) -> None:
    for _ in range(most):
        if not driver.moving:
            return
        driver.tick()
    raise AssertionError("the motion does not end")


def assert_within_limits(robot: PerfectRobot, velocity: float, acceleration: float) -> None:
    limits = panda_limits().scaled(velocity, acceleration)
    commanded = np.array([q for q, _ in robot.commands])
    padded = np.concatenate([np.repeat(commanded[:1], 3, 0), commanded])
    for order, limit in ((1, limits.qd), (2, limits.qdd), (3, limits.qddd)):
        difference = np.diff(padded, order, axis=0) / SAMPLE_TIME**order
        assert (np.abs(difference) <= limit + 1e-5).all(), f"derivative {order}"


def assert_refused(code: str, text: str, act) -> None:
    with pytest.raises(RefusedError, match=text) as caught:
        act()
    assert caught.value.code == code


def test_a_motion_at_a_third_of_its_speed_takes_three_times_as_long_and_ends_where_it_should():
    motion = swing(1.0, 0.3)
    driver, robot, serial = started(motion, 0.3)
    to_rest(driver)
    assert len(robot.commands) == pytest.approx(len(motion.q) / 0.3, abs=5)
    np.testing.assert_array_equal(robot.commands[-1][0], motion.q[-1])
    assert_within_limits(robot, SAFETY.velocity_scale * 0.3, SAFETY.acceleration_scale * 0.09)
    result = driver.result(serial)
    assert (result.outcome, result.played, result.samples) == ("completed", len(motion.q), len(motion.q))
    assert set(result.speed[1:-1]) == {0.3}


def test_a_motion_that_becomes_slower_on_the_way_keeps_path_and_limits_and_the_record_says_so():
    motion = swing(1.0, 0.3)
    driver, robot, serial = started(motion)
    ticks(driver, 400)
    driver.set_speed(0.2)
    assert driver.state().speed == 1.0 and driver.state().speed_wanted == 0.2
    ticks(driver, 500)
    assert driver.state().speed == 0.2
    to_rest(driver)
    assert_within_limits(robot, SAFETY.velocity_scale, SAFETY.acceleration_scale)
    commanded = np.array([q for q, _ in robot.commands])
    np.testing.assert_allclose(commanded[:, 1:], np.tile(REST_Q[1:], (len(commanded), 1)), atol=1e-12)
    assert (np.diff(commanded[:, 0]) >= -1e-12).all(), "it must not back up"
    result = driver.result(serial)
    assert (result.outcome, result.played) == ("completed", len(motion.q))
    assert result.speed[1] == 1.0 and result.speed[-1] == 0.2
    assert driver.state().speed == 0.0, "it rests"


def test_until_the_speed_changes_exactly_the_certified_samples_are_commanded():
    motion = swing(1.0, 0.3)
    driver, robot, _ = started(motion)
    ticks(driver, 300)
    driver.set_speed(0.5)
    np.testing.assert_array_equal([q for q, _ in robot.commands], motion.q[:300])


def test_speeds_that_follow_each_other_quickly_keep_the_limits():
    motion = swing(2.0, 0.6)
    driver, robot, serial = started(motion)
    rng = np.random.default_rng(0)
    for speed in rng.uniform(0.05, 1.0, 30):
        driver.set_speed(float(speed))
        ticks(driver, int(rng.integers(1, 60)))
    driver.set_speed(1.0)
    to_rest(driver)
    assert_within_limits(robot, SAFETY.velocity_scale, SAFETY.acceleration_scale)
    np.testing.assert_array_equal(robot.commands[-1][0], motion.q[-1])
    assert driver.result(serial).outcome == "completed"


def test_a_speed_that_is_set_stays_for_the_motions_after_it():
    driver, robot = perfect_driver()
    driver.set_speed(0.5)
    assert driver.state().speed_wanted == 0.5
    there = swing(0.4, 0.02)
    play(driver, there)
    assert len(robot.commands) == pytest.approx(2 * len(there.q), abs=5)
    back = swing(0.4, -0.02, start=there.q[-1])
    play(driver, back, 1.0)
    assert driver.state().speed_wanted == 1.0
    assert len(robot.commands) == pytest.approx(3 * len(there.q), abs=10)


@pytest.mark.parametrize("speed", [0.0, -0.5, 1.01, float("nan")])
def test_a_speed_that_was_not_judged_is_refused_and_changes_nothing(speed: float):
    motion = swing(1.0, 0.3)
    driver, robot, _ = started(motion)
    ticks(driver, 300)
    assert_refused("bad_speed", "above 0 and at most 1", lambda: driver.set_speed(speed))
    to_rest(driver)
    np.testing.assert_array_equal([q for q, _ in robot.commands[: len(motion.q)]], motion.q)
    again = swing(1.0, 0.01, start=motion.q[-1])
    assert_refused("bad_speed", "a verdict of its own", lambda: driver.submit(again, certificate(again), speed))
    assert not driver.moving and driver.state().speed_wanted == 1.0


def test_a_speed_so_slow_that_the_scene_would_be_out_of_date_is_refused():
    motion = swing(1.0, 0.3)
    driver, _, _ = started(motion)
    ticks(driver, 300)
    assert_refused("too_slow", "at most 300 s are played .* or more", lambda: driver.set_speed(0.001))
    assert driver.state().speed_wanted == 1.0
    to_rest(driver)
    again = swing(1.0, 0.01, start=motion.q[-1])
    assert_refused("too_slow", "would last", lambda: driver.submit(again, certificate(again), 0.001))
    assert play(driver, again), "its certificate is still good"


def test_where_no_change_keeps_the_limits_the_speed_stays_and_the_reason_is_given():
    motion = swing(0.5, 0.001)
    driver, robot, _ = started(motion)
    strict = replace(gate(), safety=SafetyLimits(acceleration_scale=1e-9))
    ticks(driver, 250)
    driver.gate = strict
    assert_refused("no_ramp", "no change from speed 1 to 0.4 keeps", lambda: driver.set_speed(0.4))
    assert driver.state().speed_wanted == 1.0
    to_rest(driver)
    np.testing.assert_array_equal([q for q, _ in robot.commands[: len(motion.q)]], motion.q)


def test_what_a_speed_leads_to_is_held_against_torque_limits_before_it_is_played():
    driver, _ = perfect_driver()
    driver.gate = replace(gate(), torque=lambda q, qd, qdd: 100.0 * (q - np.array(REST_Q)) + 3.0 * qdd)
    motion = swing(1.0, 0.3)
    driver.submit(motion, certificate(motion))
    ticks(driver, 500)
    driver.set_speed(0.3)
    rows = []
    while driver.moving:
        rows.append(np.array(driver.state().q_d))
        driver.tick()
    q = np.array(rows)
    tau = 100.0 * (q[2:] - np.array(REST_Q)) + 3.0 * np.diff(q, 2, axis=0) / SAMPLE_TIME**2
    assert np.abs(np.diff(tau, axis=0)).max() / SAMPLE_TIME <= panda_limits().taud[0] + 1e-3
    driver.gate = replace(gate(), torque=lambda q, qd, qdd: np.full_like(q, 1e4))
    refused = swing(1.0, 0.01, start=q[-1])
    assert_refused("breaks_limit", "torque", lambda: driver.submit(refused, certificate(refused)))


def test_a_change_that_does_not_pass_the_gate_is_not_played():
    motion = swing(1.0, 0.3)
    driver, robot, _ = started(motion)
    ticks(driver, 300)

    def a_metre_a_millisecond(q: np.ndarray) -> np.ndarray:
        poses = np.tile(np.eye(4), (len(q), 1, 1))
        poses[:, 0, 3] = np.arange(len(q))
        return poses

    driver.gate = replace(gate(), tcp=a_metre_a_millisecond)
    assert_refused("breaks_limit", "check hand_speed", lambda: driver.set_speed(0.5))
    assert driver.state().speed_wanted == 1.0
    to_rest(driver)
    np.testing.assert_array_equal([q for q, _ in robot.commands[: len(motion.q)]], motion.q)


@pytest.mark.parametrize("speed", [0.1, 0.5])
@pytest.mark.parametrize("after", [5, 60, 400])  # within the change of speed, and after it
def test_a_stop_from_any_speed_comes_to_rest_on_the_path_and_stays_until_acknowledged(speed: float, after: int):
    motion = swing(1.5, 0.5)
    driver, robot, serial = started(motion)
    ticks(driver, 600)
    driver.set_speed(speed)
    ticks(driver, after)
    driver.stop()
    assert driver.mode == "stopping"
    assert_refused("busy", "set the speed when it rests", lambda: driver.set_speed(0.9))
    to_rest(driver, 1500)
    assert driver.mode == "stopped"
    assert_within_limits(robot, 1.0, 1.0)
    commanded = np.array([q for q, _ in robot.commands])
    assert (np.diff(commanded[:, 0]) >= -1e-12).all(), "it must not back up"
    assert commanded[-1, 0] < motion.q[-1, 0]
    result = driver.result(serial)
    assert result.outcome == "stopped" and result.speed[-1] == 0.0
    assert motion.q[result.played - 1, 0] == pytest.approx(commanded[-1, 0], abs=1e-3), "progress counts its samples"
    again = swing(0.5, -0.01, start=commanded[-1])
    assert_refused("needs_acknowledge", "acknowledge", lambda: driver.submit(again, certificate(again)))
    driver.acknowledge()
    play(driver, again, 1.0)
    assert driver.mode == "idle"


def test_a_stop_in_a_slowed_dwell_rests_at_once():
    driver, _, serial = started(PICK, 0.5)
    event = PICK.gripper[0]
    while driver.state().progress < round((event.time + event.dwell / 2) / SAMPLE_TIME):
        driver.tick()
    before = driver.state().q_d
    driver.stop()
    to_rest(driver, 5)
    assert driver.state().q_d == before
    assert driver.result(serial).outcome == "stopped"


@pytest.mark.parametrize("speed", [0.3, 0.77])
def test_a_pick_at_another_speed_gives_every_gripper_command_once_with_the_arm_at_rest(speed: float):
    driver, robot, serial = started(PICK, speed)
    given: list[tuple[int, int]] = []
    known = 0
    while driver.moving:
        driver.tick()
        if len(robot.gripper_commands) > known:
            known = len(robot.gripper_commands)
            given.append((len(robot.commands), driver.state().progress))
    assert driver.result(serial).outcome == "completed", driver.result(serial).trouble
    assert robot.gripper_commands == [e.command for e in PICK.gripper]
    for (row, progress), event in zip(given, PICK.gripper, strict=True):
        assert progress == pytest.approx(event.time / SAMPLE_TIME + 1, abs=1)
        rest = [q for q, _ in robot.commands[row - 1 : row + round(event.dwell / SAMPLE_TIME / speed) - 5]]
        assert np.ptp(rest, axis=0).max() < 1e-9


def test_a_gripper_that_needs_longer_than_its_dwell_is_in_time_when_the_motion_is_slower():
    def slow_to_finish(driver: Driver, robot: PerfectRobot) -> str:
        begun: list[int] = []

        def busy_for_three_seconds(m):
            if robot.gripper_commands and not begun:
                begun.append(len(robot.commands))
            waiting = bool(begun) and len(robot.commands) - begun[0] < 3000
            return replace(m, gripper_busy=waiting or m.gripper_busy)

        robot.distort = busy_for_three_seconds
        to_rest(driver)
        return driver.state().mode

    for speed, mode in ((1.0, "reflex"), (0.5, "idle")):
        driver, robot, _ = started(PICK, speed)
        assert slow_to_finish(driver, robot) == mode


def test_an_object_that_slips_away_stops_a_slowed_motion_where_it_is_expected_in_the_hand():
    driver, robot, _ = started(PICK, 0.4)
    while driver.state().progress < 2000:
        driver.tick()
    assert driver.state().grasped
    robot.object_width = None
    ticks(driver, 400)
    error = driver.state().last_error
    assert driver.mode == "reflex" and error is not None and error.code == "lost_grasp"
    assert "red_cube slipped out of the gripper at 2." in error.reason, "at the certified motion's time"
    assert_within_limits(robot, 1.0, 1.0)


def test_an_arm_that_is_held_back_is_noticed_at_any_speed():
    driver, robot, _ = started(swing(1.0, 0.5), 0.2)
    held = np.array(REST_Q)
    robot.distort = lambda m: replace(m, q=held)
    ticks(driver, 5000)
    error = driver.state().last_error
    assert driver.mode == "reflex" and error is not None and error.code == "tracking_error"


def test_a_speed_can_be_set_between_acceptance_and_the_first_sample():
    motion = swing(0.5, 0.05)
    driver, robot, serial = started(motion)
    driver.set_speed(0.5)
    to_rest(driver)
    assert driver.result(serial).outcome == "completed"
    np.testing.assert_array_equal(robot.commands[0][0], motion.q[0])
    np.testing.assert_array_equal(robot.commands[-1][0], motion.q[-1])
