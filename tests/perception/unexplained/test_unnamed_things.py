"""Depth that nothing explains becomes things without names: no less than is there, and nothing that is not."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.scenes.estimates import estimate, scene
from perception.geometry.prepared_frame import prepared
from perception.unexplained.regions import PlacedSolid, SolidsRegion
from perception.unexplained.unnamed_things import Known, UnnamedThings, unnamed_things
from tests.support.scenes.perception_scenes import BLUE, RED, WHITE, Thing, cube, render

LOW, HIGH = np.array([-0.2, -0.8, 0.0]), np.array([0.9, 0.8, 1.3])
EMPTY = Known(LOW, HIGH)
ABOVE = {"eye": (0.35, 0.05, 0.75), "target": (0.5, 0.0, 0.0), "camera": "wrist"}
NOTHING = scene()


def seen(*things, seed=0, above=True):
    """Frames of a static camera, and of one above the table."""
    frames = [render(things, seed=seed)]
    return prepared([*frames, render(things, seed=seed + 100, **ABOVE)] if above else frames)


def inside(estimates, thing, margin=0.0):
    """Share of a thing's corners and face middles that lie in an estimate."""
    grid = np.stack(np.meshgrid(*[(-1, 0, 1)] * 3), -1).reshape(-1, 3) * np.array(thing.half)
    c, s = np.cos(thing.yaw), np.sin(thing.yaw)
    points = grid @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + thing.position
    held = np.zeros(len(points), bool)
    for o in estimates:
        local = (points - o.position) @ o.world_T_object[:3, :3]
        held |= np.all(np.abs(local) <= o.extents / 2 + margin, axis=1)
    return held.mean()


POLE = Thing("box", (0.025, 0.025, 0.175), (0.5, 0.02, 0.175), BLUE, 0.4)


def test_a_box_that_nobody_named_is_found_with_its_size_and_stands_on_the_table():
    found = unnamed_things(NOTHING, seen(POLE), EMPTY)
    assert len(found) == 1
    (pole,) = found
    assert not pole.named
    assert pole.position[:2] == pytest.approx(POLE.position[:2], abs=0.012)
    assert inside(found, POLE, margin=0.008) == 1.0
    assert np.all(pole.extents < [0.085, 0.085, 0.37])
    assert pole.position[2] - pole.extents[2] / 2 == pytest.approx(0.0, abs=0.004)
    assert {e.camera for e in pole.evidence} == {"static", "wrist"}


@pytest.mark.parametrize("seed", range(2))
def test_an_empty_table_and_named_things_leave_nothing_over(seed):
    crate = Thing("box", (0.1, 0.08, 0.05), (0.5, 0.2, 0.05), WHITE, 0.2)
    red = cube(RED, 0.45, -0.1)
    named = scene(
        estimate("crate", crate.position, 2 * np.array(crate.half), yaw=0.2),
        estimate("red_cube", red.position, 2 * np.array(red.half), yaw=red.yaw),
    )
    assert unnamed_things(NOTHING, seen(seed=seed), EMPTY) == []
    assert unnamed_things(named, seen(crate, red, seed=seed), EMPTY) == []


def test_a_named_thing_that_is_larger_than_its_estimate_is_no_obstacle_in_front_of_itself():
    red = cube(RED, 0.45, -0.1)
    smaller = estimate("red_cube", red.position, 2 * np.array(red.half) - 0.016, yaw=red.yaw)
    assert unnamed_things(scene(smaller), seen(red), EMPTY) == []


def test_another_thing_that_touches_a_named_one_is_not_swallowed():
    red, neighbour = cube(RED, 0.45, -0.1, yaw=0.0), Thing("box", (0.03, 0.03, 0.06), (0.45, -0.04, 0.06), BLUE)
    named = estimate("red_cube", red.position, 2 * np.array(red.half))
    found = unnamed_things(scene(named), seen(red, neighbour), EMPTY)
    assert inside(found, neighbour, margin=0.02) == 1.0
    # Its box ends where the cube begins, within the cube's margin.
    for o in found:
        assert o.position[1] - o.extents[1] / 2 > -0.085 or abs(o.yaw) > 0.02


def test_a_thing_on_a_named_one_ends_at_its_top():
    crate = Thing("box", (0.1, 0.08, 0.05), (0.5, 0.2, 0.05), WHITE, 0.0)
    load = Thing("box", (0.03, 0.03, 0.04), (0.5, 0.2, 0.14), BLUE, 0.0)
    named = scene(estimate("crate", crate.position, 2 * np.array(crate.half)))
    found = unnamed_things(named, seen(crate, load), EMPTY)
    assert len(found) == 1
    assert found[0].position[2] - found[0].extents[2] / 2 == pytest.approx(0.10, abs=0.004)
    assert inside(found, load, margin=0.008) == 1.0


def test_a_beam_in_the_air_leaves_the_space_beneath_it_free():
    beam = Thing("box", (0.02, 0.25, 0.02), (0.5, 0.0, 0.30), BLUE)
    found = unnamed_things(NOTHING, seen(beam), EMPTY)
    assert inside(found, beam, margin=0.01) == 1.0
    assert all(o.position[2] - o.extents[2] / 2 > 0.2 for o in found)


def test_one_box_is_not_put_around_an_angle_of_free_space():
    long_, short = (
        Thing("box", (0.02, 0.15, 0.05), (0.4, 0.0, 0.05), BLUE),
        Thing("box", (0.12, 0.02, 0.05), (0.54, 0.13, 0.05), BLUE),
    )
    found = unnamed_things(NOTHING, seen(long_, short), EMPTY)
    assert inside(found, long_, margin=0.012) == inside(found, short, margin=0.012) == 1.0
    corner = np.array([0.56, -0.05, 0.04])
    for o in found:
        local = (corner - o.position) @ o.world_T_object[:3, :3]
        assert np.any(np.abs(local) > o.extents / 2)


def test_a_side_that_nobody_saw_is_said_to_be_unsure():
    screen = Thing("box", (0.01, 0.12, 0.12), (0.45, 0.0, 0.12), BLUE)
    (front,) = unnamed_things(NOTHING, seen(screen, above=False), EMPTY)
    assert front.extents_std is not None
    thin = int(np.argmin(front.extents[:2]))
    assert front.extents_std[thin] > 0.025
    assert inside([front], screen, margin=0.012) == 1.0
    (both,) = unnamed_things(NOTHING, seen(POLE), EMPTY)
    assert both.extents_std is not None and both.extents_std.max() < 0.02


def test_what_the_robot_fills_is_no_obstacle_and_what_stands_outside_of_its_reach_is_none():
    frames = seen(POLE)
    pose = np.eye(4)
    pose[:3, 3] = POLE.position
    pose[:2, :2] = [[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]]
    robot = SolidsRegion((PlacedSolid("box", np.array(POLE.half), pose),))
    assert unnamed_things(NOTHING, frames, replace(EMPTY, robot=robot)) == []
    assert unnamed_things(NOTHING, frames, Known(LOW, np.array([0.3, 0.8, 1.3]))) == []


def test_a_thing_keeps_its_name_while_it_stands_and_when_it_is_moved():
    things = UnnamedThings()
    other = Thing("box", (0.04, 0.04, 0.03), (0.4, -0.25, 0.03), WHITE)
    moved = replace(other, position=(0.62, -0.1, 0.03))
    first = things.added(NOTHING, seen(POLE, other), EMPTY)
    names = {o.name: o.position[1] for o in first.objects}
    assert sorted(names) == ["unnamed_1", "unnamed_2"]
    again = things.added(NOTHING, seen(POLE, other, seed=7), EMPTY)
    for name, y in names.items():
        thing = again.get(name)
        assert thing is not None and thing.position[1] == pytest.approx(y, abs=0.01)
    low = min(names, key=lambda name: names[name])
    later = things.added(NOTHING, seen(POLE, moved), EMPTY).get(low)
    assert later is not None and later.position[:2] == pytest.approx(moved.position[:2], abs=0.012)
    third = Thing("box", (0.03, 0.05, 0.02), (0.35, 0.25, 0.02), RED)
    assert "unnamed_3" in things.added(NOTHING, seen(POLE, moved, third), EMPTY).names
