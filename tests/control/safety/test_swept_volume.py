"""The share of a motion's way that nobody saw is that of the voxels which robot and held object pass through."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.scenes.tabletop_twins import cubes, hand_at, red_on_crate
from control.path_planning.rrt_connect import straight
from control.retiming.retime import retime
from control.robot.limits import REST_Q, panda_limits
from control.safety.limits import SafetyLimits
from control.safety.residuals import HeldSpan
from control.safety.swept_volume import unseen_on_the_way
from control.seen_volume import CLEAR, FILLED, HIDDEN, OVERHEAD, SeenVolume
from control.trajectory.samples import JointPath, PathSegment
from control.twin_model import ARM_JOINTS, HAND_BODY
from sim_check.verdict.verdict import judge_in_detail
from tests.sim_check.test_verdict import placing, robot

LOW, SHAPE = np.array([-0.3, -0.9, 0.0]), (65, 90, 65)
SAFETY = SafetyLimits()


def volume(state=CLEAR, where=None):
    """A box around the arm's reach, all of it in one state; or only what lies in a box (low, high), the rest known."""
    states = np.full(SHAPE, state if where is None else CLEAR, np.int8)
    if where is not None:
        low, high = (np.round((np.array(corner) - LOW) / 0.02).clip(0).astype(int) for corner in where)
        states[low[0] : high[0], low[1] : high[1], low[2] : high[2]] = state
    return SeenVolume(LOW, 0.02, states)


@cache
def reach():
    """Configurations of a way from rest down to the table and back, one each 10 ms, and their times."""
    ways = [straight(np.array(REST_Q), hand_at(0.45, 0.2, 0.1)), straight(hand_at(0.45, 0.2, 0.1), np.array(REST_Q))]
    path = JointPath(tuple(PathSegment(f"part{i}", q) for i, q in enumerate(ways)))
    trajectory = retime(path, robot(), panda_limits(), SAFETY)
    arm = [int(cubes().model.joint(name).qposadr[0]) for name in ARM_JOINTS]
    qpos = np.tile(cubes().qpos, (len(trajectory.q[::10]), 1))
    qpos[:, arm] = trajectory.q[::10]
    return trajectory, qpos, np.arange(len(qpos)) * 0.01


def on_the_way(seen, held=()):
    _, qpos, times = reach()
    return unseen_on_the_way(seen, cubes().model, qpos, times, held)


def test_a_way_through_space_that_was_seen_has_nothing_unseen():
    unseen = on_the_way(volume())
    assert (unseen.hidden, unseen.overhead, unseen.patch, unseen.at, unseen.bodies) == (0.0, 0.0, None, None, ())
    assert len(unseen.points) == 0
    # Arm and hand fill about 17 litres; the hand alone sweeps several times its own volume.
    assert 25.0 < unseen.litres < 80.0


def test_shares_of_states_add_up_to_the_whole_way():
    assert on_the_way(volume(HIDDEN)).hidden == 1.0
    assert on_the_way(volume(OVERHEAD)).overhead == 1.0
    low = on_the_way(volume(HIDDEN, ((-0.3, -0.9, 0.0), (1.0, 0.9, 0.4))))
    high = on_the_way(volume(HIDDEN, ((-0.3, -0.9, 0.4), (1.0, 0.9, 1.3))))
    assert 0.1 < low.hidden < 0.9 and low.hidden + high.hidden == pytest.approx(1.0)


def test_the_largest_patch_is_told_with_its_place_and_with_when_and_by_whom_it_is_entered():
    where = ((0.3, 0.1, 0.06), (0.6, 0.3, 0.2))
    unseen = on_the_way(volume(HIDDEN, where))
    patch = unseen.patch
    assert patch is not None and unseen.at is not None
    assert (patch.low >= np.array(where[0]) - 1e-9).all() and (patch.high <= np.array(where[1]) + 1e-9).all()
    assert patch.centre == pytest.approx([0.45, 0.2, 0.13], abs=0.04)
    assert patch.litres == pytest.approx(unseen.hidden * unseen.litres) and len(unseen.points) == round(
        patch.litres / 0.008
    )
    assert HAND_BODY in unseen.bodies and "panda_link2" not in unseen.bodies
    duration = reach()[0].duration
    assert 0.2 * duration < unseen.at < 0.5 * duration


def test_nobody_looks_beside_the_box_and_nothing_stands_above_it():
    seen = SeenVolume(LOW, 0.02, np.zeros((10, 10, 10), np.int8))
    beside, above = np.array([[0.9, 0.0, 0.1]]).T, np.array([[-0.2, -0.8, 0.5]]).T
    inside, below = np.array([[-0.2, -0.8, 0.1]]).T, np.array([[-0.2, -0.8, -0.3]]).T
    states = [int(seen.states(seen.index(p))[0]) for p in (beside, above, inside, below)]
    assert states == [HIDDEN, OVERHEAD, CLEAR, FILLED]


def test_what_is_in_the_hand_sweeps_space_as_well():
    _, qpos, _ = reach()
    data = cubes().start()
    at = data.body("red_cube").xpos.copy()
    around = volume(HIDDEN, (at - 0.06, at + 0.06))
    held = (HeldSpan("red_cube", 0, len(qpos)),)
    assert "red_cube" not in on_the_way(around).bodies and "red_cube" in on_the_way(around, held).bodies
    assert on_the_way(around, held).hidden > on_the_way(around).hidden


@pytest.mark.parametrize(
    ("policy", "state", "broken"),
    [
        ("allow", HIDDEN, []),
        ("avoid", HIDDEN, []),
        ("refuse", HIDDEN, ["unseen_volume"]),
        ("refuse", OVERHEAD, []),
    ],
)
def test_a_verdict_refuses_what_nobody_saw_only_where_the_cell_says_so(policy, state, broken):
    twin = replace(cubes(), seen=volume(state))
    safety = SafetyLimits(unseen=policy)
    rng = np.random.default_rng(0)
    judged = judge_in_detail(
        placing(), twin, safety, panda_limits(), rng, spec=red_on_crate(), perturbed=0, nthread=1, robot=robot()
    )
    assert [c.name for c in judged.verdict.failed_checks] == broken and judged.verdict.passed == (not broken)
    rows = {c.name: c for c in judged.verdict.checks[-2:]}
    assert rows["unseen_volume"].worst == (state == HIDDEN) and rows["unseen_overhead"].worst == (state == OVERHEAD)
    assert judged.unseen is not None and "red_cube" in (judged.unseen.bodies or ("red_cube",))


def test_a_cell_may_refuse_what_hangs_overhead_too():
    unseen = on_the_way(volume(OVERHEAD))
    checks = unseen.checks(SafetyLimits(unseen="refuse", unseen_overhead=0.5))
    assert [(c.name, c.ok) for c in checks] == [("unseen_volume", True), ("unseen_overhead", False)]
