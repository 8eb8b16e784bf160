"""The diagnosis benchmark scores what was said against worlds that it has made sure of."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.judging.diagnosis import CASES, Errors, Score, check_truth, perceived, run_case
from benchmarks.scenes.tabletop_twins import arm
from control.errors import StackError
from sim_check.cells.loading import load_cell
from sim_check.world.world import build_world

BY_NAME = {c.name: c for c in CASES}


@pytest.mark.parametrize("name", ["none", "bar"])
def test_a_world_that_is_not_as_its_case_says_is_an_error_of_the_benchmark(name):
    case = BY_NAME[name]
    world = build_world(load_cell(case.cell), 0, meshes=False)
    check_truth(world, case)
    wrong = replace(case, kind=None if case.kind else "blocked_by")
    with pytest.raises(StackError, match=f"case '{name}': pushed in the truth, '{case.term.subject}' is (not )?free"):
        check_truth(world, wrong)


def test_what_is_said_wrongly_is_counted_and_shown_with_its_seed():
    score = Score()
    run_case(replace(BY_NAME["bar"], bodies=("yellow_cube",)), Errors(), 3, arm(), score)
    assert score.right == [False]
    assert score.wrong[0].startswith("seed 3: blocked_by ['red_bar']: 'red_bar' keeps 'wooden_cabinet_left_door'")


def test_the_stack_under_test_does_not_get_what_lies_in_closed_furniture():
    cell = load_cell("kitchen-explore")
    scene = perceived(build_world(cell, 0, meshes=False), cell, Errors(), np.random.default_rng(0))
    assert set(scene.names) == {"kettle", "microwave", "wooden_cabinet"}


def test_the_command_prints_one_json_object_with_both_tables():
    command = [sys.executable, "-m", "benchmarks.judging.diagnosis", "--runs", "1", "--cases", "kettle", "--json"]
    root = Path(__file__).resolve().parents[2]
    out = subprocess.run(command, capture_output=True, text=True, check=True, cwd=root)
    tables = json.loads(out.stdout)["diagnosis"]
    assert list(tables) == ["poses", "5mm_2deg"]
    assert tables["poses"]["kettle"]["runs"] == 1 and tables["poses"]["kettle"]["right"] == 1
