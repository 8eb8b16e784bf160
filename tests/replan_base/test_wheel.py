"""What is installed from a wheel: everything that the program reads, nothing of the tests, and it runs by itself."""

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from replan_base.packages import PACKAGES, ROOT

# In every Python process below: no file of the checkout is opened but those of its environment.
WATCH = f"""
import os, sys
CHECKOUT, ENVIRONMENT = {str(ROOT) + os.sep!r}, {sys.prefix + os.sep!r}
def watch(event, arguments):
    if event in ("open", "os.listdir", "os.scandir") and isinstance(arguments[0], (str, bytes)):
        path = os.path.abspath(os.fsdecode(arguments[0]))
        if path.startswith(CHECKOUT) and not path.startswith(ENVIRONMENT):
            os.write(2, b"READ OUTSIDE OF THE WHEEL: " + path.encode() + b"\\n")
            os._exit(99)
sys.addaudithook(watch)
"""


def files_of(folder: Path) -> set[str]:
    """What lies in the packages of a folder, without what Python makes itself."""
    found = (file for name in PACKAGES for file in (folder / name).rglob("*") if file.is_file())
    return {file.relative_to(folder).as_posix() for file in found if "__pycache__" not in file.parts}


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, made by the project's own build system and unpacked as an installer does."""
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder / "dist")]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = (folder / "dist").glob("replan-*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    (folder / "watch").mkdir()
    (folder / "watch" / "sitecustomize.py").write_text(WATCH)
    return folder / "site"


def installed(site: Path, cwd: Path, *arguments: str) -> "subprocess.CompletedProcess[str]":
    """Run Python where this program is known from the wheel alone."""
    path = os.pathsep.join((str(site), str(site.parent / "watch")))
    return subprocess.run(
        [sys.executable, "-P", *arguments],
        capture_output=True,
        text=True,
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1"},
    )


def test_it_holds_every_file_of_every_package_and_nothing_else(site: Path):
    assert files_of(site) == files_of(ROOT)
    beside = {entry.name for entry in site.iterdir()} - set(PACKAGES)
    assert all(name.endswith(".dist-info") for name in beside), beside


def test_it_holds_templates_cells_profiles_weights_data_and_types(site: Path):
    for name in (
        "benchmarks/goals/other_words/locked-oven.yaml",
        "benchmarks/motion/data/planner_paths.npz",
        "control/robot/profiles/panda-5.yaml",
        "perception/weights/detector/model.safetensors",
        "prompts/templates/high_level_plan.j2",
        "replan/reports/templates/perceive.html.j2",
        "replan_base/moved_modules.json",
        "sim_check/cells/builtin/cubes.yaml",
        "sim_check/models/panda_collision.json",
        *(f"{package}/py.typed" for package in PACKAGES),
    ):
        assert (site / name).is_file(), name


def test_a_read_of_the_checkout_would_be_noticed(site: Path, tmp_path: Path):
    done = installed(site, tmp_path, "-c", f"open({str(ROOT / 'README.md')!r})")
    assert done.returncode == 99 and "READ OUTSIDE OF THE WHEEL" in done.stderr


def test_every_benchmark_can_be_imported_without_the_tests_and_the_checkout(site: Path, tmp_path: Path):
    code = (
        "import importlib, pkgutil, sys, benchmarks\n"
        "names = [m.name for m in pkgutil.walk_packages(benchmarks.__path__, 'benchmarks.')]\n"
        "for name in names: importlib.import_module(name)\n"
        "print(len(names), sorted(n for n in sys.modules if n.partition('.')[0] in ('tests', 'pytest')))"
    )
    done = installed(site, tmp_path, "-c", code)
    assert done.returncode == 0, done.stderr
    count, others = done.stdout.split(maxsplit=1)
    assert int(count) > 30 and others.strip() == "[]"


def test_a_benchmark_runs_from_it_anywhere(site: Path, tmp_path: Path):
    (tmp_path / "control").mkdir()  # a folder of the user's that has the name of one of our packages
    (tmp_path / "control" / "__init__.py").write_text("raise SystemExit('the wrong control')\n")
    done = installed(
        site, tmp_path, "-m", "replan.main", "bench", "motions", "--runs", "1", "--motions", "lift", "--json"
    )
    assert done.returncode == 0, done.stderr
    assert len(json.loads(done.stdout)) > 0
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["control"]


def test_its_own_check_finds_its_packages_whole_and_python_control_over_them(site: Path, tmp_path: Path):
    code = "from replan_base.packages import require_own_packages; require_own_packages(); print('whole')"
    assert installed(site, tmp_path, "-c", code).stdout == "whole\n"
    foreign = site / "control" / "statesp.py"
    foreign.touch()
    try:
        done = installed(site, tmp_path, "-m", "replan.main", "doctor")
    finally:
        foreign.unlink()
    assert done.returncode == 1 and done.stderr.startswith("replan: the package 'control' of this environment is mixed")
