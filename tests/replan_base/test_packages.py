"""An environment that mixes this program's packages with others of the same names is refused in one line."""

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from replan_base.packages import PACKAGES, ROOT

SIZE = 40  # bytes of every invented file


def write(file: Path, text: str = "") -> None:
    """A file of a size of its own in a folder that may not be there yet."""
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text.ljust(SIZE, "#"))


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """A folder of packages as an installer leaves it, with a list of its files; the check and the command are real."""
    folder = tmp_path / "site-packages"
    for name in PACKAGES:
        write(folder / name / "__init__.py")
    write(folder / "control" / "errors.py")
    write(folder / "control" / "robot" / "limits.py")
    for file in (ROOT / "replan" / "main.py", ROOT / "replan" / "console.py", *(ROOT / "replan_base").glob("*.py")):
        (folder / file.relative_to(ROOT)).write_text(file.read_text())
    files = [file for file in folder.rglob("*") if file.is_file()]
    record(folder, "replan-0.2.0", *(f"{f.relative_to(folder).as_posix()},sha256=x,{f.stat().st_size}" for f in files))
    return folder


def record(site: Path, distribution: str, *lines: str) -> None:
    """The list of files of an installed distribution."""
    folder = site / f"{distribution}.dist-info"
    folder.mkdir(exist_ok=True)
    (folder / "RECORD").write_text("\n".join((*lines, f"{distribution}.dist-info/RECORD,,", "")))


def install_python_control(site: Path) -> None:
    """What python-control's installer does."""
    (site / "control" / "__init__.py").write_text("from control.statesp import *\n")
    write(site / "control" / "statesp.py")
    record(site, "control-0.10.2", "control/__init__.py,sha256=x,30", f"control/statesp.py,sha256=x,{SIZE}")


def command(site: Path, *arguments: str, before: str = "") -> "subprocess.CompletedProcess[str]":
    """The command, from this folder and nothing of the checkout."""
    path = os.pathsep.join(filter(None, (before, str(site))))
    code = f"import sys; sys.argv = {['replan', *arguments]!r}; from replan.main import main; main()"
    return subprocess.run(
        [sys.executable, "-S", "-c", code],  # without the checkout, which the environment of the tests knows
        capture_output=True,
        text=True,
        cwd=site.parent,
        env={**os.environ, "PYTHONPATH": path},
    )


def check(site: Path) -> str:
    """What the check alone says of this folder, "" where all is well."""
    code = (
        "from replan_base.errors import ForeignPackageError\n"
        "from replan_base.packages import require_own_packages\n"
        "try:\n    require_own_packages()\nexcept ForeignPackageError as error:\n    print(error)\n"
    )
    env = {**os.environ, "PYTHONPATH": str(site)}
    done = subprocess.run(
        [sys.executable, "-S", "-c", code],
        capture_output=True,
        text=True,
        cwd=site.parent,
        env=env,
        check=True,
    )
    return done.stdout.strip()


def test_packages_as_they_were_installed_are_accepted(site):
    for name in PACKAGES:
        write(site / name / "__pycache__" / "errors.cpython-311.pyc")  # made by Python, or by the installer
    (site / "control" / ".DS_Store").touch()
    assert check(site) == ""


def test_python_control_in_the_same_environment_is_refused_in_one_line_by_name_and_version(site):
    install_python_control(site)
    done = command(site, "run", "place the red cube on the crate")
    assert done.returncode == 1 and done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert "the package 'control' of this environment is mixed with another one of that name" in line
    assert "control/statesp.py is not of this program, but of control 0.10.2" in line
    assert "'uv tool install' or 'pipx install' (docs/install.md)" in line


def test_with_json_the_reason_is_an_object_on_stdout(site):
    install_python_control(site)
    assert json.loads(command(site, "doctor", "--json").stdout)["error"] == "ForeignPackageError"


def test_it_is_refused_as_well_where_this_program_came_last_and_its_own_files_are_whole(site):
    write(site / "control" / "statesp.py")
    record(site, "control-0.10.2", "control/__init__.py,sha256=x,30", f"control/statesp.py,sha256=x,{SIZE}")
    assert "control/statesp.py is not of this program, but of control 0.10.2" in check(site)


def test_a_package_that_has_no_file_of_another_name_is_found_by_its_changed_beginning(site):
    (site / "planning" / "__init__.py").write_text("answer = 42\n")
    record(site, "planning-1.0", "planning/__init__.py,sha256=x,12")
    assert "planning/__init__.py is not of this program, but of planning 1.0" in check(site)


def test_files_that_no_distribution_claims_are_named_without_one(site):
    write(site / "prompts" / "mine.py")
    assert "prompts/mine.py is not of this program, but of no distribution that is known here" in check(site)


def test_a_package_that_lost_its_beginning_is_incomplete(site):
    (site / "control" / "__init__.py").unlink()  # python-control was removed afterwards
    assert "the package 'control' of this program is incomplete" in check(site)


def test_a_package_that_is_found_before_ours_is_named_with_its_place(site, tmp_path):
    other = tmp_path / "other"
    write(other / "control" / "__init__.py")
    record(other, "control-0.10.2", f"control/__init__.py,sha256=x,{SIZE}")
    done = command(site, "doctor", before=str(other))
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert f"the package 'control' that Python finds is {other}/control/__init__.py, of control 0.10.2" in line
    assert f"hides this program's in {site}" in line


def test_the_check_takes_a_few_milliseconds_of_processor_time():
    code = (
        "import time; begun = time.process_time()\n"
        "from replan_base.packages import require_own_packages\n"
        "require_own_packages(); print(time.process_time() - begun)"
    )
    times = [float(subprocess.check_output([sys.executable, "-c", code], cwd=ROOT)) for _ in range(5)]
    assert min(times) < 0.03  # 5 ms where it was measured; what a slow machine adds must not fail a test


def test_the_wheel_holds_exactly_these_packages():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert sorted(project["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]) == sorted(PACKAGES)
    assert all((ROOT / name / "__init__.py").is_file() for name in PACKAGES)
