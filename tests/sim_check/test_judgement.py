"""A judgement tells what a verdict rests on, for our own motions and for those whose purpose nobody told."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from benchmarks.scenes.tabletop_twins import cubes, hand_at, red_on_crate
from control.errors import TrajectoryError, UnknownObjectError
from control.path_planning.rrt_connect import straight
from control.retiming.retime import retime
from control.robot.dynamics import Payload
from control.robot.limits import REST_Q, panda_limits
from control.safety.limits import SafetyLimits
from control.safety.residuals import safety_residuals
from control.trajectory.samples import JointPath, PathSegment, Trajectory, TrajectorySegment
from sim_check.twin.twin import possible_twins
from sim_check.verdict.start_collision import START_OVERLAP, start_collision
from sim_check.verdict.verdict import judge_in_detail
from tests.sim_check.test_verdict import judge, placing, robot

SAFETY, LIMITS = SafetyLimits(), panda_limits()
CARRIED = frozenset({"red_cube", "crate"})


def detail(trajectory, perturbed=0, nthread=1, seed=0, **more):
    rng = np.random.default_rng(seed)
    return judge_in_detail(
        trajectory, cubes(), SAFETY, LIMITS, rng, perturbed=perturbed, nthread=nthread, robot=robot(), **more
    )


def swing(*corners) -> Trajectory:
    """From rest through some configurations and back to rest."""
    points = [np.array(REST_Q), *corners, np.array(REST_Q)]
    ways = [straight(a, b) for a, b in pairwise(points)]
    path = JointPath(tuple(PathSegment(f"part{i}", q) for i, q in enumerate(ways)))
    return retime(path, robot(), LIMITS, SAFETY)


def untold(trajectory: Trajectory, held: str | None = None) -> Trajectory:
    """The same samples as somebody else's file has them: no names, nothing about touching; perhaps what is held."""
    spans = [(s.start, s.stop) for s in trajectory.segments if s.held]
    if held is None or not spans:
        return replace(trajectory, segments=())
    first, last = spans[0][0], spans[-1][1]
    parts = [("a", 0, first, None), ("b", first, last, held), ("c", last, len(trajectory.q), None)]
    return replace(trajectory, segments=tuple(TrajectorySegment(*part) for part in parts))


def test_the_verdict_of_a_judgement_is_the_verdict():
    assert detail(placing(), 2, spec=red_on_crate()).verdict == judge(placing(), red_on_crate(), 2)


def test_a_judgement_comes_with_the_motion_and_the_states_that_it_rests_on():
    found = detail(placing(), spec=red_on_crate())
    assert found.motion is not None and found.motion.clearances is not None
    near = found.motion.clearances
    assert np.diff(found.motion.time[near.step]).max() == pytest.approx(0.008)
    assert len(found.rollout.qpos) == len(found.rollout.time) > placing().duration / 0.002
    residuals = {r.name: r.check(found.motion) for r in safety_residuals(SAFETY)}
    assert all(residuals[c.name] == c for c in found.verdict.checks if c.name in residuals)


def test_clearances_come_with_the_distances_themselves():
    found = detail(swing(hand_at(0.58, -0.05, 0.09)))
    assert found.motion is not None and found.motion.clearances is not None
    near = found.motion.clearances
    k = int(np.argmin(near.distance["finger"]))
    # The hand stands over the yellow cube, whose top is at 5 cm; fingertips end 9.5 mm below the tool centre point.
    assert near.distance["finger"][k] == pytest.approx(0.09 - 0.0095 - 0.05, abs=0.002)
    assert near.nearest["finger"][k] == "yellow_cube"
    assert np.isinf(near.distance["finger"][0]) and near.nearest["finger"][0] == ""
    seen = np.isfinite(near.lack["finger"])
    lack, distance = near.lack["finger"][seen], near.distance["finger"][seen]
    assert lack == pytest.approx(SAFETY.finger_clearance - distance, abs=1e-6)


def test_failures_count_the_perturbed_twins_that_broke_a_check():
    whole = placing()
    kept = replace(whole, gripper=whole.gripper[:1])  # never lets go
    found = detail(kept, 3, spec=red_on_crate())
    assert found.verdict.successes == 0 and found.failures["released"] == 3
    assert detail(whole, 3, spec=red_on_crate()).failures == {}


def test_a_judgement_is_the_same_on_any_number_of_threads():
    one, two = (detail(placing(), 3, nthread, 4, spec=red_on_crate()) for nthread in (1, 2))
    assert one.verdict == two.verdict and one.failures == two.failures
    assert np.array_equal(one.rollout.qpos, two.rollout.qpos)


def test_perturbed_twins_are_the_same_on_any_number_of_threads():
    one, two = (possible_twins(cubes(), np.random.default_rng(1), 5, nthread) for nthread in (1, 2))
    assert len(one) == len(two) == 5
    assert all(np.array_equal(a.qpos, b.qpos) for a, b in zip(one, two, strict=True))


def test_progress_is_told_after_every_twin():
    told = []
    detail(swing(np.array(REST_Q) + 0.05), 2, on_progress=lambda done, of: told.append((done, of)))
    assert told == [(1, 3), (2, 3), (3, 3)]


def test_a_motion_without_a_purpose_passes_when_it_touches_nothing_and_no_reward_is_asked_for():
    found = detail(swing(np.array(REST_Q) + 0.1), 2)
    assert found.verdict.passed and found.verdict.successes == 2
    assert "reward_met" not in {c.name for c in found.verdict.checks}
    assert {r.name for r in safety_residuals(SAFETY)} <= {c.name for c in found.verdict.checks}


def test_somebody_elses_placing_passes_when_its_things_may_be_handled():
    found = detail(untold(placing(), "red_cube"), 2, handled=CARRIED)
    assert found.verdict.passed, found.verdict.failed_checks


def test_our_own_segments_are_believed_without_a_spec_too():
    assert detail(placing(), handled=CARRIED).verdict.passed


def test_somebody_elses_placing_is_turned_down_when_nothing_may_be_handled():
    failed = {c.name: c for c in detail(untold(placing())).verdict.failed_checks}
    assert failed["moved"].bodies == ("red_cube",)
    assert "red_cube" in failed["unwanted_contact"].bodies


def test_a_handled_thing_that_touches_what_is_not_handled_is_told():
    failed = {
        c.name: c for c in detail(untold(placing(), "red_cube"), handled=frozenset({"red_cube"})).verdict.failed_checks
    }
    assert set(failed["unwanted_contact"].bodies) == {"red_cube", "crate"}


def test_names_that_the_twin_does_not_have_are_refused():
    with pytest.raises(UnknownObjectError, match=r"no object or joint named 'cup' to be handled.*it has \['crate'"):
        detail(placing(), handled=frozenset({"cup"}))
    with pytest.raises(TrajectoryError, match=r"segment 'b' holds 'cup', which is nothing that can.*'red_cube'"):
        detail(untold(placing(), "cup"))


def test_a_payload_that_the_twin_does_not_know_counts_in_torques():
    trajectory = swing(np.array(REST_Q) + 0.05)
    light = {c.name: c for c in detail(trajectory, payload=Payload(1.0)).verdict.checks}["torque"]
    without = {c.name: c for c in detail(trajectory).verdict.checks}["torque"]
    assert light.ok and light.worst / light.limit > without.worst / without.limit
    failed = detail(trajectory, payload=Payload(25.0)).verdict.failed_checks
    assert "torque" in [c.name for c in failed]


def test_what_a_segment_holds_counts_in_torques_with_the_twins_mass():
    spec = red_on_crate()
    checks = {c.name: c for c in detail(placing(), spec=spec).verdict.checks}
    empty = replace(placing(), segments=tuple(replace(s, held=None) for s in placing().segments))
    assert checks["torque"].worst != {c.name: c for c in detail(empty, spec=spec).verdict.checks}["torque"].worst


def test_a_robot_that_starts_free_is_in_no_collision():
    assert start_collision(cubes()) is None
    assert start_collision(cubes(), hand_at(0.58, -0.05, 0.0597)) is None  # fingertips level with the cube's top


def test_a_start_inside_something_names_both_bodies_and_the_depth():
    tips = 0.05 - 0.006  # 6 mm below the top of the yellow cube
    found = start_collision(cubes(), hand_at(0.58, -0.01, tips + 0.0095))
    assert found is not None
    (own, other), depth = found
    assert own.endswith("finger") and other == "yellow_cube" and START_OVERLAP < depth <= 0.0065


def test_a_start_inside_itself_names_two_parts_of_the_robot():
    q = np.array(REST_Q)
    q[3], q[5] = -3.0, 0.3
    found = start_collision(cubes(), q)
    assert found is not None and all(name.startswith("panda_") for name in found[0]) and found[1] > 0.01
