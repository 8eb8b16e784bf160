"""Torques count what each segment holds, and nothing jumps where it is taken or let go."""

import numpy as np
import pytest

from benchmarks.scenes.tabletop_twins import cubes
from control.robot.dynamics import Payload, RobotModel
from control.robot.limits import REST_Q, panda_limits
from control.safety.limits import SafetyLimits
from control.safety.trajectory_checks import PADDING, check_trajectory
from control.trajectory.samples import Trajectory, TrajectorySegment
from sim_check.twin.payloads import LOAD_TIME, held_payloads, load_share, loaded_torque

N = 1000
ROBOT = RobotModel.panda()


def resting(held: str | None = "red_cube") -> Trajectory:
    """The arm at rest for a second; something is in the hand from 0.4 to 0.7 s."""
    q, zero = np.tile(REST_Q, (N, 1)), np.zeros((N, 7))
    segments = (
        TrajectorySegment("before", 0, 400),
        TrajectorySegment("carry", 400, 700, held),
        TrajectorySegment("after", 700, N),
    )
    return Trajectory(q, zero, zero, (), segments)


def torques(trajectory, payloads):
    rows = [np.pad(x, ((PADDING, PADDING), (0, 0)), mode="edge") for x in (trajectory.q, trajectory.qd, trajectory.qdd)]
    return loaded_torque(ROBOT, trajectory, payloads)(*rows)[PADDING:-PADDING]


def checks(trajectory, payloads):
    torque = loaded_torque(ROBOT, trajectory, payloads)
    return {c.name: c for c in check_trajectory(trajectory, panda_limits(), SafetyLimits(), torque)}


def test_payloads_are_the_movable_things_with_the_twins_masses():
    payloads = held_payloads(cubes())
    assert set(payloads) == {"crate", "red_cube", "yellow_cube"}
    assert payloads["red_cube"].mass == pytest.approx(0.05**3 * 700.0)  # beech, see the object library


def test_a_segment_that_holds_something_takes_the_torque_of_the_loaded_arm_and_others_that_of_the_empty_one():
    load = Payload(2.0)
    tau = torques(resting(), {"red_cube": load})
    q = np.array(REST_Q)
    assert tau[550] == pytest.approx(ROBOT.with_payload(load).gravity(q))
    assert tau[100] == pytest.approx(ROBOT.gravity(q)) and tau[-1] == pytest.approx(ROBOT.gravity(q))
    # Two kilograms 0.55 m in front of the shoulder.
    assert abs(tau[550, 1] - tau[100, 1]) == pytest.approx(2.0 * 9.81 * ROBOT.tcp_pose(q)[0, 3], rel=0.01)


def test_a_load_comes_and_goes_over_a_while():
    share = load_share(resting(), "red_cube")
    assert share[400:700] == pytest.approx(1.0) and share[0] == share[-1] == 0.0
    assert np.abs(np.diff(share)).max() == pytest.approx(1e-3 / LOAD_TIME)
    load, q = Payload(3.0), np.array(REST_Q)
    rate = checks(resting(), {"red_cube": load})["torque_rate"]
    more = np.abs(ROBOT.with_payload(load).gravity(q) - ROBOT.gravity(q)).max()
    assert rate.ok and rate.worst == pytest.approx(more / LOAD_TIME, rel=0.01)


def test_a_load_that_is_too_heavy_breaks_the_torque_limit_only_where_it_is_held():
    payloads = {"red_cube": Payload(20.0)}
    broken = checks(resting(), payloads)["torque"]
    assert not broken.ok and broken.at is not None and 0.3 <= broken.at <= 0.8
    assert checks(resting(None), payloads)["torque"].ok


def test_arrays_of_another_length_are_refused():
    rows = np.zeros((N, 7))
    with pytest.raises(ValueError, match=r"torques of 1000 rows were asked for; this trajectory has 1000 \+ 2 \* 3"):
        loaded_torque(ROBOT, resting(), {})(rows, rows, rows)
