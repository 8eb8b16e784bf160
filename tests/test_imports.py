"""The folders import each other only along the design's arrows, and the command line starts fast."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
ARROWS = {
    "perception": set(),
    "control": set(),
    "hw_interface": {"control", "perception"},
    "sim_check": {"control", "perception"},
    "prompts": set(),
    "planning": {"control", "perception", "hw_interface", "sim_check", "prompts"},
    "replan": {"control", "perception", "hw_interface", "sim_check", "prompts", "planning"},
}
HEAVY = ("torch", "open3d", "transformers", "mujoco", "cv2", "pinocchio", "matplotlib")


def imported_folders(file: Path) -> set[str]:
    """Top-level names that a file imports, wherever in the file it does."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            names.add(node.module.split(".")[0])
    return names


@pytest.mark.parametrize("folder", sorted(ARROWS))
def test_a_folder_imports_only_what_the_design_allows(folder):
    files = list((ROOT / folder).rglob("*.py"))
    assert files
    for file in files:
        forbidden = (imported_folders(file) & set(ARROWS)) - ARROWS[folder] - {folder}
        assert not forbidden, f"{file.relative_to(ROOT)} imports {sorted(forbidden)}"


def modules_after(statement: str) -> set[str]:
    """Names of the modules that a fresh interpreter has loaded after a statement."""
    code = f"import sys\n{statement}\nprint(' '.join(sys.modules))"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    return set(out.stdout.split())


def test_the_command_line_imports_nothing_heavy_before_a_command_is_run():
    loaded = modules_after("import replan.main, replan.commands, replan.console, replan.errors")
    assert not loaded & set(HEAVY)


def test_frame_and_trajectory_types_need_numpy_only():
    loaded = modules_after(
        "import perception.frames, control.trajectory, control.limits, control.certificate, control.rewards"
    )
    assert not loaded & {*HEAVY, "scipy", "pydantic"}
