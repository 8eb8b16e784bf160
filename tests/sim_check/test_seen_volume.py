"""A twin knows which space its look has seen: what stands is known, what is above free space can only hang there."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.scenes.estimates import estimate, scene
from benchmarks.scenes.tabletop_twins import CRATE, CUBE, arm, red_on_crate
from control.planners.motion_search import plan_motion
from control.planners.result import MotionPlan
from control.robot.limits import REST_Q
from control.safety.limits import SafetyLimits
from control.seen_volume import CLEAR, FILLED, HIDDEN, OVERHEAD
from perception.seen_space import FREE, SeenSpace
from sim_check.cells.loading import load_cell
from sim_check.twin.seen_volume import REACH
from sim_check.twin.twin import build_twin

THINGS = (
    estimate("crate", (0.50, 0.15, 0.03), CRATE, yaw=0.2),
    estimate("red_cube", (0.45, -0.15, 0.025), CUBE, yaw=0.3),
)
NOTHING = SeenSpace.unseen(np.array([-0.3, -0.9, 0.0]), np.array([0.9, 0.9, 1.3]))


def seen_free(low, high):
    """A look that saw a box (low, high) to be free, and nothing else."""
    state = NOTHING.state.copy()
    a, b = (np.round((np.array(corner) - NOTHING.low) / NOTHING.step).astype(int) for corner in (low, high))
    state[a[0] : b[0], a[1] : b[1], a[2] : b[2]] = FREE
    return replace(NOTHING, state=state)


def twin_after(seen):
    return build_twin(load_cell("cubes"), replace(scene(*THINGS), seen=seen), np.array(REST_Q), 0.08)


def state_at(twin, *point):
    return int(twin.seen.states(twin.seen.index(np.array([point]).T))[0])


def test_a_twin_without_a_look_says_so():
    assert twin_after(None).seen is None


def test_things_the_robot_and_the_table_are_known_and_all_else_is_hidden():
    twin = twin_after(NOTHING)
    assert state_at(twin, 0.5, 0.15, 0.03) == state_at(twin, 0.45, -0.15, 0.025) == FILLED
    assert state_at(twin, 0.0, 0.0, 0.1) == CLEAR  # the robot's base
    palm = twin.start().body("panda_hand").xpos
    assert state_at(twin, *palm) == CLEAR
    assert state_at(twin, 0.6, -0.3, 0.05) == state_at(twin, 0.6, -0.3, 0.6) == HIDDEN
    assert state_at(twin, 0.6, -0.3, -0.01) == FILLED


def test_what_is_above_space_that_was_seen_to_be_free_is_overhead_but_not_beside_it():
    twin = twin_after(seen_free((0.3, -0.6, 0.0), (0.8, 0.0, 0.3)))
    assert state_at(twin, 0.55, -0.3, 0.1) == CLEAR
    assert state_at(twin, 0.55, -0.3, 0.5) == OVERHEAD
    # Things overhang their feet: something that stands beside the free space reaches a little above it.
    rim = 0.8 - (REACH - 0.5) * 0.02
    assert state_at(twin, rim, -0.3, 0.1) == CLEAR and state_at(twin, rim, -0.3, 0.5) == HIDDEN
    assert state_at(twin, 0.2, -0.3, 0.5) == HIDDEN


def test_one_free_voxel_does_not_make_the_space_above_it_overhead():
    twin = twin_after(seen_free((0.3, -0.6, 0.0), (0.8, 0.0, 0.02)))
    assert state_at(twin, 0.55, -0.3, 0.5) == HIDDEN


@pytest.mark.parametrize("policy", ["allow", "avoid"])
def test_a_search_prefers_ways_that_were_seen_unless_anything_is_allowed(policy):
    # All but one side of the crate and the cube was seen: the way over the other side costs.
    twin = twin_after(seen_free((-0.3, -0.9, 0.0), (0.9, 0.9, 0.4)))
    safety = SafetyLimits(unseen=policy)
    plan = plan_motion(twin, red_on_crate(), safety, np.random.default_rng(0), kinematics=arm(), nthread=1)
    unknowing = plan_motion(
        replace(twin, seen=None), red_on_crate(), safety, np.random.default_rng(0), kinematics=arm(), nthread=1
    )
    assert isinstance(plan, MotionPlan) and isinstance(unknowing, MotionPlan)
    if policy == "allow":
        assert plan.cost == unknowing.cost
    else:
        assert plan.cost > unknowing.cost
