"""Things that nobody named are bodies of the twin: loose ones where a hand could hold them, else fixed obstacles."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.scenes.estimates import estimate, scene
from benchmarks.scenes.tabletop_twins import CRATE, CUBE, arm, red_on_crate
from control.planners.motion_search import plan_motion
from control.planners.result import MotionPlan
from control.robot.limits import REST_Q
from control.safety.limits import SafetyLimits
from control.tasks.failure import FailureCause
from sim_check.cells.loading import load_cell
from sim_check.diagnosis.blocking_bodies import diagnose
from sim_check.twin.twin import build_twin, perturbed_twin

CELL = load_cell("cubes")
CRATE_THERE = estimate("crate", (0.50, 0.15, 0.03), CRATE)
CUBE_THERE = estimate("red_cube", (0.45, -0.15, 0.025), CUBE)


def unnamed(position, extents, size_std=0.004, name="unnamed_1"):
    found = estimate(name, position, extents)
    return replace(found, named=False, extents_std=np.full(3, size_std))


def twin_of(*objects):
    return build_twin(CELL, scene(*objects), np.array(REST_Q), 0.08)


def place(twin, name):
    return twin.start().body(name).xpos.copy()


def test_what_a_hand_could_hold_is_loose_and_all_else_is_a_fixed_obstacle():
    small = unnamed((0.6, 0.0, 0.05), (0.05, 0.06, 0.10))
    twin = twin_of(
        small,
        unnamed((0.6, 0.3, 0.1), (0.2, 0.15, 0.2), name="unnamed_2"),
        unnamed((0.6, -0.3, 0.05), (0.05, 0.06, 0.10), size_std=0.03, name="unnamed_3"),
    )
    loose = {o.name: (o.movable, o.named) for o in twin.objects}
    assert loose == {"unnamed_1": (True, False), "unnamed_2": (False, False), "unnamed_3": (False, False)}
    varied = perturbed_twin(twin, np.random.default_rng(0))
    for name in loose:
        assert 1e-4 < np.linalg.norm(place(varied, name) - place(twin, name)) < 0.02


def test_a_beam_in_the_air_stays_there_and_a_cube_may_stand_on_an_obstacle():
    beam = unnamed((0.6, 0.0, 0.4), (0.04, 0.5, 0.04), size_std=0.03)
    block = unnamed((0.4, 0.3, 0.05), (0.16, 0.16, 0.10), name="unnamed_2")
    twin = twin_of(beam, block, estimate("red_cube", (0.4, 0.3, 0.127), CUBE))
    assert place(twin, "unnamed_1") == pytest.approx([0.6, 0.0, 0.4])
    assert place(twin, "red_cube") == pytest.approx([0.4, 0.3, 0.125], abs=0.002)


def test_a_box_whose_margin_reaches_into_a_named_thing_neither_moves_it_nor_refuses_the_twin():
    wall = unnamed((0.45, -0.21, 0.1), (0.3, 0.095, 0.2))  # 22 mm into the cube
    twin = twin_of(CUBE_THERE, wall)
    assert place(twin, "red_cube") == pytest.approx(CUBE_THERE.position, abs=0.001)
    assert place(twin, "unnamed_1") == pytest.approx(wall.position)


def test_a_loose_guess_that_cannot_rest_beside_a_named_thing_stands_fixed():
    leaning = unnamed((0.45, -0.18, 0.06), (0.05, 0.05, 0.12))  # 20 mm into the cube
    twin = twin_of(CUBE_THERE, leaning)
    thing = twin.get("unnamed_1")
    assert thing is not None and not thing.movable
    assert place(twin, "red_cube") == pytest.approx(CUBE_THERE.position, abs=0.002)


def test_a_motion_goes_around_what_nobody_named():
    pole = unnamed((0.475, 0.02, 0.175), (0.06, 0.06, 0.35), size_std=0.03)
    found = plan_motion(
        twin_of(CRATE_THERE, CUBE_THERE, pole),
        red_on_crate(),
        SafetyLimits(),
        np.random.default_rng(0),
        kinematics=arm(),
        nthread=1,
    )
    assert isinstance(found, MotionPlan)


def test_an_obstacle_that_nobody_named_can_be_the_cause_of_a_failure():
    cover = unnamed((0.50, 0.15, 0.16), (0.14, 0.14, 0.2), size_std=0.03)
    twin = twin_of(CRATE_THERE, CUBE_THERE, cover)
    safety = SafetyLimits()
    failure = plan_motion(twin, red_on_crate(), safety, np.random.default_rng(0), kinematics=arm(), nthread=1)
    assert isinstance(failure, FailureCause)
    cause = diagnose(twin, red_on_crate(), failure, safety, np.random.default_rng(1), arm(), nthread=1)
    assert (cause.kind, cause.bodies) == ("blocked_by", ("unnamed_1",))
