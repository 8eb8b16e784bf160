"""Where an optional package is not installed, every command says in one line which, and what to type."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from perception.frames import CameraIntrinsics, RgbdFrame
from perception.recordings.opening import save_npz
from replan_base.errors import MissingPartError
from replan_base.packages import ROOT
from replan_base.parts import PART_OF, install_part, missing_parts_named

# What a wheel without any extra leaves out.
ABSENT = sorted(PART_OF)
# All commands of one process, each as if it were typed; progress in brackets is no part of the reason.
RUN = """
import contextlib, io, json, sys
from tests.support.without_packages import hide
hide(sys.argv[1].split(","))
from replan.main import main
ends = []
for words in json.loads(sys.argv[2]):
    sys.argv = ["replan", *words]
    said = io.StringIO()
    with contextlib.redirect_stderr(said):
        try:
            main()
            code = None
        except SystemExit as end:
            code = end.code
    ends.append([code, [line for line in said.getvalue().splitlines() if not line.startswith("[")]])
print(json.dumps(ends))
"""
COMMANDS = (
    ("run", "place the red cube on the crate"),
    ("validate", "pick.csv", "--cell", "cubes"),
    ("perceive", "recording.npz", "--names", "red_cube"),
    ("robot", "sim"),
    ("robot", "research-interface"),
    ("camera", "recording", "recording.npz", "--name", "static"),
    ("ros2",),
    ("security", "init", "keys", "--host", "localhost"),
    ("bench", "goals"),
)


def test_every_command_ends_with_one_line_that_says_what_to_install(tmp_path: Path):
    (tmp_path / "pick.csv").write_bytes((ROOT / "docs" / "validate" / "pick.csv").read_bytes())
    lens = CameraIntrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)
    frame = RgbdFrame(np.zeros((48, 64, 3), np.uint8), np.full((48, 64), 0.5, np.float32), lens, np.eye(4), 0.0)
    save_npz(tmp_path / "recording.npz", [frame])
    code = f"import sys; sys.path.insert(0, {str(ROOT)!r})\n{RUN}"
    done = subprocess.run(
        [sys.executable, "-c", code, ",".join(ABSENT), json.dumps(COMMANDS)],
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    for words, (code, lines) in zip(COMMANDS, json.loads(done.stdout.splitlines()[-1]), strict=True):
        assert code == 1, (words, lines)
        (line,) = lines
        assert re.fullmatch(r"replan: .*\b(is|are) not installed.*; run: make setup(, or make setup-robot)?", line), (
            line
        )


def test_a_benchmarks_own_process_says_it_too():
    command = [sys.executable, "-m", "tests.support.without_packages", "toppra", "replan_base.script"]
    done = subprocess.run(
        [*command, "benchmarks.motion.retime", "--seeds", "1"], capture_output=True, text=True, cwd=ROOT
    )
    assert done.returncode == 1
    assert done.stderr == "replan: this needs the package toppra, which is not installed; run: make setup\n"


def test_what_to_type_is_make_in_a_checkout_and_pip_where_a_wheel_is_installed(tmp_path):
    assert install_part("twin") == "make setup"
    assert install_part("panda") == "make setup, or make setup-robot"
    assert install_part("twin", tmp_path) == "pip install 'replan[twin]'"


def test_an_import_that_fails_for_another_reason_keeps_its_own_error():
    said = "this needs the package torch, which is not installed; run: "
    with pytest.raises(MissingPartError, match=said), missing_parts_named():
        raise ModuleNotFoundError("No module named 'torch.nn'", name="torch.nn")
    with pytest.raises(ModuleNotFoundError, match=r"control\.nothing"), missing_parts_named():
        import control.nothing  # type: ignore # noqa: F401


def test_every_part_is_an_extra_of_the_package():
    import tomllib

    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert set(PART_OF.values()) <= extras.keys()
