"""When a reward term counts as met, on exact and on noisily perceived scenes."""

from typing import Literal

import numpy as np
import pytest
from numpy.typing import ArrayLike

from control.errors import UnknownObjectError
from control.robot.rotations import rotation_exp
from control.tasks.posed_object import PosedObject
from control.tasks.predicates import judge_term
from control.tasks.reward_spec import RewardTerm

PALM, REST = np.array([0.3, 0.0, 0.5]), np.array([0.307, 0.0, 0.48])
CUBE, CRATE = (0.05, 0.05, 0.05), (0.11, 0.11, 0.06)


def thing(name, position, extents, shape: Literal["box", "cylinder", "sphere"] = "box", yaw=0.0, **container):
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    pose[:3, 3] = position
    return PosedObject(name, pose, np.array(extents, float), shape, **container)


def judge(term, *things, palm: ArrayLike = PALM, start=None):
    started = None if start is None else {t.name: t for t in start}
    return judge_term(term, {t.name: t for t in things}, np.asarray(palm), REST, started)


def near(a, b):
    return RewardTerm("minimize_l2_distance", a, b)


def test_a_cube_in_the_middle_of_the_crates_top_is_on_it():
    result = judge(
        near("red_cube", "crate"), thing("red_cube", (0.5, 0.1, 0.085), CUBE), thing("crate", (0.5, 0.1, 0.03), CRATE)
    )
    assert result.met and result.residual == 0.0 and result.text == "red_cube is on crate"


@pytest.mark.parametrize(
    "position, residual",
    [
        ((0.5, 0.1, 0.185), 0.085),  # held 100 mm above, 15 of which are forgiven
        ((0.6, 0.1, 0.085), 0.05),  # beside it in the air: 100 mm off a footprint of 50 mm
        ((0.5, -0.3, 0.025), 0.353),  # on the table: 350 mm across, 45 mm too low
    ],
)
def test_a_cube_elsewhere_is_not_on_the_crate_and_the_residual_is_what_is_missing(position, residual):
    result = judge(
        near("red_cube", "crate"), thing("red_cube", position, CUBE), thing("crate", (0.5, 0.1, 0.03), CRATE)
    )
    assert not result.met and result.residual == pytest.approx(residual, abs=0.002)


def test_five_millimetres_of_perception_noise_turn_neither_a_yes_nor_a_no():
    rng = np.random.default_rng(0)
    for _ in range(300):
        wobble = lambda: rng.uniform(-0.005, 0.005, 3)  # noqa: E731
        crate = thing("crate", np.array([0.5, 0.1, 0.03]) + wobble(), np.array(CRATE) + wobble(), yaw=rng.uniform(0, 3))
        on = thing("red_cube", np.array([0.51, 0.11, 0.085]) + wobble(), CUBE)
        off = thing("red_cube", np.array([0.5, 0.22, 0.025]) + wobble(), CUBE)
        assert judge(near("red_cube", "crate"), on, crate).met
        assert not judge(near("red_cube", "crate"), off, crate).met


def test_an_apple_counts_as_in_the_bowl_only_inside_its_rim_and_below_it():
    bowl = thing(
        "bowl",
        (0.5, 0, 0.0265),
        (0.144, 0.144, 0.053),
        "cylinder",
        container=True,
        inner_floor=0.006,
        inner_radius=0.067,
    )
    apple = lambda *p: thing("apple", p, (0.069,) * 3, "sphere")  # noqa: E731
    assert judge(near("apple", "bowl"), apple(0.51, 0.01, 0.0405), bowl).met
    assert not judge(near("apple", "bowl"), apple(0.5, 0.0, 0.12), bowl).met
    assert not judge(near("apple", "bowl"), apple(0.5, 0.11, 0.0345), bowl).met


def test_near_the_palm_means_near_the_objects_surface():
    crate = thing("crate", (0.5, 0.1, 0.03), CRATE)
    assert judge(near("palm", "crate"), crate, palm=(0.5, 0.1, 0.085)).met
    result = judge(near("crate", "palm"), crate, palm=(0.5, 0.1, 0.16))
    assert not result.met and result.residual == pytest.approx(0.07)


def test_the_palm_is_home_near_its_rest_position():
    assert judge(near("palm", "rest_position"), palm=(0.307, 0.02, 0.48)).met
    assert not judge(near("palm", "rest_position"), palm=(0.307, 0.05, 0.48)).met


def test_away_asks_for_the_distance_and_for_lying_on_the_support():
    crate, away = (
        thing("crate", (0.5, 0.1, 0.03), CRATE),
        RewardTerm("maximize_l2_distance", "yellow_cube", "crate", 0.2),
    )
    assert judge(away, thing("yellow_cube", (0.5, -0.12, 0.025), CUBE), crate).met
    assert not judge(away, thing("yellow_cube", (0.5, -0.05, 0.025), CUBE), crate).met
    held = judge(away, thing("yellow_cube", (0.5, -0.2, 0.225), CUBE), crate)
    assert not held.met and "off the table" in held.text


def test_pushing_the_other_object_away_does_not_count_as_moving_away_from_it():
    cube, before = thing("yellow_cube", (0.5, 0.1, 0.025), CUBE), thing("crate", (0.5, 0.15, 0.03), CRATE)
    pushed = thing("crate", (0.5, 0.45, 0.03), CRATE)
    away = RewardTerm("maximize_l2_distance", "yellow_cube", "crate", 0.2)
    assert judge(away, cube, pushed).met
    assert not judge(away, cube, pushed, start=(cube, before)).met


def test_a_lifted_object_is_judged_by_the_height_of_its_centre():
    up = RewardTerm("set_obj_z_position", "red_cube", None, 0.25)
    assert judge(up, thing("red_cube", (0.5, 0, 0.245), CUBE)).met
    low = judge(up, thing("red_cube", (0.5, 0, 0.20), CUBE))
    assert not low.met and low.residual == pytest.approx(0.04)


def turned(position, about_x, yaw=0.0, **changes):
    """A bar that was turned about its own x axis, then about the vertical."""
    pose = np.eye(4)
    pose[:3, :3] = rotation_exp(np.array([0.0, 0.0, yaw])) @ rotation_exp(np.array([about_x, 0.0, 0.0]))
    pose[:3, 3] = position
    return PosedObject("bar", pose, np.array([0.02, 0.04, 0.20]), **changes)


@pytest.mark.parametrize("yaw", [0.0, 1.3, -2.0])
def test_a_turn_is_judged_about_the_objects_own_axis_in_whatever_heading(yaw):
    term, start = RewardTerm("set_obj_orientation", "bar", None, np.pi / 2), turned((0.5, 0, 0.1), 0.0, 0.4)
    at = (0.5, 0.05, 0.02)
    assert judge(term, turned(at, np.pi / 2, yaw), start=(start,)).met
    short = judge(term, turned(at, np.pi / 2 - 0.27, yaw), start=(start,))
    assert not short.met and short.residual == pytest.approx(0.1 * 0.1, abs=1e-6)
    assert "bar is 15 degrees from where a turn by 90 would take it" in short.text
    assert not judge(term, turned(at, -np.pi / 2, yaw), start=(start,)).met, "the other way round is another face up"


def test_a_camera_judges_a_turn_by_the_height_that_it_gives_and_says_so():
    term = RewardTerm("set_obj_orientation", "bar", None, np.pi / 2)
    start = turned((0.5, 0, 0.1), 0.0, tracked=False)
    lying = PosedObject("bar", np.eye(4), np.array([0.02, 0.20, 0.04]), tracked=False)
    assert judge(term, lying, start=(start,)).met
    judged = judge(term, start, start=(start,))
    assert not judged.met
    assert judged.text == "bar is 200 mm high, as far as it can be seen (turned as asked it is 40)"


def joint_at(fraction, wanted):
    term = RewardTerm("set_joint_fraction", "box_door", None, wanted)
    return judge_term(term, {}, PALM, REST, fractions={"box_door": fraction, "box_lid": 0.0})


@pytest.mark.parametrize(
    "fraction, wanted, met",
    [(0.96, 1.0, True), (0.9, 1.0, False), (0.04, 0.0, True), (0.4, 0.0, False), (0.5, 0.3, False), (0.34, 0.3, True)],
)
def test_a_joint_is_judged_by_where_it_stands_in_both_directions(fraction, wanted, met):
    result = joint_at(fraction, wanted)
    assert result.met is met
    assert result.residual == pytest.approx(max(0.0, abs(fraction - wanted) - 0.05))


def test_a_joint_that_does_not_exist_is_named_beside_those_that_do():
    with pytest.raises(UnknownObjectError, match=r"no joint named 'mug_door' in this scene; it has \['box_door'\]"):
        judge_term(RewardTerm("set_joint_fraction", "mug_door", None, 1.0), {}, PALM, REST, fractions={"box_door": 0.0})


def test_a_term_about_something_absent_says_what_is_there():
    with pytest.raises(UnknownObjectError, match=r"no object named 'mug' in this scene; it has \['crate'\]"):
        judge(near("mug", "crate"), thing("crate", (0.5, 0.1, 0.03), CRATE))


def test_heights_of_tilted_solids_follow_their_shape():
    tilt = np.eye(4)
    tilt[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]  # lying on its side
    lying = PosedObject("can", tilt, np.array([0.06, 0.06, 0.12]), "cylinder")
    assert lying.half_height == pytest.approx(0.03)
    assert PosedObject("box", tilt, np.array([0.06, 0.04, 0.12]), "box").half_height == pytest.approx(0.02)
    assert PosedObject("ball", tilt, np.array([0.06, 0.06, 0.06]), "sphere").half_height == pytest.approx(0.03)
