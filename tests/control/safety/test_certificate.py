"""A robot plays exactly what was judged: once, soon, from where it is. Everything else is refused with a reason."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.motion.arm_paths import REST
from control.errors import RefusedError, StackError
from control.robot.limits import VelocityEnds, panda_limits
from control.safety.certificate import Certificate, CheckResult, Verdict
from control.safety.certification import START_TOLERANCE, issue_certificate, limits_hash, verify_certificate
from control.safety.limits import SafetyLimits
from control.trajectory.samples import GripperCommand, GripperEvent, Trajectory

PROFILE = "panda/5"
FIRMWARE = panda_limits().firmware
HASH = limits_hash(panda_limits(), SafetyLimits())
NOW = 1_700_000_000.0
PASSED = CheckResult("hand_speed", 0.42, 0.5, "m/s", ok=True, at=1.0)
FAILED = CheckResult("contact_force", 31.0, 15.0, "N", ok=False, at=2.0, bodies=("panda_hand", "crate"))
GOOD = Verdict((PASSED,), successes=10, trials=10, interval=(0.72, 1.0), passed=True, steps=1000)


def some_trajectory() -> Trajectory:
    steps = np.linspace(0.0, 0.1, 100)[:, None]
    return Trajectory(
        REST + steps * np.ones(7),
        np.full((100, 7), 1.0),
        np.zeros((100, 7)),
        gripper=(GripperEvent(0.05, 0.02, GripperCommand("grasp", 0.04)),),
    )


def issued(trajectory: Trajectory, verdict: Verdict = GOOD, **changes) -> Certificate:
    arguments = {
        "profile": PROFILE,
        "firmware": FIRMWARE,
        "limits_hash": HASH,
        "scene_stamp": NOW - 3.0,
        "now": NOW,
    } | changes
    return issue_certificate(trajectory, verdict, **arguments)


def verify(certificate: Certificate | None, trajectory: Trajectory, **changes) -> None:
    arguments = {
        "profile": PROFILE,
        "firmware": FIRMWARE,
        "limits_hash": HASH,
        "now": NOW + 1.0,
        "used_serials": set(),
        "q_d": trajectory.q[0],
        "max_scene_age": 60.0,
    } | changes
    verify_certificate(certificate, trajectory, **arguments)


def assert_refused(code: str, text: str, certificate: Certificate | None, trajectory: Trajectory, **changes) -> None:
    with pytest.raises(RefusedError, match=text) as refused:
        verify(certificate, trajectory, **changes)
    assert refused.value.code == code


def test_a_fresh_certificate_for_exactly_these_samples_is_accepted():
    trajectory = some_trajectory()
    verify(issued(trajectory), trajectory)


def test_without_a_certificate_nothing_is_played():
    assert_refused("no_certificate", "have it judged in the twin", None, some_trajectory())


@pytest.mark.parametrize("field", ["q", "qd", "qdd"])
def test_a_single_flipped_bit_in_any_sample_is_refused(field):
    trajectory = some_trajectory()
    certificate = issued(trajectory)
    rng = np.random.default_rng(0)
    for _ in range(25):
        array = np.array(getattr(trajectory, field))
        # Bits above 51 are exponent and sign; flipping those may give a number that no trajectory accepts.
        array.view(np.uint64).reshape(-1)[rng.integers(array.size)] ^= np.uint64(1) << np.uint64(rng.integers(52))
        changed = replace(trajectory, **{field: array})
        assert_refused("trajectory_changed", "not the one that was judged", certificate, changed)


def test_another_gripper_command_is_a_changed_trajectory():
    trajectory = some_trajectory()
    certificate = issued(trajectory)
    other = replace(trajectory, gripper=(GripperEvent(0.05, 0.02, GripperCommand("grasp", 0.04, 60.0)),))
    assert_refused("trajectory_changed", "send exactly the samples that passed", certificate, other)


def test_a_certificate_is_good_once():
    trajectory = some_trajectory()
    certificate = issued(trajectory)
    used = {certificate.serial}
    assert_refused("certificate_used", "was used already, and a certificate is good for one motion", certificate,
                   trajectory, used_serials=used)  # fmt: skip


def test_certificates_of_the_same_trajectory_have_different_serials():
    trajectory = some_trajectory()
    assert issued(trajectory).serial != issued(trajectory).serial


def test_a_certificate_expires_after_its_lifetime():
    trajectory = some_trajectory()
    certificate = issued(trajectory, lifetime=10.0)
    verify(certificate, trajectory, now=NOW + 9.9)
    text = r"expired 2\.5 s ago; it was good for 10 s. Look again"
    assert_refused("certificate_expired", text, certificate, trajectory, now=NOW + 12.5)


def test_the_default_lifetime_is_two_minutes():
    certificate = issued(some_trajectory())
    assert certificate.expires - certificate.issued == 120.0


@pytest.mark.parametrize("field", ["issued", "scene_stamp"])
def test_times_ahead_of_the_robots_clock_are_refused(field):
    trajectory = some_trajectory()
    certificate = replace(issued(trajectory), **{field: NOW + 31.0})
    text = r"is 30\.0 s ahead of this robot's clock"
    assert_refused("certificate_from_future", text, certificate, trajectory)


def test_another_robots_certificate_is_refused():
    trajectory = some_trajectory()
    text = "for a robot of profile 'fr3/10', this one is 'panda/5'"
    assert_refused("wrong_profile", text, issued(trajectory, profile="fr3/10"), trajectory)


def test_a_certificate_for_another_firmware_is_refused():
    trajectory = some_trajectory()
    text = (
        "for firmware 'panda system 3.x', this robot runs 'panda system 4.*have the trajectory judged with the limits"
    )
    assert_refused("wrong_firmware", text, issued(trajectory, firmware="panda system 3.x"), trajectory)


def test_a_trajectory_judged_by_other_limits_is_refused():
    trajectory = some_trajectory()
    other = limits_hash(panda_limits(), SafetyLimits(hand_speed=1.0))
    text = "was judged by other limits .* use the same cell file on both sides"
    assert_refused("wrong_limits", text, issued(trajectory, limits_hash=other), trajectory)


def test_a_scene_that_is_too_old_is_refused():
    trajectory = some_trajectory()
    certificate = issued(trajectory, scene_stamp=NOW - 70.0)
    text = r"a frame that is 71\.0 s old; this robot takes at most 60 s"
    assert_refused("scene_too_old", text, certificate, trajectory)


def test_an_arm_that_is_elsewhere_is_refused_by_joint_and_both_values():
    trajectory = some_trajectory()
    q_d = np.array(trajectory.q[0])
    q_d[3] += 0.0123
    text = r"panda_joint4 starts at -2\.35619 rad, the robot holds -2\.34389 rad \(0\.01230 rad apart, 0\.0001 rad"
    assert_refused("start_mismatch", text, issued(trajectory), trajectory, q_d=q_d)


def test_the_start_may_differ_by_rounding_only():
    trajectory = some_trajectory()
    verify(issued(trajectory), trajectory, q_d=trajectory.q[0] + 0.9 * START_TOLERANCE)
    assert_refused("start_mismatch", "plan again", issued(trajectory), trajectory,
                   q_d=trajectory.q[0] + 1.1 * START_TOLERANCE)  # fmt: skip


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_an_unknown_joint_position_is_not_where_the_trajectory_begins(value):
    trajectory = some_trajectory()
    q_d = np.array(trajectory.q[0])
    q_d[5] = value
    assert_refused("start_mismatch", "panda_joint6", issued(trajectory), trajectory, q_d=q_d)


def test_joints_of_another_arm_are_refused():
    trajectory = some_trajectory()
    assert_refused("start_mismatch", r"joints of shape \(6,\)", issued(trajectory), trajectory, q_d=np.zeros(6))


@pytest.mark.parametrize(
    ("field", "code"),
    [
        ("issued", "certificate_from_future"),
        ("scene_stamp", "certificate_from_future"),
        ("expires", "certificate_expired"),
    ],
)
def test_a_time_that_is_not_a_number_is_never_in_time(field, code):
    trajectory = some_trajectory()
    assert_refused(code, "nan s", replace(issued(trajectory), **{field: float("nan")}), trajectory)


def test_nothing_is_certified_that_did_not_pass():
    failed = Verdict((PASSED, FAILED), 0, 10, (0.0, 0.28), passed=False, steps=10)
    with pytest.raises(StackError, match=r"did not pass: contact_force 31 N \(limit 15\); plan another motion"):
        issued(some_trajectory(), verdict=failed)


def test_a_low_success_rate_is_named_as_the_reason():
    rare = replace(GOOD, successes=3, passed=False)
    with pytest.raises(StackError, match="succeeded in 3 of 10 perturbed twins only"):
        issued(some_trajectory(), verdict=rare)


def test_a_verdict_that_says_passed_with_a_failed_check_is_not_believed():
    muddled = replace(GOOD, checks=(FAILED,))
    with pytest.raises(StackError, match="contact_force"):
        issued(some_trajectory(), verdict=muddled)


@pytest.mark.parametrize("changes", [{"now": float("nan")}, {"scene_stamp": NOW + 60.0}, {"lifetime": -1.0}])
def test_times_that_make_no_sense_are_not_certified(changes):
    with pytest.raises(StackError, match="certificate"):
        issued(some_trajectory(), **changes)


ENDS = VelocityEnds(np.full(7, -3.0), np.full(7, 3.0), np.full(7, 0.3), np.full(7, 5.0))


def test_equal_limits_have_equal_hashes_and_every_number_counts():
    limits, safety = panda_limits(), SafetyLimits()
    assert limits_hash(panda_limits(), SafetyLimits()) == HASH
    others = [
        (limits, replace(safety, hand_speed=np.nextafter(0.5, 1.0))),
        (limits, replace(safety, keep_out=(((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)),))),
        (limits, replace(safety, workspace_high=(0.9, 0.8, 1.2))),
        (replace(limits, profile="panda/4"), safety),
        (replace(limits, qd=limits.qd * [1, 1, 1, 1, 1, 1, 1.0000001]), safety),
        (replace(limits, angular_jerk=1e4), safety),
        (replace(limits, firmware="another"), safety),
        (replace(limits, velocity_ends=ENDS), safety),
        (replace(limits, velocity_ends=replace(ENDS, offset=0.9 * ENDS.offset)), safety),
    ]
    assert len({HASH, *(limits_hash(*pair) for pair in others)}) == len(others) + 1


def test_limits_from_a_file_hash_like_those_from_code():
    # A cell file gives lists and whole numbers where the defaults are tuples and floats.
    safety = SafetyLimits(contact_force=15, workspace_low=[-0.2, -0.8, 0])  # type: ignore[arg-type]
    assert limits_hash(panda_limits(), safety) == HASH
