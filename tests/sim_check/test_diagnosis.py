"""Why no motion exists: bodies in the way are found by taking them away, and nothing else is blamed."""

import numpy as np

from benchmarks.scenes.estimates import estimate
from benchmarks.scenes.tabletop_twins import CRATE, CUBE, arm, blocked, cubes, only, red_on_crate, twin_of
from control.planners.motion_search import plan_motion
from control.planners.result import MotionPlan
from control.safety.limits import SafetyLimits
from control.tasks.failure import FailureCause
from sim_check.diagnosis.blocking_bodies import diagnose
from sim_check.twin.collision_masks import without_contacts

SAFETY = SafetyLimits()


def search(twin, spec):
    return plan_motion(twin, spec, SAFETY, np.random.default_rng(0), kinematics=arm(), nthread=1)


def explain(twin, spec, failure):
    return diagnose(twin, spec, failure, SAFETY, np.random.default_rng(1), arm(), nthread=1)


def test_the_cube_that_occupies_the_crate_is_blamed_and_the_one_beside_it_is_not():
    failure = search(blocked(), red_on_crate())
    assert isinstance(failure, FailureCause)
    cause = explain(blocked(), red_on_crate(), failure)
    assert (cause.kind, cause.subject, cause.bodies) == ("blocked_by", "red_cube", ("yellow_cube",))
    assert cause.evidence["any_of"] == ["yellow_cube"] and cause.evidence["without"]["blue_cube"] is False
    assert "'yellow_cube' is in the way of 'red_cube'" in cause.message
    assert cause.evidence["search_said"] == failure.message


def test_two_bodies_that_block_together_are_blamed_together():
    half = (0.055, 0.11, 0.05)
    twin = twin_of(
        estimate("crate", (0.50, 0.15, 0.03), CRATE),
        estimate("green_box", (0.471, 0.15, 0.085), half),
        estimate("blue_box", (0.529, 0.15, 0.085), half),
        estimate("red_cube", (0.45, -0.15, 0.025), CUBE),
    )
    cause = explain(twin, red_on_crate(), None)
    assert cause.kind == "blocked_by" and set(cause.bodies) == {"green_box", "blue_box"}
    assert cause.evidence["any_of"] == []


def test_something_out_of_reach_is_not_blamed_on_what_stands_around():
    twin = twin_of(
        estimate("red_cube", (1.1, 0.2, 0.025), CUBE),
        estimate("crate", (0.5, 0.0, 0.03), CRATE),
        estimate("yellow_cube", (0.5, 0.3, 0.025), CUBE),
    )
    failure = search(twin, red_on_crate())
    cause = explain(twin, red_on_crate(), failure)
    assert isinstance(failure, FailureCause) and cause.kind == "no_candidate" and cause.message == failure.message
    assert cause.evidence["explained_by_bodies"] is False


def test_a_width_is_not_explained_by_bodies():
    spec = only("minimize_l2_distance", "crate", "red_cube")
    failure = search(cubes(), spec)
    assert isinstance(failure, FailureCause) and explain(cubes(), spec, failure) is failure


def test_a_failure_that_the_twin_does_not_know_of_asks_to_look_again():
    cause = explain(cubes(), red_on_crate(), None)
    assert cause.kind == "not_achieved" and "look again" in cause.message


def test_what_leaves_less_room_than_perception_may_err_by_is_suspected_of_a_motion_that_failed():
    twin = twin_of(
        estimate("crate", (0.50, 0.15, 0.03), CRATE),
        estimate("yellow_cube", (0.49, 0.174, 0.085), CUBE, std=0.005),
        estimate("red_cube", (0.45, -0.15, 0.025), CUBE),
        estimate("blue_cube", (0.60, -0.20, 0.025), CUBE),
    )
    assert isinstance(search(twin, red_on_crate()), MotionPlan)  # beside the yellow one, with little to spare
    cause = explain(twin, red_on_crate(), None)
    assert (cause.kind, cause.bodies) == ("blocked_by", ("yellow_cube",))
    assert cause.message.startswith(
        "'yellow_cube' is likely in the way of 'red_cube': the motion that was found leaves"
    )
    assert "less than 10 mm more room than it must" in cause.message


def test_a_body_without_contacts_stays_where_it_is_and_touches_nothing():
    import mujoco

    twin = without_contacts(blocked(), ("yellow_cube",))
    data = twin.start()
    before = data.body("yellow_cube").xpos.copy()
    for _ in range(100):
        mujoco.mj_step(twin.model, data)
    np.testing.assert_allclose(data.body("yellow_cube").xpos, before, atol=1e-4)
    assert twin.get("yellow_cube") is None and blocked().get("yellow_cube") is not None
