"""The independent checker finds each kind of violation, where it is and how large, and nothing where there is none."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.motion.arm_paths import REST
from control.robot.limits import JOINT_NAMES, panda_limits
from control.safety.certificate import CheckResult
from control.safety.limits import SafetyLimits
from control.safety.trajectory_checks import check_trajectory
from control.trajectory.samples import SAMPLE_TIME, Trajectory

LIMITS = panda_limits()
SAFETY = SafetyLimits()


def smooth_step(duration: float) -> np.ndarray:
    """Progress 0..1 every millisecond with zero speed, acceleration and jerk at both ends (35 x^4 - 84 x^5 + ...)."""
    x = np.linspace(0.0, 1.0, round(duration / SAMPLE_TIME) + 1)
    return 35 * x**4 - 84 * x**5 + 70 * x**6 - 20 * x**7


def differentiated(q: np.ndarray) -> Trajectory:
    """A trajectory of these positions with consistent derivatives, resting for one more sample at each end."""
    q = np.concatenate([q[:1], q, q[-1:]])
    padded = np.concatenate([q[:1], q, q[-1:]])
    qd = (padded[2:] - padded[:-2]) / (2 * SAMPLE_TIME)
    return Trajectory(q, qd, (padded[2:] - 2 * q + padded[:-2]) / SAMPLE_TIME**2)


def move(joint: int = 0, distance: float = 0.5, duration: float = 2.0) -> Trajectory:
    """One joint moves smoothly away from REST."""
    return differentiated(REST + smooth_step(duration)[:, None] * distance * np.eye(7)[joint])


def results(trajectory: Trajectory, safety: SafetyLimits = SAFETY, **callables) -> dict[str, CheckResult]:
    return {r.name: r for r in check_trajectory(trajectory, LIMITS, safety, **callables)}


def broken(checks: dict[str, CheckResult]) -> set[str]:
    return {name for name, check in checks.items() if not check.ok}


def test_a_gentle_motion_keeps_everything():
    checks = results(move())
    assert not broken(checks)
    assert set(checks) == {
        "joint_position",
        "joint_velocity",
        "joint_acceleration",
        "joint_jerk",
        "starts_at_rest",
        "ends_at_rest",
        "sampled_consistently",
    }


def test_the_worst_velocity_is_the_analytic_one_at_the_middle_of_the_move():
    # The seventh-order step has its largest speed 35/16 distance/duration in the middle.
    check = results(move(joint=2, distance=0.6, duration=1.0))["joint_velocity"]
    assert check.worst == pytest.approx(35 / 16 * 0.6 / 1.0, rel=1e-4)
    assert check.at == pytest.approx(0.5, abs=0.003)
    assert check.bodies == ("panda_joint3",)
    assert check.limit == pytest.approx(0.8 * 2.175)


@pytest.mark.parametrize("joint", range(7))
def test_too_fast_is_found_for_every_joint(joint):
    duration = float(35 / 16 * 0.4 / (LIMITS.qd[joint] * SAFETY.velocity_scale) * 0.99)
    checks = results(move(joint, -0.4, duration))
    assert "joint_velocity" in broken(checks)
    assert checks["joint_velocity"].bodies == (JOINT_NAMES[joint],)
    assert checks["joint_velocity"].worst == pytest.approx(checks["joint_velocity"].limit / 0.99, rel=1e-3)


def test_just_below_the_velocity_limit_passes():
    wide = replace(SAFETY, acceleration_scale=1.0)
    duration = float(35 / 16 * 0.9 / (LIMITS.qd[0] * SAFETY.velocity_scale) * 1.001)
    assert not broken(results(move(0, 0.9, duration), wide))


def test_too_hard_acceleration_is_found_without_a_velocity_violation():
    assert broken(results(move(1, 0.05, 0.27))) == {"joint_acceleration"}


def test_a_single_displaced_sample_is_a_jerk_where_it_happens():
    q = np.array(move().q)
    q[700, 4] += 2e-5
    checks = results(differentiated(q))
    assert "joint_jerk" in broken(checks)
    assert checks["joint_jerk"].bodies == ("panda_joint5",)
    assert checks["joint_jerk"].at == pytest.approx(0.7, abs=0.004)


def test_a_motion_that_starts_with_a_jump_of_speed_is_found():
    still = move()
    q = np.array(still.q)
    q += np.arange(len(q))[:, None] * SAMPLE_TIME * 0.05
    qd = np.array(still.qd) + 0.05
    checks = results(Trajectory(q, qd, still.qdd))
    assert {"starts_at_rest", "ends_at_rest", "joint_acceleration", "joint_jerk"} <= broken(checks)
    assert checks["starts_at_rest"].worst == pytest.approx(0.05)
    assert checks["starts_at_rest"].unit == "rad/s"


def test_a_motion_cut_off_in_the_middle_is_a_jerk_at_its_end_whatever_its_derivatives_claim():
    q = np.array(move().q[:1000])
    qd, qdd = np.array(move().qd[:1000]), np.array(move().qdd[:1000])
    qd[-1], qdd[-1] = 0.0, 0.0
    checks = results(Trajectory(q, qd, qdd))
    assert {"joint_acceleration", "joint_jerk"} <= broken(checks)
    assert checks["joint_jerk"].at == pytest.approx(0.999)
    backwards = results(Trajectory(q[::-1], -qd[::-1], qdd[::-1]))
    assert {"joint_acceleration", "joint_jerk"} <= broken(backwards)
    assert backwards["joint_jerk"].at == pytest.approx(0.0, abs=0.002)


def test_an_acceleration_at_the_end_is_not_rest():
    trajectory = move()
    qdd = np.array(trajectory.qdd)
    qdd[-1, 2] = 0.1
    checks = results(replace(trajectory, qdd=qdd))
    assert broken(checks) == {"ends_at_rest"}
    assert (checks["ends_at_rest"].worst, checks["ends_at_rest"].unit) == (0.1, "rad/s^2")


def test_positions_report_their_distance_from_the_limit_and_keep_the_margin():
    to_limit = LIMITS.q_max[3] - REST[3]
    inside = results(move(3, to_limit - 0.0201, 4.0))["joint_position"]
    assert inside.ok
    assert inside.worst == pytest.approx(0.0201)
    assert inside.limit == SAFETY.joint_margin
    outside = results(move(3, to_limit - 0.0199, 4.0))["joint_position"]
    assert not outside.ok
    assert outside.bodies == ("panda_joint4",)


def test_derivatives_that_are_not_those_of_the_positions_are_found():
    trajectory = move()
    assert broken(results(replace(trajectory, qd=np.zeros_like(trajectory.q)))) == {"sampled_consistently"}
    assert broken(results(replace(trajectory, qd=trajectory.qd * 1.1))) == {"sampled_consistently"}
    assert broken(results(replace(trajectory, qdd=trajectory.qdd + 10 * trajectory.qd))) == {"sampled_consistently"}


def test_backward_differences_are_consistent_too():
    trajectory = move()
    qd = np.diff(trajectory.q, axis=0, prepend=trajectory.q[:1]) / SAMPLE_TIME
    qdd = np.diff(qd, axis=0, prepend=qd[:1]) / SAMPLE_TIME
    assert not broken(results(replace(trajectory, qd=qd, qdd=qdd)))


def test_torques_and_their_rates_are_judged_when_a_model_is_given():
    def inertia(q, qd, qdd):
        return 10.0 * qdd

    trajectory = move(0, 0.5, 1.0)
    largest = np.max(np.abs(trajectory.qdd))
    checks = results(trajectory, torque=inertia)
    assert checks["torque"].ok
    assert checks["torque"].worst == pytest.approx(10 * largest, rel=1e-3)

    def heavy(q, qd, qdd):
        return 1.01 * LIMITS.tau / largest * qdd

    assert "torque" in broken(results(trajectory, torque=heavy))

    def switching(q, qd, qdd):
        return np.where(q > REST + 0.25, 1.2, 0.0)  # 1.2 Nm within a millisecond

    checks = results(trajectory, torque=switching)
    assert broken(checks) == {"torque_rate"}
    assert checks["torque_rate"].worst == pytest.approx(1200.0)
    assert checks["torque_rate"].at == pytest.approx(0.5, abs=0.003)


def test_the_hand_is_judged_when_its_kinematics_are_given():
    def turntable(q):
        """A hand 0.8 m from joint 1 that turns with it."""
        poses = np.tile(np.eye(4), (len(q), 1, 1))
        c, s = np.cos(q[:, 0]), np.sin(q[:, 0])
        poses[:, 0, 0], poses[:, 0, 1], poses[:, 1, 0], poses[:, 1, 1] = c, -s, s, c
        poses[:, 0, 3], poses[:, 1, 3] = 0.8 * c, 0.8 * s
        return poses

    checks = results(move(0, 0.5, 2.0), tcp=turntable)
    speed = 35 / 16 * 0.5 / 2.0
    assert checks["hand_angular_speed"].worst == pytest.approx(speed, rel=1e-4)
    assert checks["hand_speed"].worst == pytest.approx(0.8 * speed, rel=1e-4)
    assert not broken(checks)
    assert broken(results(move(0, 0.5, 1.6), tcp=turntable)) == {"hand_speed"}
    turning = replace(SAFETY, hand_angular_speed=0.5)
    assert broken(results(move(0, 0.5, 2.0), turning, tcp=turntable)) == {"hand_angular_speed"}


def jolted() -> Trajectory:
    """One sample of joint 2 is off by 1.3 um: 2.6 rad/s^2, and 3900 rad/s^3 where 3750 are allowed."""
    q = np.array(move(6, 0.2, 2.0).q)
    q[700, 1] += 1.3e-6
    return differentiated(q)


def started() -> Trajectory:
    """At rest by its samples, but its first derivative says otherwise, by less than rounding of derivatives may."""
    qd = np.array(move().qd)
    qd[0, 3] = 1e-3
    return replace(move(), qd=qd)


def ended() -> Trajectory:
    qdd = np.array(move().qdd)
    qdd[-1, 2] = 0.1
    return replace(move(), qdd=qdd)


def steady(q, qd, qdd):
    """90 Nm on joint 2 all the time."""
    return np.tile(90.0 * np.eye(7)[1], (len(q), 1))


def switching(q, qd, qdd):
    return np.where(q > REST + 0.25, 1.2, 0.0)  # 1.2 Nm within a millisecond


def hand_on_a_stick(q):
    """A hand 2 m from joint 1 that keeps its direction."""
    poses = np.tile(np.eye(4), (len(q), 1, 1))
    poses[:, 0, 3], poses[:, 1, 3] = 2.0 * np.cos(q[:, 0]), 2.0 * np.sin(q[:, 0])
    return poses


def turned(angle: np.ndarray) -> np.ndarray:
    """Poses turned about z by angles in [rad]."""
    poses = np.tile(np.eye(4), (len(angle), 1, 1))
    c, s = np.cos(angle), np.sin(angle)
    poses[:, 0, 0], poses[:, 0, 1], poses[:, 1, 0], poses[:, 1, 1] = c, -s, s, c
    return poses


def spinning_hand(q):
    """A hand that turns four times as far as joint 1, on the spot."""
    return turned(4.0 * q[:, 0])


def hand_on_a_long_stick(q):
    """A hand that goes 8 m straight on for each radian of joint 1."""
    poses = np.tile(np.eye(4), (len(q), 1, 1))
    poses[:, 0, 3] = 8.0 * q[:, 0]
    return poses


def whirling_hand(q):
    """A hand that turns sixteen times as far as joint 1, on the spot."""
    return turned(16.0 * q[:, 0])


def hand_that_jumps(q):
    """A hand that is off by 3 um in one sample: 3 m/s^2, and 9000 m/s^3 where 6500 are allowed."""
    poses = np.tile(np.eye(4), (len(q), 1, 1))
    poses[700, 0, 3] = 3e-6
    return poses


def hand_that_twitches(q):
    """A hand that is off by 5 urad in one sample: 10 rad/s^2, and 15000 rad/s^3 where 12500 are allowed."""
    return turned(5e-6 * (np.arange(len(q)) == 700))


ALONE = {
    "joint_position": (move(3, LIMITS.q_max[3] - REST[3] - 0.0199, 4.0), {}),
    "joint_velocity": (move(0, 2.0, 2.45), {}),
    "joint_acceleration": (move(1, 0.05, 0.27), {}),
    "joint_jerk": (jolted(), {}),
    "torque": (move(), {"torque": steady}),
    "torque_rate": (move(0, 0.5, 1.0), {"torque": switching}),
    "hand_speed": (move(0, 0.5, 2.0), {"tcp": hand_on_a_stick}),
    "hand_angular_speed": (move(0, 0.5, 2.0), {"tcp": spinning_hand}),
    "hand_acceleration": (move(0, 0.005, 0.2), {"tcp": hand_on_a_long_stick}),
    "hand_angular_acceleration": (move(0, 0.005, 0.2), {"tcp": whirling_hand}),
    "hand_jerk": (move(0, 0.5, 2.0), {"tcp": hand_that_jumps}),
    "hand_angular_jerk": (move(0, 0.5, 2.0), {"tcp": hand_that_twitches}),
    "starts_at_rest": (started(), {}),
    "ends_at_rest": (ended(), {}),
    "sampled_consistently": (replace(move(), qd=np.zeros_like(move().q)), {}),
}


@pytest.mark.parametrize("name", ALONE)
def test_a_trajectory_that_breaks_one_limit_is_caught_by_that_check_alone(name):
    trajectory, callables = ALONE[name]
    assert broken(results(trajectory, **callables)) == {name}


def test_the_shortest_trajectory_can_be_checked():
    rest = np.tile(REST, (2, 1))
    assert not broken(results(Trajectory(rest, np.zeros((2, 7)), np.zeros((2, 7)))))


def test_checking_stopping_and_verifying_need_numpy_only():
    code = (
        "import sys\nimport control.safety.trajectory_checks\n"
        "import control.trajectory.on_path_stop, control.safety.certification\n"
        "print([m for m in ('scipy', 'pinocchio', 'mujoco', 'torch', 'pydantic') if m in sys.modules])"
    )
    root = Path(__file__).resolve().parents[3]
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=root)
    assert out.stdout.strip() == "[]"


def test_the_checker_shares_no_code_with_the_retiming():
    source = (Path(__file__).resolve().parents[3] / "control" / "safety" / "trajectory_checks.py").read_text()
    assert "control.safety" in source and "control.retiming" not in source
