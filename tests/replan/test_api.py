"""The Python interface: light to import, silent, and described by a page whose examples run."""

import ast
import importlib.util
import inspect
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from replan import api
from replan.errors import exit_code
from replan_base.packages import ROOT

# All that `import replan.api` may load beside the standard library.
LIGHT = {
    "replan",
    "replan.api",
    "replan_base",
    "replan_base.errors",
    "replan_base.moved",
    "replan_base.packages",
    "replan_base.parts",
}
PAGE = ROOT / "docs" / "api.md"


def python(code: str, cwd: Path) -> "subprocess.CompletedProcess[str]":
    """Run code in a process of its own."""
    return subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        cwd=cwd,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )


def test_importing_it_loads_nothing_heavy_and_none_of_the_folders(tmp_path: Path):
    code = "import json, sys; b = set(sys.modules); import replan.api; print(json.dumps([*set(sys.modules) - b]))"
    done = python(code, tmp_path)
    loaded = {name for name in json.loads(done.stdout) if name.partition(".")[0] not in sys.stdlib_module_names}
    assert loaded <= LIGHT, sorted(loaded - LIGHT)


def test_a_package_of_somebody_elses_is_refused_before_it_is_imported(tmp_path: Path):
    (tmp_path / "control").mkdir()
    (tmp_path / "control" / "__init__.py").write_text("raise SystemExit('the wrong control')\n")
    code = (
        "from replan import api\ntry:\n    api.load_cell('cubes')\nexcept api.ReplanError as error:\n    print(error)"
    )
    assert "the package 'control' that Python finds is" in python(code, tmp_path).stdout


def test_everything_public_is_there_and_has_a_docstring():
    for name in api.__all__:
        assert inspect.getdoc(getattr(api, name)), name
    assert set(api.__all__) <= set(dir(api))


def test_a_name_that_is_not_public_is_refused_with_those_that_are():
    with pytest.raises(AttributeError, match=r"replan\.api has no 'RunGoal'; it has .*RunOptions"):
        _ = api.RunGoal  # type: ignore[attr-defined]


def test_types_are_declared_for_checkers_and_imported_from_the_same_places():
    tree = ast.parse(inspect.getsource(api))
    (block,) = (n for n in tree.body if isinstance(n, ast.If))
    declared = {a.name: n.module for n in block.body if isinstance(n, ast.ImportFrom) for a in n.names}
    assert declared == api._MODULES


def test_it_can_neither_print_nor_end_the_process_nor_read_the_environment():
    tree = ast.parse(inspect.getsource(api))
    names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    modules = {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
    assert not names & {"print", "exit", "quit"} and not modules & {"os", "sys"}


def test_all_errors_have_one_root_and_an_exit_code():
    kinds = [getattr(api, name) for name in api.__all__ if name.endswith("Error")]
    assert len(kinds) > 10
    assert all(issubclass(kind, api.ReplanError) for kind in kinds)
    assert exit_code(api.GoalError("empty")) == 2


def test_options_that_are_not_valid_are_errors_of_that_tree(tmp_path: Path):
    with pytest.raises(api.GoalError, match="the goal is empty"):
        api.run_goal(api.RunOptions(goal=" ", runs_dir=tmp_path))
    with pytest.raises(api.ConfigError, match="kitchen"):
        api.load_cell("kitchen")
    with pytest.raises(api.MotionFileError, match=r"gone\.csv"):
        api.validate_motion(api.ValidateOptions(tmp_path / "gone.csv", cell="cubes"))
    with pytest.raises(api.PerceptionError, match="gone"):
        looked_for = api.PerceiveOptions(names=("red_cube",), out=tmp_path / "out")
        api.perceive_recording(tmp_path / "gone.npz", looked_for)
    with pytest.raises(api.RobotGoneError, match=r"127\.0\.0\.1:9"):
        api.connect("tcp/127.0.0.1:9", timeout=0.5)


def test_a_part_that_is_not_installed_is_an_error_of_that_tree(tmp_path: Path):
    code = (
        f"import sys; sys.path.insert(0, {str(ROOT)!r})\n"
        "from tests.support.without_packages import hide; hide(['cv2', 'mujoco', 'toppra', 'open3d'])\n"
        "from pathlib import Path\n"
        "from replan import api\n"
        "for call in (\n"
        "    lambda: api.run_goal(api.RunOptions(goal='place the red cube on the crate')),\n"
        "    lambda: api.validate_motion(api.ValidateOptions(Path('a.csv'), cell='cubes')),\n"
        "    lambda: api.perceive_recording(Path('a.npz'), api.PerceiveOptions(names=('a',), out=Path('out'))),\n"
        "):\n"
        "    try:\n        call()\n    except api.ReplanError as error:\n        print(error)\n"
    )
    done = python(code, tmp_path)
    lines = done.stdout.splitlines()
    assert len(lines) == 3 and all("not installed" in line and "run: make setup" in line for line in lines), done


def test_the_page_is_what_the_docstrings_say():
    spec = importlib.util.spec_from_file_location("render_api", ROOT / "docs" / "render_api.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert PAGE.read_text() == module.page(), "run: .venv/bin/python docs/render_api.py"


def test_the_examples_of_the_page_run_and_the_functions_print_nothing(tmp_path: Path):
    examples = re.findall(r"```python\n(from .*?)```", PAGE.read_text(), re.DOTALL)
    assert len(examples) == 3
    done = python("\n".join(examples), tmp_path)
    assert done.returncode == 0, done.stderr
    first, *found, verdict = done.stdout.splitlines()
    assert re.fullmatch(r"\d+ motions in [\d.]+ s; the record is in runs/.*", first)
    assert {line.split()[0] for line in found} == {"red_cube", "crate"}
    assert verdict == "passed"
    assert done.stderr == ""
