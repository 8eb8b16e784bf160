"""Which methods a run may name, and what they may be told."""

from pathlib import Path
from typing import get_args, get_type_hints

import pytest

from control.errors import ConfigError
from planning.baselines import METHODS
from replan.run.goal import run_goal
from replan.run.options import RunOptions


def test_the_command_offers_exactly_the_methods_of_the_table():
    from replan.commands.run import Run

    assert get_args(get_type_hints(Run)["method"]) == tuple(METHODS)


def test_a_method_that_does_not_exist_is_refused_with_those_that_do(tmp_path: Path):
    options = RunOptions(goal="find the crate", method="magic", runs_dir=tmp_path)
    with pytest.raises(ConfigError, match="there is no method 'magic'; there are: replan, language-to-rewards"):
        run_goal(options, lambda text: None)


def test_only_methods_with_symbols_can_be_told_facts(tmp_path: Path):
    told = ("lever_rod is blocked by crate",)
    options = RunOptions(goal="find the crate", method="one-shot-plan", told=told, runs_dir=tmp_path)
    with pytest.raises(ConfigError, match=r"'one-shot-plan' cannot be told facts \(--told\); these can: pddl, task-an"):
        run_goal(options, lambda text: None)
