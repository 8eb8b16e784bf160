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


def test_a_robot_side_reads_and_verifies_a_certificate_without_twin_and_robot_model(tmp_path):
    from control.motion_files.trajectory_file import write_trajectory
    from control.safety.certificate_file import write_certificate
    from tests.support.hw_support import certificate, swing

    motion = swing(0.2, 0.01)
    write_trajectory(tmp_path / "motion.npz", motion)
    write_certificate(tmp_path / "certificate.json", certificate(motion))
    loaded = modules_after(
        "import time\n"
        "from pathlib import Path\n"
        "from control.safety.certificate_file import read_certificate\n"
        "from control.safety.certification import verify_certificate\n"
        "from control.errors import RefusedError\n"
        "from control.motion_files.npz_motions import read_npz\n"
        "import hw_interface.cell.gate, control.trajectory.on_path_stop, control.trajectory.speed_override\n"
        f"c = read_certificate(Path({str(tmp_path / 'certificate.json')!r}))\n"
        f"t = read_npz(Path({str(tmp_path / 'motion.npz')!r})).trajectory\n"
        "verify_certificate(c, t, c.profile, c.firmware, c.limits_hash, time.time(), set(), t.q[0], 60.0)\n"
        "try:\n"
        "    verify_certificate(c, t, c.profile, 'another', c.limits_hash, time.time(), set(), t.q[0], 60.0)\n"
        "except RefusedError as refused:\n"
        "    assert refused.code == 'wrong_firmware'\n"
        "else:\n"
        "    raise SystemExit('a certificate for another firmware was accepted')\n"
    )
    assert not loaded & {*HEAVY, "scipy"}


def test_frame_and_trajectory_types_need_numpy_only():
    loaded = modules_after(
        "import perception.frames, control.trajectory.samples, control.robot.limits\n"
        "import control.safety.certificate, control.tasks.reward_spec"
    )
    assert not loaded & {*HEAVY, "scipy", "pydantic"}
