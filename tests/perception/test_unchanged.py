"""A further look of an unchanged world adds what it shows, and moves nothing that was seen before."""

from dataclasses import replace

import numpy as np

from benchmarks.scenes.estimates import estimate, scene
from perception.estimates import Unseen
from perception.tracking.unchanged import unchanged

CUBE = (0.05, 0.05, 0.05)
BEFORE = replace(
    scene(estimate("red_cube", (0.4, 0.0, 0.025), CUBE), estimate("unnamed_1", (0.6, 0.2, 0.05), (0.1, 0.1, 0.1))),
    unseen=(Unseen("kettle", "no box above the threshold"),),
)


def test_what_was_seen_before_stays_where_it_was_seen_even_if_the_further_look_errs_about_it():
    now = replace(scene(estimate("red_cube", (0.0, 0.0, 0.5), CUBE), table=0.02), stamp=9.0)
    both = unchanged(BEFORE, now)
    assert both.names == ("red_cube", "unnamed_1") and both.stamp == 9.0 and both.support_height == 0.0
    red = both.get("red_cube")
    assert red is not None
    np.testing.assert_allclose(red.position, [0.4, 0.0, 0.025])


def test_names_that_are_looked_at_anew_are_taken_from_the_further_look_where_it_knows_them_better():
    now = scene(estimate("red_cube", (0.41, 0.0, 0.025), CUBE, std=0.001))
    both = unchanged(BEFORE, now, {"red_cube", "unnamed_1"})
    assert [round(float(o.position[0]), 2) for o in both.objects] == [0.41, 0.6]
    vague = scene(estimate("red_cube", (0.41, 0.0, 0.025), CUBE, std=0.01))
    assert unchanged(BEFORE, vague, {"red_cube"}).objects == BEFORE.objects
    doubted = replace(BEFORE, objects=(replace(BEFORE.objects[0], doubts=("it floats",)), BEFORE.objects[1]))
    assert unchanged(doubted, vague, {"red_cube"}).objects[0] is vague.objects[0]


def test_names_that_were_not_seen_before_are_added():
    now = scene(estimate("kettle", (0.5, -0.3, 0.1), (0.2, 0.15, 0.2)), estimate("red_cube", (0.0, 0.0, 0.5), CUBE))
    both = unchanged(BEFORE, replace(now, unseen=BEFORE.unseen))
    assert both.names == ("red_cube", "unnamed_1", "kettle") and both.unseen == ()
