"""The driver: what it refuses, what it plays, and how it ends a motion early."""

import time
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.robot_side.perfect_robot import certificate, gate, perfect_driver, swing
from control.errors import RefusedError
from control.robot.limits import REST_Q, panda_limits
from control.trajectory.samples import SAMPLE_TIME, GripperCommand, Trajectory
from hw_interface.cell.backend import Measured
from hw_interface.cell.driver import Driver
from tests.support.robot_side.hw_support import joined

PICK = joined(
    np.array(REST_Q) + np.array([[0.0], [0.1], [0.0], [0.1]]) * np.eye(7)[0],
    [GripperCommand("grasp", 0.04, 40.0), None, GripperCommand("move", 0.08)],
    held=(None, "red_cube", "red_cube"),
)


def ticks(driver: Driver, n: int) -> None:
    for _ in range(n):
        driver.tick()


def play(driver: Driver, trajectory: Trajectory, speed: float | None = None) -> str:
    """Accept, play to rest, and give the serial."""
    serial = driver.submit(trajectory, certificate(trajectory), speed).serial
    for _ in range(round(2 * len(trajectory.q) / driver.state().speed_wanted) + 1000):
        if not driver.moving:
            return serial
        driver.tick()
    raise AssertionError("the motion does not end")


def assert_refused(driver: Driver, code: str, trajectory: Trajectory, *args: object, text: str | None = None) -> None:
    before = driver.state()
    with pytest.raises(RefusedError, match=text) as caught:
        driver.submit(trajectory, *args)  # type: ignore[arg-type]
    assert caught.value.code == code
    ticks(driver, 20)
    after = driver.state()
    assert (after.mode, after.q_d) == (before.mode, before.q_d), "a refusal must not move the robot"


def test_exactly_the_samples_of_an_accepted_trajectory_are_commanded():
    driver, robot = perfect_driver()
    motion = swing(0.5)
    serial = play(driver, motion)
    n = len(motion.q)
    np.testing.assert_array_equal([q for q, _ in robot.commands[:n]], motion.q)
    np.testing.assert_array_equal([qd for _, qd in robot.commands[:n]], motion.qd)
    result = driver.result(serial)
    assert (result.outcome, result.played, result.samples) == ("completed", n, n)
    assert result.trouble is None and driver.state().mode == "idle"
    np.testing.assert_allclose(result.q[-1], motion.q[-1], atol=1e-12)


def test_an_idle_robot_holds_its_position():
    driver, robot = perfect_driver()
    ticks(driver, 50)
    assert all((q == REST_Q).all() and not qd.any() for q, qd in robot.commands)


def test_without_a_certificate_nothing_moves():
    assert_refused(perfect_driver()[0], "no_certificate", swing(), None)


@pytest.mark.parametrize("field", ["q", "qd", "qdd"])
def test_a_single_changed_bit_is_refused(field: str):
    motion = swing(0.3)
    bits = np.array(getattr(motion, field))
    bits.view(np.uint64)[150, 3] ^= 1
    assert_refused(perfect_driver()[0], "trajectory_changed", replace(motion, **{field: bits}), certificate(motion))


def test_a_changed_gripper_force_is_refused():
    driver, _ = perfect_driver(object_width=0.04)
    first = PICK.gripper[0]
    changed = replace(PICK, gripper=(replace(first, command=replace(first.command, force=41.0)), *PICK.gripper[1:]))
    assert_refused(driver, "trajectory_changed", changed, certificate(PICK))


def test_a_certificate_is_good_for_one_motion():
    driver, _ = perfect_driver()
    there = swing(0.3, 0.02)
    back = swing(0.3, -0.02, start=there.q[-1])
    used = certificate(there)
    driver.submit(there, used)
    ticks(driver, 1000)
    play(driver, back)
    assert_refused(driver, "certificate_used", there, used)


@pytest.mark.parametrize(
    ("code", "changes"),
    [
        ("certificate_expired", {"issued": time.time() - 100.0, "expires": time.time() - 1.0}),
        ("wrong_profile", {"profile": "fr3/10"}),
        ("wrong_firmware", {"firmware": "panda system 3.x, research interface 3"}),
        ("wrong_limits", {"limits_hash": "another table"}),
        ("scene_too_old", {"scene_stamp": time.time() - 3600.0}),
        ("scene_too_old", {"scene_stamp": time.time() - 60.0}),  # from before the robot process started
        ("certificate_from_future", {"scene_stamp": time.time() + 3600.0}),
    ],
)
def test_a_certificate_that_does_not_fit_is_refused(code: str, changes: dict):
    driver, _ = perfect_driver()
    motion = swing()
    assert_refused(driver, code, motion, certificate(motion, **changes))


def test_a_motion_that_begins_elsewhere_is_refused():
    driver, _ = perfect_driver()
    motion = swing(start=np.array(REST_Q) + 0.01)
    assert_refused(driver, "start_mismatch", motion, certificate(motion))


def test_a_motion_that_begins_with_something_in_the_hand_needs_it_there():
    driver, _ = perfect_driver()
    motion = swing(held="red_cube")
    assert_refused(driver, "start_mismatch", motion, certificate(motion), text="'red_cube'.*holds nothing")


@pytest.mark.parametrize(
    ("motion", "check"),
    [
        (swing(0.15, 0.4), "joint_velocity"),
        (swing(2.0, 2.95), "joint_position"),
        (replace(swing(1.0), qd=swing(1.0).qd * 1.5), "sampled_consistently"),
    ],
)
def test_a_certified_motion_that_breaks_a_limit_is_refused_all_the_same(motion: Trajectory, check: str):
    driver, _ = perfect_driver()
    assert_refused(driver, "breaks_limit", motion, certificate(motion), text=check)


def test_a_jump_between_two_samples_is_refused():
    driver, _ = perfect_driver()
    q = np.array(swing(0.5).q)
    q[250:] += 0.01
    jump = replace(swing(0.5), q=q)
    assert_refused(driver, "breaks_limit", jump, certificate(jump), text="limit")


def test_a_grip_harder_than_the_hand_can_is_refused():
    driver, _ = perfect_driver()
    motion = joined(np.array([REST_Q, REST_Q]), [GripperCommand("grasp", 0.04, 500.0)])
    assert_refused(driver, "breaks_limit", motion, certificate(motion), text="500 N")


def test_a_second_motion_while_moving_is_refused_as_busy():
    driver, _ = perfect_driver()
    motion = swing(0.5)
    driver.submit(motion, certificate(motion))
    ticks(driver, 100)
    with pytest.raises(RefusedError, match="the robot is moving") as caught:
        driver.submit(motion, certificate(motion))
    assert caught.value.code == "busy"
    ticks(driver, 500)
    assert driver.mode == "idle"


@pytest.mark.parametrize("sample", [1, 120, 500, 880, 999])
def test_a_stop_comes_to_rest_on_the_path_within_the_limits_and_stays_until_acknowledged(sample: int):
    driver, robot = perfect_driver()
    motion = swing(1.0, 0.5)
    serial = driver.submit(motion, certificate(motion)).serial
    ticks(driver, sample)
    driver.stop()
    ticks(driver, 1500)
    commanded = np.array([q for q, _ in robot.commands])
    limits = panda_limits()
    padded = np.concatenate([np.repeat(commanded[:1], 3, 0), commanded])
    for order, limit in ((1, limits.qd), (2, limits.qdd), (3, limits.qddd)):
        difference = np.diff(padded, order, axis=0) / SAMPLE_TIME**order
        assert (np.abs(difference) <= limit * (1 + 1e-6)).all(), f"derivative {order}"
    assert (np.diff(commanded[:, 0]) >= -1e-12).all(), "it must not back up"
    # On the path: only the first joint moves on this path, and never beyond its end.
    np.testing.assert_allclose(commanded[:, 1:], np.tile(REST_Q[1:], (len(commanded), 1)), atol=1e-9)
    assert commanded[:, 0].max() <= motion.q[-1, 0] + 1e-9
    assert np.array_equal(commanded[-1], commanded[-100]), "it rests"
    assert driver.mode == "stopped"
    assert driver.result(serial).outcome == "stopped"
    again = swing(0.5, -0.01, start=commanded[-1])
    assert_refused(driver, "needs_acknowledge", again, certificate(again))
    driver.acknowledge()
    play(driver, again)
    assert driver.mode == "idle"


def test_a_stop_cannot_be_acknowledged_before_the_arm_rests():
    driver, _ = perfect_driver()
    motion = swing(1.0, 0.5)
    driver.submit(motion, certificate(motion))
    ticks(driver, 500)
    driver.stop()
    driver.tick()
    with pytest.raises(RefusedError, match="until it rests"):
        driver.acknowledge()


def test_a_stop_at_rest_keeps_the_next_motion_from_starting():
    driver, _ = perfect_driver()
    driver.stop()
    motion = swing()
    assert_refused(driver, "needs_acknowledge", motion, certificate(motion))


def test_gripper_commands_are_given_at_their_moments_and_the_pick_completes():
    driver, robot = perfect_driver(object_width=0.04)
    serial = play(driver, PICK)
    assert driver.result(serial).outcome == "completed"
    assert robot.gripper_commands == [e.command for e in PICK.gripper]
    assert not driver.state().grasped


def test_closing_on_nothing_ends_the_motion_where_the_hand_stands_and_the_robot_stays_ready():
    driver, robot = perfect_driver(object_width=None)
    serial = play(driver, PICK)
    result = driver.result(serial)
    assert (result.outcome, driver.mode, driver.state().last_error) == ("ended_early", "idle", None)
    assert result.trouble is not None and result.trouble.code == "missed_grasp"
    assert "holds nothing (width 0 mm)" in result.trouble.reason
    assert result.played < result.samples
    assert len(robot.gripper_commands) < len(PICK.gripper)  # nothing of the rest is done
    assert play(driver, swing(0.5, start=driver.state().q_d))


def test_a_stop_on_request_while_a_motion_ends_early_waits_for_a_person():
    driver, _ = perfect_driver(object_width=None)
    driver.submit(PICK, certificate(PICK))
    while driver.mode == "moving":
        driver.tick()
    driver.stop()
    while driver.moving:
        driver.tick()
    assert driver.mode == "stopped"


def test_an_object_that_slips_away_stops_the_motion():
    driver, robot = perfect_driver(object_width=0.04)
    driver.submit(PICK, certificate(PICK))
    ticks(driver, 2000)
    assert driver.state().grasped
    robot.object_width = None
    ticks(driver, 1000)
    error = driver.state().last_error
    assert driver.mode == "reflex" and error is not None
    assert error.code == "lost_grasp" and "red_cube slipped" in error.reason


def test_a_gripper_that_is_not_done_in_time_stops_the_motion():
    driver, robot = perfect_driver(object_width=0.04)
    robot.distort = lambda m: replace(m, gripper_busy=bool(robot.gripper_commands))
    serial = play(driver, PICK)
    trouble = driver.result(serial).trouble
    assert trouble is not None and trouble.code == "gripper_late"
    assert "not done after its 0.6 s and 2 s more" in trouble.reason


def test_an_arm_at_rest_waits_for_a_gripper_that_needs_longer_than_its_dwell():
    driver, robot = perfect_driver(object_width=0.04)
    begun: list[int] = []

    def slow(m):
        if robot.gripper_commands and not begun:
            begun.append(len(robot.commands))
        still_closing = len(begun) > 0 and len(robot.commands) - begun[0] < 1600
        return replace(m, gripper_busy=still_closing or m.gripper_busy)

    robot.distort = slow
    result = driver.result(play(driver, PICK))
    assert result.outcome == "completed" and result.played == len(PICK.q)
    assert len(robot.commands) >= len(PICK.q) + 1000 - 5, "the clock stood still for the second that was lacking"
    closing = np.array([q for q, _ in robot.commands[begun[0] : begun[0] + 1600]])
    assert np.ptp(closing, axis=0).max() == 0.0
    played = np.array([q for q, _ in robot.commands])
    kept = np.concatenate([[True], np.any(np.diff(played, axis=0) != 0, axis=1)])
    expected = np.concatenate([[True], np.any(np.diff(PICK.q, axis=0) != 0, axis=1)])
    np.testing.assert_array_equal(played[kept], PICK.q[expected], err_msg="every other sample is the certified one")


def test_an_arm_that_is_held_back_stops_with_a_tracking_error():
    driver, robot = perfect_driver()
    motion = swing(1.0, 0.5)
    driver.submit(motion, certificate(motion))
    held = np.array(REST_Q)
    robot.distort = lambda m: replace(m, q=held)
    ticks(driver, 1500)
    error = driver.state().last_error
    assert driver.mode == "reflex" and error is not None and error.code == "tracking_error"
    assert "0.05 rad" in error.reason
    again = swing(0.5, 0.01, start=np.array(driver.state().q_d))
    assert_refused(driver, "needs_acknowledge", again, certificate(again), text="tracking|away from its command")


@pytest.mark.parametrize(("milliseconds", "mode"), [(3, "idle"), (20, "reflex")])
def test_a_lasting_contact_stops_the_motion_and_a_spike_does_not(milliseconds: int, mode: str):
    driver, robot = perfect_driver()
    motion = swing(0.5)
    driver.submit(motion, certificate(motion))
    ticks(driver, 200)
    robot.distort = lambda m: replace(m, contact_force=45.0)
    ticks(driver, milliseconds)
    robot.distort = lambda m: m
    ticks(driver, 1000)
    assert driver.mode == mode
    error = driver.state().last_error
    assert (error.code if error else "none") == ("contact" if mode == "reflex" else "none")


def test_a_fault_while_measuring_stops_on_the_path_and_is_reported(caplog: pytest.LogCaptureFixture):
    driver, robot = perfect_driver()
    motion = swing(1.0, 0.5)
    driver.submit(motion, certificate(motion))
    ticks(driver, 500)

    def broken(measured: Measured) -> Measured:
        raise OSError("sensor unplugged")

    robot.distort = broken
    ticks(driver, 1500)
    error = driver.state().last_error
    assert driver.mode == "reflex" and error is not None
    assert error.code == "internal_error" and "sensor unplugged" in error.reason
    steps = np.abs(np.diff([q for q, _ in robot.commands], 2, axis=0)).max(axis=0) / SAMPLE_TIME**2
    assert (steps <= panda_limits().qdd).all(), "even then it must not stop with a jerk"
    assert caplog.text.count("fault while measuring") == 1, "a log that a thousand lines a second fill helps nobody"
    robot.distort = lambda measured: measured
    ticks(driver, 10)
    robot.distort = broken
    ticks(driver, 10)
    assert caplog.text.count("fault while measuring") == 2, "another fault is news"


def test_a_robot_that_does_not_take_commands_never_ends_the_loop():
    driver, robot = perfect_driver()
    motion = swing(0.5)
    driver.submit(motion, certificate(motion))
    ticks(driver, 100)

    def refuse(q_d: np.ndarray, qd_d: np.ndarray) -> None:
        raise ConnectionError("no control box")

    robot.command = refuse  # type: ignore[method-assign]
    ticks(driver, 100)
    error = driver.state().last_error
    assert driver.mode == "reflex" and error is not None and "no control box" in error.reason


def test_the_record_of_a_motion_says_how_well_it_was_followed():
    driver, robot = perfect_driver()
    robot.distort = lambda m: replace(m, q=m.q + 0.003)
    motion = swing(0.5)
    result = driver.result(play(driver, motion))
    assert result.max_tracking_error == pytest.approx(0.003, abs=1e-9)
    assert len(result.times) == len(result.q) == len(result.q_d) == pytest.approx(51, abs=2)
    np.testing.assert_allclose(result.q - result.q_d, 0.003, atol=1e-9)


def test_an_unknown_motion_has_no_result():
    with pytest.raises(RefusedError, match="no finished motion 'abc'"):
        perfect_driver()[0].result("abc")


def test_the_gate_of_the_tests_is_a_real_one():
    assert gate().profile == panda_limits().profile
