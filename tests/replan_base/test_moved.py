"""An import of a module that has moved says where to."""

import ast
import importlib
import importlib.util
import sys

import pytest

from replan_base.moved import MovedModules, moves, tell_where_modules_went
from replan_base.packages import ROOT


def test_a_moved_module_is_named_with_its_new_place_and_the_release():
    with pytest.raises(
        ModuleNotFoundError, match=r"^control\.warp has moved to control\.retiming\.interior_point \(version 0\.2"
    ):
        importlib.import_module("control.warp")


@pytest.mark.parametrize(
    "statement", ["import control.warp", "from control.warp import Warp", "from control import warp"]
)
def test_every_form_of_import_says_it(statement):
    with pytest.raises(ModuleNotFoundError, match=r"^control\.warp has moved to control\.retiming\.interior_point "):
        exec(statement, {})


def test_what_was_in_a_module_whose_name_is_a_package_now_is_looked_for_in_the_right_place():
    with pytest.raises(
        ModuleNotFoundError,
        match=r"^control\.trajectory has no 'Trajectory'; what the module control\.trajectory held has moved to "
        r"control\.trajectory\.samples \(version 0\.2",
    ):
        exec("from control.trajectory import Trajectory", {})


@pytest.mark.parametrize("statement", ["import control.nothing", "import controller", "import perception.geometry.no"])
def test_a_module_that_never_was_is_missing_as_everywhere(statement):
    with pytest.raises(ModuleNotFoundError, match=r"^No module named '"):
        exec(statement, {})


def test_every_new_name_can_be_found_and_no_old_one_is_a_module_still():
    for old, (new, _) in moves().items():
        spec = importlib.util.find_spec(new)
        assert spec is not None, f"'{new}' is no module; where did it go? Correct replan_base/moved_modules.json"
        there = ROOT.joinpath(*old.split("."))
        assert not there.with_suffix(".py").exists(), f"{old} is in the table of moved modules, and there"
        assert new not in moves(), f"{old} leads to {new}, which moved again; the table holds last places only"


def test_asking_twice_adds_one_finder_at_the_end():
    tell_where_modules_went()
    tell_where_modules_went()
    assert sys.meta_path.count(MovedModules) == 1


def test_what_every_folder_stands_on_needs_the_standard_library_alone():
    for file in (ROOT / "replan_base").rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            for name in names:
                top = name.partition(".")[0]
                assert top in sys.stdlib_module_names or top == "replan_base", f"{file.name} imports {name}"
