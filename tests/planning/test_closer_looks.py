"""A thing is looked at again where its place is known less well than the grasp or the placement tolerates."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.scenes.estimates import estimate, scene
from control.robot.gripper import PANDA_HAND
from control.safety.limits import SafetyLimits
from control.tasks.reward_spec import RewardSpec, RewardTerm
from planning.loop.closer_looks import doubted_things

PLACE = RewardSpec((RewardTerm("minimize_l2_distance", "red_cube", "crate", primary=True),))
REACH = RewardSpec((RewardTerm("minimize_l2_distance", "palm", "red_cube", primary=True),))


def doubted(spec=PLACE, cube=0.003, crate=0.003, width=0.05, held=None, **more):
    things = (
        replace(estimate("red_cube", (0.4, 0.0, 0.025), (width, 0.06, 0.05), std=cube), **more),
        estimate("crate", (0.5, 0.2, 0.03), (0.11, 0.2, 0.06), std=crate),
    )
    return doubted_things(spec, scene(*things), PANDA_HAND, SafetyLimits(), held)


def test_things_that_are_known_well_enough_are_not_doubted():
    assert doubted() == ()
    # (80 - 50) / 2 - 2 mm of room beside the fingers: a spread of 6 mm is just tolerated, one of 7 mm is not.
    assert doubted(cube=0.006) == ()


def test_a_grasp_tolerates_what_the_open_fingers_leave_beside_the_thing():
    (thing,) = doubted(cube=0.007)
    assert (thing.name, thing.why) == ("red_cube", "its place is known to 14 mm only, and the grasp tolerates 13 mm")
    # A wide thing leaves little room, yet 5 mm are always tolerated.
    assert doubted(width=0.056, cube=0.0045) == () and doubted(width=0.059, cube=0.005)[0].name == "red_cube"


def test_what_is_wider_than_the_fingers_open_or_in_the_hand_already_is_no_grasp():
    assert doubted(width=0.059, cube=0.004) == () and doubted(cube=0.05, held="red_cube") == ()
    wide = np.array([0.1, 0.1, 0.1])
    assert doubted(cube=0.05, extents=wide) == ()
    assert doubted(REACH, cube=0.05) == ()


def test_a_placement_tolerates_half_of_what_carries_it():
    assert doubted(crate=0.024) == ()
    (thing,) = doubted(crate=0.026)
    assert (thing.name, thing.why) == ("crate", "its place is known to 52 mm only, and the placement tolerates 50 mm")
    assert [d.name for d in doubted(cube=0.02, crate=0.03)] == ["red_cube", "crate"]


@pytest.mark.parametrize("doubts", [("it fills the same place as 'crate'",), ("one", "two")])
def test_a_thing_that_something_speaks_against_is_looked_at_again_with_that_reason(doubts):
    (thing,) = doubted(doubts=doubts)
    assert (thing.name, thing.why) == ("red_cube", "; ".join(doubts))
