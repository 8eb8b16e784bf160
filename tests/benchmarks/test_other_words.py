"""Goals in other words on other cells: they speak of cells that can be built, and none is reached before it begins."""

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest

from benchmarks.goals.other_words import Row, run_apart, summary
from benchmarks.goals.other_words_goals import CELLS, GOALS, SETS, Ending, WordGoal, at, fulfilled, inside, on, opened
from benchmarks.goals.other_words_plans import PlanRow, plan_counts, plan_one
from perception.ground_truth import CellTruth
from sim_check.cells.loading import builtin_cells, load_cell
from sim_check.world.world import World, build_world

ANSWERED_AT_ONCE = ("lemon_asked_for", "something_in_bowl")  # what is asked for is in view
FILES = sorted(CELLS.glob("*.yaml"))


def world_of(cell: str, seed: int, options: tuple[str, ...] = ()) -> World:
    return build_world(load_cell(CELLS / f"{cell}.yaml", dict.fromkeys(options, True)), seed, meshes=False)


@cache
def start_of(cell: str, seed: int, options: tuple[str, ...]) -> CellTruth:
    return world_of(cell, seed, options).truth()


def start(goal: WordGoal) -> CellTruth:
    return start_of(goal.cell, goal.seed, goal.options)


def with_at(truth: CellTruth, name: str, middle: np.ndarray, offset: Sequence[float]) -> CellTruth:
    pose = np.eye(4)
    pose[:3, 3] = middle + np.asarray(offset)
    return replace(truth, things={**truth.things, name: replace(truth.things[name], world_T_object=pose)})


def with_fraction(truth: CellTruth, joint: str, fraction: float) -> CellTruth:
    return replace(truth, joints={**truth.joints, joint: replace(truth.joints[joint], fraction=fraction)})


def bare(text: str) -> str:
    return re.sub(r"[^a-z ]", "", text.lower()).strip()


def test_each_set_has_thirty_goals_and_no_name_or_wording_comes_twice():
    assert [len(of.goals) for of in SETS.values()] == [30, 30]
    assert len(GOALS) == 60
    assert len({bare(goal.goal) for goal in GOALS.values()}) == 60


@pytest.mark.parametrize("number", SETS)
def test_every_cell_is_used_by_each_set_and_none_is_a_built_in_one(number):
    assert {goal.cell for goal in SETS[number].goals.values()} == {file.stem for file in FILES}
    assert not {file.stem for file in FILES} & set(builtin_cells())


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_every_cell_stands_still_and_free_of_overlaps(file):
    cell = load_cell(file)
    assert cell.name == file.stem
    world = world_of(file.stem, 7, tuple(cell.options))
    assert max(-c.dist for c in world.data.contact[: world.data.ncon]) < 1e-3
    before = world.truth()
    for _ in range(500):
        mujoco.mj_step(world.model, world.data)
    for name, pose in world.truth().poses.items():
        assert np.linalg.norm(pose[:3, 3] - at(before, name)) < 1e-3, name


@pytest.mark.parametrize("name", GOALS)
def test_no_goal_is_fulfilled_by_a_run_that_does_nothing_and_says_nothing(name):
    goal, truth = GOALS[name], start(GOALS[name])
    for claimed in (True, False):
        ok, why = fulfilled(goal, Ending(claimed, "", truth, truth))
        assert not ok and why


@pytest.mark.parametrize("name", GOALS)
def test_every_goal_that_is_no_refusal_and_no_question_about_what_is_in_view_is_open_at_the_start(name):
    goal = GOALS[name]
    if goal.reached is not None and name not in ANSWERED_AT_ONCE:
        assert not goal.reached(start(goal))
    assert set(goal.may_move) <= set(start(goal).poses)


@pytest.mark.parametrize("name", [n for n, g in GOALS.items() if g.reached is None])
def test_a_refusal_must_name_what_is_not_understood_or_not_there_and_touch_nothing(name):
    goal, truth = GOALS[name], start(GOALS[name])
    word = goal.refused[0]
    assert fulfilled(goal, Ending(False, f"'{word.replace(' ', '_')}' is not there", truth, truth))[0]
    assert fulfilled(goal, Ending(False, f"do not understand '{word}'"))[0]
    assert not fulfilled(goal, Ending(False, "something is not there", truth, truth))[0]
    assert not fulfilled(goal, Ending(True, f"put the {word} there", truth, truth))[0]
    thing = next(iter(truth.poses))
    shoved = with_at(truth, thing, at(truth, thing), (0.03, 0.0, 0.0))
    assert not fulfilled(goal, Ending(False, f"'{word}' is not there", truth, shoved))[0]


def test_a_block_that_was_put_on_the_crate_counts_unless_something_else_was_pushed_away():
    goal, before = GOALS["polite"], start(GOALS["polite"])
    crate = at(before, "blue_crate")
    after = with_at(before, "green_block", crate, (0.02, 0.0, 0.03 + 0.02))
    assert fulfilled(goal, Ending(True, "it is on the crate", before, after)) == (True, "")
    assert not fulfilled(goal, Ending(False, "not reached", before, after))[0]
    pushed = with_at(after, "red_crate", at(before, "red_crate"), (0.05, 0.0, 0.0))
    assert fulfilled(goal, Ending(True, "it is on the crate", before, pushed)) == (False, "moved red_crate")


def test_a_block_in_the_air_or_beside_the_crate_is_not_on_it():
    truth = start(GOALS["polite"])
    crate = at(truth, "blue_crate")
    for wrong in ((0.0, 0.0, 0.08), (0.09, 0.0, 0.05)):
        assert not on("green_block", "blue_crate")(with_at(truth, "green_block", crate, wrong))


def test_what_lies_in_a_cupboard_is_inside_and_what_stands_before_or_on_it_is_not():
    truth = start(GOALS["stow_and_shut"])
    assert inside("lemon", "cupboard")(truth)
    assert not inside("blue_cube", "cupboard")(truth)
    above = (0.0, 0.0, truth.things["cupboard"].extents[2] / 2 + 0.025)
    assert not inside("blue_cube", "cupboard")(with_at(truth, "blue_cube", at(truth, "cupboard"), above))


def test_a_door_counts_as_open_from_half_of_its_way():
    truth = start(GOALS["oven_door"])
    assert not opened("oven_door")(with_fraction(truth, "oven_door", 0.49))
    assert opened("oven_door")(with_fraction(truth, "oven_door", 0.51))


@pytest.mark.parametrize(
    ("name", "joint", "right", "wrong"),
    [
        ("apple_asked_for", "oven_door", "There is no apple in the oven.", "The apple is in the oven."),
        ("block_asked_for", "cabinet_door", "The red_block is in the cabinet.", "There is no block in the cabinet."),
        ("left_in_oven", "oven_door", "The green_cube is in the oven.", "The green_cube is not in the oven."),
        ("where", "cabinet_door", "the red_block is in the cabinet", "the red_block is not in the cabinet"),
        ("where", "cabinet_door", "In the cabinet.", "the red_block is in the microwave"),
    ],
)
def test_a_question_needs_the_true_answer_and_a_look_behind_the_door(name, joint, right, wrong):
    goal, before = GOALS[name], start(GOALS[name])
    after = with_fraction(before, joint, 0.9)
    assert fulfilled(goal, Ending(True, right, before, after))[0]
    assert not fulfilled(goal, Ending(True, wrong, before, after))[0]
    assert not fulfilled(goal, Ending(True, right, before, before))[0]


@pytest.mark.parametrize("right", ["The lemon is in the cyan_bowl.", "Yes.", "the bowl is not empty"])
def test_whether_something_is_in_the_bowl_is_answered_by_a_yes_or_by_its_name(right):
    goal, truth = GOALS["something_in_bowl"], start(GOALS["something_in_bowl"])
    assert fulfilled(goal, Ending(True, right, truth, truth))[0]
    for wrong in ("there is nothing in the bowl", "something is not in view; in view: cyan_bowl, lemon"):
        assert not fulfilled(goal, Ending(True, wrong, truth, truth))[0]


def test_a_cube_of_which_there_are_two_must_be_refused_as_meaning_either():
    goal, truth = GOALS["which_cube"], start(GOALS["which_cube"])
    assert fulfilled(goal, Ending(False, "'cube' may mean blue_cube or yellow_cube", truth, truth))[0]
    wrong = "'cube' is not in view; in view: red_crate, blue_cube, yellow_cube"
    assert not fulfilled(goal, Ending(False, wrong, truth, truth))[0]
    stacked = with_at(truth, "blue_cube", at(truth, "red_crate"), (0.0, 0.0, 0.055))
    assert not fulfilled(goal, Ending(True, "the blue cube is on the crate", truth, stacked))[0]


def test_a_bar_that_still_hangs_behind_the_handles_was_not_taken_away():
    goal = GOALS["take_bar_away"]
    truth = start(goal)
    assert goal.reached is not None
    assert not goal.reached(with_at(truth, "green_bar", at(truth, "green_bar"), (0.0, 0.05, 0.0)))
    assert goal.reached(with_at(truth, "green_bar", np.array([0.45, 0.25, 0.01]), (0.0, 0.0, 0.0)))


def test_a_run_that_takes_too_long_is_ended_and_counts_as_neither_understood_nor_done(tmp_path):
    row = run_apart("oven_door", tmp_path, limit=0.2)
    assert (row.parsed, row.planned, row.done, row.folder) == (False, False, False, "")
    assert row.reason.startswith("not finished after 0.2 s")


def test_the_stage_at_which_a_goal_went_wrong_is_the_first_that_was_not_passed():
    row = Row("polite", True, True, False, 1.0, "", "")
    assert row.ended_at == "carrying out"
    assert replace(row, planned=False).ended_at == "planning"
    assert replace(row, parsed=False, planned=False).ended_at == "parsing"
    assert replace(row, done=True).ended_at == "done"
    assert summary([row, replace(row, done=True)], SETS[1]) | {"rows": []} == {
        "written": "2026-11-26",
        "goals": 2,
        "parsed": 2,
        "planned": 2,
        "done": 1,
        "rows": [],
    }


def test_a_plan_alone_stops_before_the_first_motion_and_is_not_judged():
    row = plan_one("oven_door")
    assert row.parsed and row.moves and row.ended is None
    assert row.steps and "oven_door" in row.reason


def test_what_is_asked_for_in_vain_is_refused_by_a_plan_alone():
    row = plan_one("no_such_ball")
    assert (row.moves, row.ended, row.steps) == (False, True, ())
    assert "purple ball" in row.reason


def test_plans_alone_count_refusals_only_where_one_is_wanted():
    refused = PlanRow("happy", False, (), False, True, "do not understand 'happy'")
    rows = [refused, replace(refused, name="polite", ended=False), PlanRow("shut", True, ("close it",), True, None, "")]
    assert plan_counts(rows) == {
        "goals": 3,
        "parsed": 1,
        "planned": 1,
        "to_be_refused": 1,
        "refused_as_expected": 1,
        "answered_at_once": 0,
        "ended_wrongly": 1,
    }
