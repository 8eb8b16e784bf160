"""The simulated control box obeys the unmodified libfranka, and aborts for the reasons that the real one has."""

import os
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from benchmarks.robot_side.libfranka_motions import along, control, desired, play, robot_at, swing
from control.robot.limits import REST_Q
from hw_interface.fci_simulator.process import ControlBoxProcess
from hw_interface.panda.scheduling import in_own_scheduling
from tests.support.robot_side.control_boxes import abort_of, control_box, go_home_if_far

libfranka = pytest.importorskip("panda_py", reason="drives the box with libfranka").libfranka
# A client that waits for ever inside libfranka can be ended by nothing but the end of its process.
pytestmark = pytest.mark.timeout(method="thread")


@pytest.fixture(scope="module")
def box() -> Iterator[ControlBoxProcess]:
    with control_box() as process:
        yield process


@pytest.fixture
def robot(box: ControlBoxProcess) -> Any:
    """A client of its own for each test, within half a radian of REST_Q."""
    client = robot_at(box.address)
    go_home_if_far(client)
    return client


def test_the_real_client_connects_and_reads_a_true_state(robot: Any):
    assert robot.server_version() == 5
    state = robot.read_once()
    assert state.robot_mode == libfranka.RobotMode.kIdle
    np.testing.assert_allclose(state.q, REST_Q, atol=2e-4)
    np.testing.assert_allclose(np.array(state.O_T_EE).reshape(4, 4).T[:3, 3], (0.307, 0.0, 0.487), atol=2e-3)
    assert state.m_ee == pytest.approx(0.76, abs=0.01)  # the hand and its fingers, as the URDF has them
    np.testing.assert_allclose(state.tau_ext_hat_filtered, 0.0, atol=1e-3)
    np.testing.assert_allclose(state.tau_J, robot.load_model().gravity(state), atol=0.01)
    assert (state.time.to_msec() < robot.read_once().time.to_msec()) and not state.current_errors


def test_a_motion_of_one_sample_a_millisecond_arrives_exactly(robot: Any):
    start = desired(robot)
    samples = swing(start, np.array([0.3, 0.2, -0.2, 0.3, 0.2, 0.2, -0.3]), 1.5)
    played: list[int] = []
    play(robot, samples, played.append)
    assert played == sorted(set(played)), "no sample was asked for twice"
    assert len(played) == len(samples), "none was left out"
    np.testing.assert_array_equal(desired(robot), samples[-1])
    np.testing.assert_allclose(robot.read_once().q, samples[-1], atol=1e-3)


def test_states_follow_the_motion(robot: Any):
    start = desired(robot)
    states: list[Any] = []
    samples = swing(start, along(1, 0.4), 0.6)

    def sample(state: Any, _duration: Any) -> Any:
        states.append(state)
        target = libfranka.JointPositions(samples[min(len(states), len(samples)) - 1].tolist())
        target.motion_finished = len(states) >= len(samples)
        return target

    control(robot, sample)
    middle = states[len(states) // 2]
    assert middle.robot_mode == libfranka.RobotMode.kMove
    assert middle.control_command_success_rate == 1.0
    assert middle.dq_d[0] == pytest.approx(2.19 * 0.4 / 0.6, rel=0.01)
    assert middle.dq[0] == pytest.approx(middle.dq_d[0], rel=0.05)
    radius = np.linalg.norm(np.array(middle.O_T_EE)[12:14])
    assert np.linalg.norm(middle.O_dP_EE_d[:2]) == pytest.approx(radius * middle.dq_d[0], rel=0.02)
    # Free space: what the joints feel is what the model says, to a fraction of what accelerating takes.
    assert max(np.abs(s.tau_ext_hat_filtered).max() for s in states) < 0.05


JITTER = 4e-6  # [rad] of one sample: 8 rad/s^2 and 12 000 rad/s^3 of joint 1, whose limits are 15 and 7500


@pytest.mark.parametrize(
    ("wrong", "name"),
    [
        ("position", "joint_motion_generator_position_limits_violation"),
        ("velocity", "joint_motion_generator_velocity_limits_violation"),
        ("acceleration", "joint_motion_generator_velocity_discontinuity"),
        ("jerk", "joint_motion_generator_acceleration_discontinuity"),
        ("start", "joint_position_motion_generator_start_pose_invalid"),
        ("small offset at the start", "joint_motion_generator_velocity_limits_violation"),
        ("end at speed", "joint_motion_generator_velocity_discontinuity"),
    ],
)
def test_a_broken_limit_aborts_by_its_name_and_can_be_recovered(robot: Any, wrong: str, name: str):
    start = desired(robot)
    right = swing(start, along(1, 0.15), 0.5)
    jittery = right.copy()
    jittery[250, 0] += JITTER  # no acceleration of its own there
    samples = {
        "position": swing(start, along(2, -1.7628 - 0.05 - start[1]), 1.6),
        "velocity": swing(start, along(1, 1.6), 1.2),
        "acceleration": swing(start, along(1, 0.3), 0.36),
        "jerk": jittery,
        "start": right + along(3, 0.05),
        "small offset at the start": right + along(3, 0.005),
        "end at speed": right[:250],
    }[wrong]
    said = abort_of(robot, samples)
    assert name in said
    assert said.count("violation") + said.count("discontinuity") + said.count("invalid") == 1, "one error only"
    state = robot.read_once()
    assert state.robot_mode == libfranka.RobotMode.kReflex
    with pytest.raises(RuntimeError, match="command not possible in the current mode"):
        play(robot, right)
    robot.automatic_error_recovery()
    state = robot.read_once()
    assert state.robot_mode == libfranka.RobotMode.kIdle and not state.current_errors
    np.testing.assert_allclose(state.dq, 0.0, atol=1e-3)
    here = desired(robot)
    play(robot, swing(here, along(1, 0.01), 0.2))


def test_after_an_abort_at_speed_the_arm_brakes_to_rest_within_its_limits(robot: Any):
    samples = swing(desired(robot), along(1, 0.8), 1.0)
    samples[500:] += along(1, 0.01)
    assert "velocity_limits_violation" in abort_of(robot, samples)
    robot.automatic_error_recovery()  # answered when the arm rests
    speed = 2.19 * 0.8
    way = desired(robot)[0] - samples[499, 0]
    assert way == pytest.approx(speed**2 / (2 * 15.0), rel=0.02)


@pytest.mark.parametrize("realtime", [False, True])
def test_real_time_priority_lasts_for_a_motion_alone_and_only_where_it_is_wanted(robot: Any, realtime: bool):
    before, during = os.sched_getscheduler(0), []
    samples = swing(desired(robot), along(1, 0.1), 0.4)

    def sample(_state: Any, _duration: Any) -> Any:
        during.append(os.sched_getscheduler(0))
        target = libfranka.JointPositions(samples[min(len(during), len(samples)) - 1].tolist())
        target.motion_finished = len(during) >= len(samples)
        return target

    mode = libfranka.ControllerMode.kJointImpedance
    in_own_scheduling(lambda answer: robot.control_joint_position(answer, mode, False, 1000.0), sample, realtime)
    assert os.sched_getscheduler(0) == before
    # Without the right to it (nobody but root and who is allowed by limits.conf) libfranka gets no such priority.
    assert set(during) == {before} or (realtime and set(during) == {os.SCHED_FIFO})


def torques(robot: Any, wanted: np.ndarray) -> None:
    """Play joint torques in [Nm], shape (n, 7)."""
    k = 0

    def torque(_state: Any, _duration: Any) -> Any:
        nonlocal k
        target = libfranka.Torques(wanted[min(k, len(wanted) - 1)].tolist())
        k += 1
        target.motion_finished = k >= len(wanted)
        return target

    in_own_scheduling(lambda answer: robot.control(answer, False, 1000.0), torque)


def test_an_external_controller_moves_the_arm_by_torques(robot: Any):
    start = desired(robot)
    ramp = np.concatenate([np.linspace(0, 1, 50), np.linspace(1, -1, 100), np.linspace(-1, 0, 50)])
    torques(robot, ramp[:, None] * along(7, 1.0))
    state = robot.read_once()
    assert state.robot_mode == libfranka.RobotMode.kIdle
    assert 0.01 < state.q[6] - start[6] < 0.3
    np.testing.assert_allclose(state.q[:6], start[:6], atol=0.02)


@pytest.mark.parametrize(
    ("wanted", "name"),
    [
        (np.concatenate([np.zeros(20), np.full(20, 1.5)]), "controller_torque_discontinuity"),  # 1500 Nm/s
        (np.linspace(0.0, 14.0, 20), "tau_J_range_violation"),  # 700 Nm/s up to more than 12 Nm
        (np.concatenate([np.linspace(0.0, 10.0, 20), np.full(300, 10.0)]), "joint_velocity_violation"),
    ],
)
def test_torques_have_limits_too(robot: Any, wanted: np.ndarray, name: str):
    with pytest.raises(RuntimeError, match=name):
        torques(robot, wanted[:, None] * along(7, 1.0))
    robot.automatic_error_recovery()


def test_a_callback_that_raises_stops_the_motion_without_a_reflex(robot: Any):
    samples = swing(desired(robot), along(1, 0.5), 0.8)

    def fail(k: int) -> None:
        if k == 400:
            raise ValueError("fault in the client")

    with pytest.raises(ValueError, match="fault in the client"):
        play(robot, samples, fail)
    state = robot.read_once()
    assert state.robot_mode == libfranka.RobotMode.kIdle and not state.current_errors
    assert state.q_d[0] > samples[399, 0] and state.dq_d[0] == 0.0


def test_lost_commands_are_carried_on_with_constant_acceleration(box: ControlBoxProcess, robot: Any):
    start = desired(robot)
    samples = swing(start, along(1, 0.3), 0.6)
    play(robot, samples, lambda k: box.faults.send("drop 3") if k == 300 else None)  # no acceleration there
    np.testing.assert_array_equal(desired(robot), samples[-1])


def test_lost_commands_where_the_acceleration_changes_break_the_jerk_limit_afterwards(
    box: ControlBoxProcess, robot: Any
):
    samples = swing(desired(robot), along(1, 0.5), 0.6)
    said = abort_of(robot, samples, lambda k: box.faults.send("drop 10") if k == 300 else None)
    assert "discontinuity" in said
    assert "control_command_success_rate: 0.9" in said


def test_twenty_lost_commands_in_a_row_are_a_failure_of_communication(box: ControlBoxProcess, robot: Any):
    samples = swing(desired(robot), along(1, 0.5), 0.8)
    said = abort_of(robot, samples, lambda k: box.faults.send("drop 20") if k == 400 else None)
    assert "communication_constraints_violation" in said
    assert box.faults.send("state")["mode"] == "reflex"
    robot.automatic_error_recovery()


def test_settings_out_of_range_are_refused(robot: Any):
    for refused in (
        lambda: robot.set_joint_impedance([20000.0] * 7),
        lambda: robot.set_cartesian_impedance([5.0] * 6),
        lambda: robot.set_load(-1.0, [0.0] * 3, [0.0] * 9),
        lambda: robot.set_k(np.diag([2.0, 1.0, 1.0, 1.0]).ravel().tolist()),
    ):
        with pytest.raises(Exception, match=r"invalid argument|Invalid|invalid"):
            refused()


def test_frames_at_the_flange_show_in_the_state(robot: Any):
    offset = np.eye(4)
    offset[2, 3] = 0.05
    before = np.array(robot.read_once().O_T_EE).reshape(4, 4).T
    robot.set_ee(offset.T.ravel().tolist())
    robot.set_k(offset.T.ravel().tolist())
    state = robot.read_once()
    np.testing.assert_allclose(np.array(state.O_T_EE).reshape(4, 4).T, before @ offset, atol=1e-4)
    np.testing.assert_allclose(np.array(state.EE_T_K).reshape(4, 4).T, offset)
    for reset in (robot.set_ee, robot.set_k):
        reset(np.eye(4).ravel().tolist())


def test_softer_joints_follow_less_exactly(robot: Any):
    def worst_lag() -> float:
        lag = 0.0
        samples = swing(desired(robot), along(2, 0.3), 0.6)
        n = 0

        def sample(state: Any, _duration: Any) -> Any:
            nonlocal lag, n
            lag = max(lag, abs(state.q_d[1] - state.q[1]))
            target = libfranka.JointPositions(samples[min(n, len(samples) - 1)].tolist())
            n += 1
            target.motion_finished = n >= len(samples)
            return target

        control(robot, sample)
        play(robot, swing(desired(robot), along(2, -0.3), 0.6))
        return lag

    stiff = worst_lag()
    robot.set_joint_impedance([600.0] * 7)
    soft = worst_lag()
    robot.set_joint_impedance([3000.0, 3000.0, 3000.0, 2500.0, 2500.0, 2000.0, 2000.0])
    assert 0.0 < stiff < 0.01
    assert soft > 3 * stiff
