"""Every injected fault is that fault, and the check that is meant for it finds it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.judging.injected_faults import FAULTS
from benchmarks.judging.verdicts import Judged, good_cases, lengthened, summary, table
from benchmarks.motion.base_motions import Base, Case, plan_base, rescaled
from benchmarks.motion.placed_obstacles import NAME, Wanted, least_gap, obstacle_below
from control.safety.trajectory_checks import check_trajectory
from control.trajectory.samples import SAMPLE_TIME
from sim_check.verdict.verdict import judge_in_detail


@cache
def base() -> Base:
    """A cube is put on a crate."""
    found = plan_base("cube_on_crate", 0)
    assert isinstance(found, Base)
    return found


def judged(case: Case):
    return judge_in_detail(
        case.trajectory,
        case.twin,
        case.safety,
        base().limits,
        np.random.default_rng(0),
        spec=case.spec,
        perturbed=0,
        nthread=1,
        robot=base().robot,
        payload=case.payload,
    ).verdict


def drawn(fault: str) -> Case:
    """The first occasion that this motion offers for a fault."""
    cases = (FAULTS[fault](base(), np.random.default_rng(seed)) for seed in range(10))
    return next(case for case in cases if case is not None)


@pytest.mark.parametrize("fault", FAULTS)
def test_an_injected_fault_is_caught_by_the_check_that_is_meant_for_it(fault):
    case = drawn(fault)
    verdict = judged(case)
    assert not verdict.passed
    caught = [c for c in verdict.failed_checks if c.name in case.checks]
    assert caught and (case.culprit is None or any(case.culprit in c.bodies for c in caught)), verdict.failed_checks


def test_variants_that_keep_every_promise_pass():
    cases = good_cases(base(), np.random.default_rng(0))
    assert {"as_planned", "slower"} <= {c.kind for c in cases}
    for case in cases:
        verdict = judged(case)
        assert verdict.passed, (case.kind, verdict.failed_checks)


@pytest.mark.parametrize("gap", [-0.010, -0.001, 0.001])
def test_an_obstacle_stands_as_near_as_is_wanted(gap):
    wanted = Wanted(gap)
    twins = (obstacle_below(base(), wanted, np.random.default_rng(seed)) for seed in range(10))
    twin = next(t for t in twins if t is not None)
    assert twin.get(NAME) is not None
    assert least_gap(base(), twin, wanted) == pytest.approx(gap, abs=1e-4)


@pytest.mark.parametrize("factor", [0.5, 1.3])
def test_a_rescaled_segment_is_the_same_path_at_another_speed(factor):
    whole = base().trajectory
    index = next(i for i, s in enumerate(whole.segments) if s.name == "carry")
    segment, other = whole.segments[index], rescaled(whole, index, factor)
    assert other.segments[index].stop - segment.start == pytest.approx((segment.stop - segment.start) / factor, abs=1)
    assert other.q[0] == pytest.approx(whole.q[0]) and other.q[-1] == pytest.approx(whole.q[-1])
    later = (len(other.q) - len(whole.q)) * SAMPLE_TIME
    assert [e.time for e in other.gripper] == pytest.approx([whole.gripper[0].time, whole.gripper[1].time + later])
    fastest = np.abs(other.qd[other.segments[index].start : other.segments[index].stop]).max()
    assert fastest == pytest.approx(factor * np.abs(whole.qd[segment.start : segment.stop]).max(), rel=0.01)
    assert {c.name: c.ok for c in check_trajectory(other, base().limits, base().safety)}["sampled_consistently"]


def test_a_motion_is_lengthened_to_the_length_that_is_timed():
    assert lengthened(base().trajectory, 8.0).duration == pytest.approx(8.0, abs=0.002)


def test_the_report_counts_what_was_found_for_the_right_reason_and_false_alarms():
    one = Judged("lift 0", "jerk", True, False, True, 0.1, "joint_jerk")
    good = Judged("lift 0", "slower", False, True, False, 0.2, "")
    runs = [one, replace(one, right_reason=False), replace(one, passed=True, right_reason=False)]
    chance = replace(good, reliable=False, passed=False)
    found = summary([*runs, good, replace(good, passed=False), chance])
    assert found["unreliable"] == {"motions": 1, "refused": 1, "names": ["lift 0 slower"]}
    assert found["faults"]["jerk"] == {"motions": 3, "detected": 2, "right_reason": 1}
    assert (found["good"]["motions"], found["good"]["false_alarms"]) == (2, 1)
    assert len(found["missed"]) == 2 and len(found["alarms"]) == 1
    times = {"motion_s": 8.0, "perturbed_twins": 32, "threads": 2, "wall": 3.0, "cpu": 5.0, "nominal": 0.3, "good": 1.0}
    text = table({**found, "not_planned": [], "seconds_per_verdict": times})
    assert "jerk                    3         2             1" in text and "false alarm: lift 0 slower" in text
