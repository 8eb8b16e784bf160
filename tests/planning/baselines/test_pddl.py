"""The classical planner as a method of its own: one plan on what is seen and told, carried out once."""

from pathlib import Path

import pytest

from control.errors import ConfigError, GoalError, MachineError
from planning.baselines.pddl import SOLVER_SECONDS, run_pddl
from planning.baselines.solver import solve_files
from tests.support.models.furnished_world import FurnishedWorld, piece
from tests.support.models.run_contexts import context_of
from tests.support.models.symbolic_world import Journal

CUPBOARD = {"cupboard": piece("cupboard", "door", "door"), "lever": piece("lever", "lever", "rod")}
LOCKED = {"cupboard_door": "lever_rod"}


def cubes(**more) -> FurnishedWorld:
    places = {"crate": "table", "red_cube": "table", "yellow_cube": "crate"}
    return FurnishedWorld(places, frozenset({"crate"}), **more)


def reach(goal: str, world: FurnishedWorld, log=None, solver_seconds=SOLVER_SECONDS, **more):
    return run_pddl(context_of(goal, world, log=log, **more), solver_seconds)


def test_a_cube_that_is_seen_on_the_crate_is_moved_first_without_replanning(capfd):
    world, files = cubes(), {}
    result = reach("place the red cube on the crate", world, keep=files.__setitem__)
    assert result.reached and result.reason == "red_cube is on crate" and result.replans == 0
    assert result.plans[0].steps == ("move yellow_cube away from crate", "place red_cube on crate")
    assert world.places == {"crate": "table", "red_cube": "crate", "yellow_cube": "table"}
    assert set(files) == {"domain.pddl", "problem.pddl"} and "(rests-on yellow_cube crate)" in files["problem.pddl"]
    assert capfd.readouterr() == ("", "")  # planners like to introduce themselves


def test_a_bolt_that_nobody_told_of_ends_the_plan():
    world, log = cubes(furniture=CUPBOARD, bolts=LOCKED), Journal()
    result = reach("put the red cube in the cupboard", world, log)
    assert not result.reached and result.reason == "'open cupboard_door' failed: cupboard_door is 0% open"
    assert [s.action for s in result.steps] == ["open cupboard_door"]
    assert "lever_rod" in log.of("pddl")[0]["problem"] and "open-cupboard_door" not in log.of("pddl")[0]["domain"]


def test_the_same_bolt_is_drawn_by_who_was_told_of_it():
    world = cubes(furniture=CUPBOARD, bolts=LOCKED)
    told = ("cupboard_door is locked until lever_rod is open",)
    result = reach("put the red cube in the cupboard", world, told=told)
    assert result.reached and result.reason == "red_cube is in cupboard"
    assert result.plans[0].steps == ("pull lever_rod", "open cupboard_door", "place red_cube in cupboard")


def test_the_first_motion_that_fails_is_the_end():
    world = cubes()
    world.undo = 1
    result = reach("place the red cube on the crate", world)
    assert not result.reached and len(world.specs) == 1
    assert result.reason.startswith("'move yellow_cube away from crate' failed: yellow_cube is 0.05 m from crate")


def test_what_is_out_of_sight_cannot_be_planned_for():
    world = cubes(furniture=CUPBOARD)
    world.places["apple"] = "cupboard"
    result = reach("find the apple", world)
    assert not result.reached and world.specs == []
    assert result.reason == "apple is not in view; in view: crate, red cube, yellow cube, cupboard, lever"


def test_what_is_in_view_was_found_without_a_motion():
    world = cubes()
    result = reach("find the red cube", world)
    assert result.reached and world.specs == [] and result.reason.startswith("red_cube is in view: centre at x 0.400")


def test_a_goal_that_is_not_understood_is_not_reached_and_says_why():
    result = reach("juggle the cubes", cubes())
    assert not result.reached and result.reason.startswith("cannot understand 'juggle the cubes'")


def test_an_empty_goal_and_a_told_fact_of_no_use_are_errors():
    with pytest.raises(GoalError, match="the goal is empty"):
        reach("", cubes())
    with pytest.raises(ConfigError, match="there is no joint 'door'; there are none"):
        reach("find the red cube", cubes(), told=("door is blocked by crate",))


def test_a_goal_that_no_sequence_of_actions_reaches_is_not_reached():
    result = reach("pick up the red cube, then pick up the yellow cube", cubes())
    assert not result.reached
    assert result.reason == "pyperplan finds no sequence of actions that leads to the goal"


def test_a_planner_that_takes_too_long_is_ended():
    result = reach("place the red cube on the crate", cubes(), solver_seconds=0.01)
    assert not result.reached and result.reason == "pyperplan found no plan within 0.01 s"


def test_a_planner_that_falls_over_is_an_error(tmp_path: Path):
    (tmp_path / "domain.pddl").write_text("(define")
    (tmp_path / "problem.pddl").write_text("(define")
    with pytest.raises(MachineError, match="pyperplan ended with an error"):
        solve_files(tmp_path / "domain.pddl", tmp_path / "problem.pddl", 60.0)
