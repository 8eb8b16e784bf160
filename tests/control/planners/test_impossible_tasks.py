"""What cannot be done is said at once: a typed cause or an error that names what is wrong, never a long search."""

import time
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.scenes.estimates import estimate, scene
from benchmarks.scenes.furniture_twins import CABINET, cabinet
from benchmarks.scenes.tabletop_twins import (
    CRATE,
    CUBE,
    arm,
    blocked,
    cubes,
    fruit,
    hand_at,
    only,
    red_on_crate,
    twin_of,
)
from control.errors import RewardSpecError, TermConflictError
from control.planners.motion_search import plan_motion
from control.planners.result import MotionPlan
from control.safety.limits import SafetyLimits
from control.tasks.failure import FailureCause
from control.tasks.reward_spec import RewardSpec, RewardTerm
from control.tasks.term_conflicts import refuse_term_conflicts
from sim_check.cells.loading import load_cell
from sim_check.furniture.build import furniture_model
from sim_check.twin.twin import build_twin

SECONDS = 8.0  # of this process; usually below one
NEAR, FAR, LIFT, JOINT = "minimize_l2_distance", "maximize_l2_distance", "set_obj_z_position", "set_joint_fraction"


def term(kind, subject, target=None, value=None, primary=False):
    return RewardTerm(kind, subject, target, value, primary)


def spec_of(first, *others):
    return RewardSpec((replace(first, primary=True), *others))


def refused(twin, spec) -> FailureCause:
    """The cause, which must come soon."""
    arm()
    began = time.process_time()
    found = plan_motion(twin, spec, SafetyLimits(), np.random.default_rng(0), kinematics=arm(), nthread=1)
    assert time.process_time() - began < SECONDS
    assert isinstance(found, FailureCause)
    return found


def far_away(name):
    """Two things, one of which is 1.1 m away."""
    at = {"red_cube": (0.45, -0.15), "crate": (0.5, 0.0), name: (1.1, 0.2)}
    return twin_of(estimate("red_cube", (*at["red_cube"], 0.025), CUBE), estimate("crate", (*at["crate"], 0.03), CRATE))


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        (only(LIFT, "red_cube", None, 0.2), "'red_cube' is out of reach: it is 1.12 m away from the base"),
        (only(NEAR, "palm", "red_cube"), "'red_cube' is out of reach: it is 1.12 m away from the base"),
        (only(NEAR, "red_cube", "rest_position"), "'red_cube' is out of reach: it is 1.12 m away from the base"),
        (only(FAR, "red_cube", "crate", 0.9), "'red_cube' is out of reach: it is 1.12 m away from the base"),
    ],
)
def test_an_object_out_of_reach_is_named_with_its_distance_whatever_is_asked_of_it(spec, message):
    cause = refused(far_away("red_cube"), spec)
    assert (cause.kind, cause.subject) == ("no_candidate", "red_cube") and message in cause.message


def test_a_target_out_of_reach_is_named():
    cause = refused(far_away("crate"), red_on_crate())
    assert cause.kind == "no_candidate" and "'crate' is out of reach: the arm reaches none of " in cause.message


@pytest.mark.parametrize("height", [1.15, 1.9])
def test_a_height_that_no_posture_reaches_is_refused_before_any_search(height):
    cause = refused(cubes(), only(LIFT, "red_cube", None, height))
    assert cause.kind == "no_candidate" and cause.message == (
        f"{height:.2f} m is out of reach: the arm cannot hold 'red_cube' as high as that in any posture; ask for less"
    )


def test_a_distance_that_the_table_does_not_have_is_refused():
    cause = refused(cubes(), only(FAR, "red_cube", "crate", 2.0))
    assert cause.message == "there is no free place for 'red_cube' that meets the goal"


def test_a_joint_that_does_not_exist_is_not_seen_and_those_that_do_are_listed():
    cause = refused(cabinet(), only(JOINT, "microwave_door", None, 0.5))
    assert (cause.kind, cause.subject) == ("not_seen", "microwave_door")
    assert cause.message == (
        "no joint named 'microwave_door' was seen; seen were ['cabinet_left_door', 'cabinet_right_door']"
    )


@pytest.mark.parametrize("first", [True, False])
def test_a_name_that_nothing_has_is_not_seen_in_whichever_term_it_stands(first):
    absent = term(FAR, "red_cube", "green_vase", 0.2)
    spec = spec_of(absent) if first else spec_of(term(NEAR, "red_cube", "crate"), absent)
    cause = refused(cubes(), spec)
    assert (cause.kind, cause.subject) == ("not_seen", "green_vase")
    assert cause.message == "'green_vase' has no pose; seen were ['crate', 'red_cube', 'yellow_cube']"


def test_an_object_wider_than_the_gripper_is_refused_with_both_widths():
    cause = refused(cubes(), only(LIFT, "crate", None, 0.3))
    assert cause.kind == "no_candidate" and "its smallest width is 110 mm, the fingers take 76 mm" in cause.message


def test_furniture_cannot_be_lifted():
    assert refused(cabinet(), only(LIFT, "cabinet", None, 0.9)).message == "'cabinet' is fixed and cannot be carried"


def test_a_thing_that_is_doubted_is_not_taken_hold_of_and_the_doubt_is_the_reason():
    doubted = replace(estimate("red_cube", (0.45, -0.15, 0.025), CUBE), doubts=("its place is known to ± 30 mm only",))
    cause = refused(twin_of(doubted), only(LIFT, "red_cube", None, 0.2))
    assert (cause.kind, cause.subject) == ("not_seen", "red_cube")
    assert cause.message == "'red_cube' is not taken hold of: its place is known to ± 30 mm only"


# -- how the arm starts ------------------------------------------------------------------------------------------------


def test_an_arm_that_starts_inside_the_clearance_of_something_finds_its_way_out():
    seen = scene(
        estimate("crate", (0.50, 0.15, 0.03), CRATE, yaw=0.2), estimate("red_cube", (0.45, -0.15, 0.025), CUBE)
    )
    twin = build_twin(load_cell("cubes"), seen, hand_at(0.50, 0.15, 0.0705), 0.08)  # fingertips 1 mm above the crate
    spec = only(NEAR, "palm", "rest_position")
    found = plan_motion(twin, spec, SafetyLimits(), np.random.default_rng(0), kinematics=arm(), nthread=1)
    assert isinstance(found, MotionPlan)


def test_an_arm_that_starts_inside_something_fixed_is_told_inside_what():
    extents = furniture_model("cabinet", CABINET).extents
    cell = load_cell("cubes").model_copy(update={"furniture": {"cabinet": CABINET}})
    middle = (0.62 + extents[0] / 2, 0.0, extents[2] / 2)
    seen = scene(estimate("cabinet", middle, extents), estimate("red_cube", (0.4, -0.2, 0.025), CUBE))
    cause = refused(build_twin(cell, seen, hand_at(0.6, 0.0, 0.35), 0.08), only(LIFT, "red_cube", None, 0.3))
    assert (cause.kind, cause.bodies, cause.check) == ("unsafe", ("cabinet_left_door",), "arm_clearance")
    assert cause.message.startswith("the arm starts 40 mm inside 'cabinet_left_door' with 'panda_link7'")
    assert cause.message.endswith("guide it clear of 'cabinet_left_door' by hand, then look again")


# -- malformed terms ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((JOINT, "door", None, 1.5), "fraction of set_joint_fraction of 'door' must be a number from 0 to 1, not 1.5"),
        (
            (JOINT, "door", None, -0.1),
            "fraction of set_joint_fraction of 'door' must be a number from 0 to 1, not -0.1",
        ),
        (
            (FAR, "a", "b", -0.3),
            "the distance of maximize_l2_distance of 'a' must be a number from 0 to 10 m, not -0.3",
        ),
        (
            (LIFT, "a", None, float("nan")),
            "height of set_obj_z_position of 'a' must be a number from -10 to 10 m, not nan",
        ),
        (
            (LIFT, "a", None, float("inf")),
            "height of set_obj_z_position of 'a' must be a number from -10 to 10 m, not inf",
        ),
        ((LIFT, "a", None, 250.0), "height of set_obj_z_position of 'a' must be a number from -10 to 10 m, not 250.0"),
        ((LIFT, "a", None, True), "must be a number from -10 to 10 m, not True"),
        ((LIFT, "a", None, "high"), "must be a number from -10 to 10 m, not high"),
        ((LIFT, "a"), "set_obj_z_position of 'a' needs a number"),
        ((LIFT, "palm", None, 0.3), "set_obj_z_position needs the name of an object; 'palm' is none"),
        ((JOINT, "rest_position", None, 0.3), "set_joint_fraction needs the name of a joint; 'rest_position' is none"),
        ((LIFT, "a", "b", 0.3), "set_obj_z_position takes one name; it was given 'a' and 'b'"),
        ((NEAR, "a", "b", 0.3), "minimize_l2_distance takes no number; it was given 0.3"),
        ((NEAR, "a"), "minimize_l2_distance needs two names; it was given 'a' alone"),
        ((NEAR, "a", "a"), "minimize_l2_distance was given 'a' twice; name two different things"),
    ],
)
def test_a_malformed_term_says_what_would_be_valid(arguments, message):
    with pytest.raises(RewardSpecError) as error:
        RewardTerm(*arguments)
    assert message in str(error.value)


# -- term conflicts ---------------------------------------------------------------------------------------------------

ON_CRATE = term(NEAR, "red_cube", "crate")
CONFLICTS = {
    "on it and far from it": (
        ON_CRATE,
        term(FAR, "crate", "red_cube", 0.3),
        "being at 'crate' is being nearer than 0.3",
    ),
    "at and away": (term(NEAR, "palm", "crate"), term(FAR, "palm", "crate", 0.3), "being nearer than 0.3 m to it"),
    "two fractions": (
        term(JOINT, "door", None, 0.2),
        term(JOINT, "door", None, 0.9),
        "'door' can stand at one fraction",
    ),
    "two turns": (
        term("set_obj_orientation", "red_cube", None, 0.0),
        term("set_obj_orientation", "red_cube", None, 1.57),
        "'red_cube' can be turned by one angle only",
    ),
    "on and in the air": (
        ON_CRATE,
        term(NEAR, "red_cube", "rest_position"),
        "'red_cube' can be in one of these places",
    ),
    "on each other": (ON_CRATE, term(NEAR, "crate", "red_cube"), "'red_cube' and 'crate' cannot each lie on the other"),
    "two brought": (
        term(NEAR, "red_cube", "rest_position"),
        term(NEAR, "rest_position", "yellow_cube"),
        "the hand can hold one of 'red_cube' and 'yellow_cube' only",
    ),
}
IN_A_TWIN = {
    "two held high": (
        term(LIFT, "red_cube", None, 0.4),
        term(LIFT, "yellow_cube", None, 0.3),
        "the hand can hold one of 'red_cube' and 'yellow_cube' only",
    ),
    "one high, one brought": (
        term(LIFT, "red_cube", None, 0.4),
        term(NEAR, "yellow_cube", "rest_position"),
        "the hand can hold one of 'red_cube' and 'yellow_cube' only",
    ),
    "held above where it is put": (
        ON_CRATE,
        term(LIFT, "red_cube", None, 0.4),
        "put down at 'crate', the centre of 'red_cube' is no higher than 0.10 m, not 0.4 m",
    ),
    "held up and put on the table": (
        term(FAR, "red_cube", "crate", 0.2),
        term(LIFT, "red_cube", None, 0.3),
        "put down on the table, the centre of 'red_cube' is no higher than 0.04 m, not 0.3 m",
    ),
    "two places": (ON_CRATE, term(NEAR, "red_cube", "yellow_cube"), "'red_cube' can be in one of these places only"),
    "far from the neighbour": (
        ON_CRATE,
        term(FAR, "red_cube", "yellow_cube", 0.5),
        "'crate' is 0.22 m from 'yellow_cube', so nothing at 'crate' is 0.5 m away from it",
    ),
}


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("name", CONFLICTS)
def test_terms_that_exclude_each_other_are_both_named_without_any_scene(name, reverse):
    first, second, why = CONFLICTS[name]
    if reverse:
        first, second = second, first
    with pytest.raises(TermConflictError) as error:
        refuse_term_conflicts(spec_of(first, second))
    assert first.text in str(error.value) and second.text in str(error.value)
    assert "cannot both be met: " in str(error.value)
    assert reverse or why in str(error.value)


@pytest.mark.parametrize("name", IN_A_TWIN)
def test_terms_that_sizes_and_places_exclude_are_found_in_the_twin_and_refused_by_the_search(name):
    first, second, why = IN_A_TWIN[name]
    refuse_term_conflicts(spec_of(first, second))  # the terms alone do not say so
    with pytest.raises(TermConflictError) as error:
        refused(cubes(), spec_of(first, second))
    assert str(error.value) == (
        f"{first.text} and {second.text} cannot both be met: {why}; leave one of them out, or ask for one after the "
        "other"
    )


@pytest.mark.parametrize(
    ("twin", "terms"),
    [
        (cubes, (ON_CRATE, term(NEAR, "palm", "red_cube"), term(FAR, "palm", "red_cube", 0.2))),  # on the way there
        (cubes, (ON_CRATE, term(LIFT, "red_cube", None, 0.085))),  # as high as it will lie
        (cubes, (ON_CRATE, term(FAR, "red_cube", "yellow_cube", 0.15))),
        (cubes, (ON_CRATE, term(FAR, "yellow_cube", "crate", 0.15))),
        (blocked, (term(LIFT, "red_cube", None, 0.3), term(LIFT, "yellow_cube", None, 0.08))),  # it lies high already
        (fruit, (term(NEAR, "apple", "bowl"), term(FAR, "palm", "apple", 0.3))),
        (cabinet, (term(JOINT, "cabinet_left_door", None, 0.5), term(JOINT, "cabinet_left_door", None, 0.58))),
        (
            cubes,
            (
                term("set_obj_orientation", "red_cube", None, -np.pi),
                term("set_obj_orientation", "red_cube", None, np.pi),
            ),
        ),
        (cabinet, (term(JOINT, "cabinet_left_door", None, 0.0), term(JOINT, "cabinet_right_door", None, 1.0))),
    ],
)
def test_terms_that_only_shape_the_way_or_can_be_met_together_are_left_alone(twin, terms):
    refuse_term_conflicts(spec_of(*terms))
    refuse_term_conflicts(spec_of(*terms), twin())


def test_two_places_of_which_one_holds_the_other_are_one():
    twin = twin_of(
        estimate("bowl", (0.50, 0.12, 0.0265), (0.144, 0.144, 0.053), "cylinder"),
        estimate("coaster", (0.50, 0.12, 0.012), (0.05, 0.05, 0.012)),
        estimate("red_cube", (0.45, -0.15, 0.025), CUBE),
    )
    both = spec_of(term(NEAR, "red_cube", "coaster"), term(NEAR, "red_cube", "bowl"))
    refuse_term_conflicts(both, twin)
