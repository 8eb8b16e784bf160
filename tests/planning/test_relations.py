"""Relations and facts: from perceived boxes to sentences."""

import numpy as np
import pytest

from perception.estimates import ObjectEstimate, SceneEstimate, Shape, Unseen
from planning.language.relations import find_relations
from planning.loop.perceiver import describe


def thing(name, position, extents, shape: Shape = "box", yaw=0.0) -> ObjectEstimate:
    c, s = np.cos(yaw), np.sin(yaw)
    pose = np.eye(4)
    pose[:2, :2] = [[c, -s], [s, c]]
    pose[:3, 3] = position
    extents = np.asarray(extents, float)
    return ObjectEstimate(name, name, pose, extents, shape, np.full(3, 0.003), 0.02, 0.9, 0.0)


def scene(*things, unseen=()) -> SceneEstimate:
    return SceneEstimate(things, tuple(unseen), 0.0, 0.0, "test")


CRATE = thing("crate", (0.5, 0.0, 0.04), (0.12, 0.12, 0.08))


def relations(*things) -> list[str]:
    return [str(r) for r in find_relations(scene(*things))]


@pytest.mark.parametrize("error", [-0.007, 0.0, 0.007])
def test_a_cube_on_a_crate_is_on_it_despite_an_error_of_perception(error):
    cube = thing("cube", (0.51, 0.01, 0.08 + 0.025 + error), (0.05, 0.05, 0.05), yaw=0.4)
    assert relations(CRATE, cube) == relations(cube, CRATE) == ["cube is on crate"]


def test_a_cube_above_or_beside_a_crate_is_not_on_it():
    assert relations(CRATE, thing("cube", (0.5, 0.0, 0.15), (0.05, 0.05, 0.05))) == []
    assert relations(CRATE, thing("cube", (0.7, 0.0, 0.025), (0.05, 0.05, 0.05))) == []
    # Half over the rim: its centre is beyond the footprint.
    assert relations(CRATE, thing("cube", (0.57, 0.0, 0.105), (0.05, 0.05, 0.05))) == []


def test_a_lemon_in_a_bowl_is_in_it_and_a_bigger_apple_beside_it_is_next_to_it():
    bowl = thing("bowl", (0.5, 0.0, 0.035), (0.10, 0.10, 0.07), "cylinder")
    lemon = thing("lemon", (0.51, 0.0, 0.03), (0.06, 0.036, 0.036))
    apple = thing("apple", (0.5, 0.12, 0.033), (0.066, 0.066, 0.066), "sphere")
    assert relations(bowl, lemon, apple) == ["lemon is in bowl", "bowl is next to apple"]


def test_next_to_measures_gaps_between_turned_boxes():
    turned = thing("bar", (0.5, 0.17, 0.02), (0.20, 0.02, 0.04), yaw=np.pi / 2)  # its near end is 10 mm off the crate
    assert relations(CRATE, turned) == ["crate is next to bar"]
    assert relations(CRATE, thing("bar", (0.5, 0.17, 0.02), (0.20, 0.02, 0.04))) == []  # 100 mm off


def test_facts_tell_sizes_places_relations_and_what_was_sought_in_vain():
    cube = thing("red_cube", (0.5, 0.0, 0.105), (0.05, 0.05, 0.05))
    facts = describe(scene(CRATE, cube, unseen=[Unseen("apple", "no box above the threshold")]))
    assert facts == (
        "crate: box of 120 x 120 x 80 mm, centre at x 0.500, y 0.000, z 0.040 m",
        "red_cube: box of 50 x 50 x 50 mm, centre at x 0.500, y 0.000, z 0.105 m",
        "red_cube is on crate",
        "apple is not in view: no box above the threshold",
    )
