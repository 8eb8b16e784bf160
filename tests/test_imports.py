"""Folders and the rooms in them import each other only along the design's arrows; the command line starts fast."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.structure import circles, class_names, folder_widths, imported_modules, modules, room_of

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
# The rooms (sub-packages) of each folder, and which rooms of the same folder each may import. A room may also import
# the modules that lie directly in its folder, unless these stand on top of the rooms (ON_TOP).
ROOMS = {
    "perception": {
        "catalogue": set(),
        "tracking": set(),
        "ros2": set(),
        "geometry": {"catalogue"},
        "unexplained": {"catalogue", "geometry", "known_shapes", "tracking"},
        "recordings": {"geometry", "ros2"},
        "known_shapes": {"catalogue", "geometry"},
        "detection": {"catalogue", "geometry"},
        "stages": {"catalogue", "geometry", "tracking", "detection", "known_shapes"},
        "evaluation": {"detection"},
        "train": {"catalogue", "detection", "evaluation"},
    },
    "control": {
        "robot": set(),
        "trajectory": {"robot"},
        "safety": {"robot", "trajectory"},
        "tasks": {"robot", "safety"},
        "retiming": {"robot", "safety", "trajectory"},
        "motion_files": {"robot", "trajectory"},
        "path_planning": {"robot", "safety", "tasks"},
        "simulation": {"robot", "trajectory", "safety", "tasks", "path_planning"},
        "grasping": {"robot", "trajectory", "safety", "tasks", "path_planning"},
        "planners": {"robot", "trajectory", "safety", "tasks", "path_planning", "simulation", "grasping"},
    },
    "hw_interface": {
        "messages": set(),
        "link": {"messages"},
        "cameras": {"messages", "link"},
        "cell": {"messages", "link", "cameras"},
        "simulated": {"link", "cell"},
        "panda": {"messages", "cell"},
        "robotiq": {"panda"},
        "ros2": {"messages", "link", "cell"},
        "fci_simulator": {"messages", "link", "cameras", "cell", "simulated"},
    },
    "sim_check": {
        "objects": set(),
        "cells": set(),
        "models": {"cells", "objects"},
        "furniture": {"cells", "objects", "models"},
        "twin": {"cells", "objects", "models", "furniture"},
        "diagnosis": {"twin"},
        "verdict": {"twin"},
        "world": {"cells", "objects", "models", "furniture", "twin"},
        "random_scenes": {"cells", "objects", "models", "furniture", "world"},
    },
    "planning": {
        "language": set(),
        "builtin": {"language"},
        "reasoners": {"language", "builtin"},
        "loop": {"language", "reasoners"},
        "baselines": {"language", "builtin", "reasoners", "loop"},
    },
    "replan": {
        "reports": set(),
        "doctor": set(),
        "robot": set(),
        "run": {"robot"},
        "validate": {"reports", "run"},
        "perceive": {"reports"},
        "rc": {"reports", "run"},
        "commands": {"doctor", "robot", "run", "validate", "perceive", "rc"},
    },
}
ON_TOP = {"perception.pipeline", "perception.scene_file", "replan.main"}
# The simulated cell's truth, and who scores against what truly was there: nobody else may know either.
TRUTH = {
    "sim_check.world": {"replan.robot", "sim_check.random_scenes"},
    "perception.evaluation": {"perception.train", "replan.perceive"},
}
# Modules that ask a cell for its truth over the wire: recordings and scores, and the ablation that the benchmark of the
# paper compares perception with (only with a cell that the run has started for scoring itself).
ASKING_FOR_TRUTH = {
    "replan.robot.record",
    "replan.rc.episode",
    "replan.rc.tabletop_goals",
    "replan.run.true_poses",
}
WIDEST = 20  # modules directly in one folder
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


@pytest.mark.parametrize("folder", sorted(ROOMS))
def test_a_room_imports_only_what_its_folder_allows(folder):
    known, rooms = modules(), ROOMS[folder]
    for module, file in known.items():
        room = room_of(module, known)
        if not room.startswith(folder + ".") or room == module:
            continue
        name = room.split(".")[1]
        assert name in rooms, f"'{room}' is a room that this table does not have"
        assert ast.get_docstring(ast.parse((ROOT / folder / name / "__init__.py").read_text())), f"{room} says nothing"
        for other in imported_modules(file, known):
            target = room_of(other, known)
            if target.startswith(folder + ".") and target != room:
                allowed = target not in ON_TOP if target == other else target.split(".")[1] in rooms[name]
                assert allowed, f"{module} imports {other}; '{room}' may import {sorted(rooms[name])}"


def test_no_circle_runs_through_the_rooms():
    assert not circles(modules())


def test_no_class_name_stands_twice():
    assert not [name for name, count in class_names(modules()).items() if count > 1]


def test_only_scorers_and_the_simulated_cell_know_the_truth():
    known = modules()
    for module, file in known.items():
        for other in imported_modules(file, known):
            told = TRUTH.get(room_of(other, known))
            assert told is None or room_of(module, known) in {*told, room_of(other, known)}, f"{module} imports {other}"


def test_only_named_modules_ask_a_cell_for_its_truth():
    asking = set()
    for module, file in modules().items():
        if module.split(".")[0] not in ("control", "sim_check", "planning", "replan"):
            continue
        calls = (node.func for node in ast.walk(ast.parse(file.read_text())) if isinstance(node, ast.Call))
        if any(isinstance(call, ast.Attribute) and call.attr in ("truth", "frame_truth") for call in calls):
            asking.add(module)
    assert asking == ASKING_FOR_TRUTH


def test_no_folder_is_too_wide():
    wide = {str(folder): count for folder, count in folder_widths().items() if count > WIDEST}
    assert not wide, f"a folder holds {WIDEST} modules at most"


def modules_after(statement: str) -> set[str]:
    """Names of the modules that a fresh interpreter has loaded after a statement."""
    code = f"import sys\n{statement}\nprint(' '.join(sys.modules))"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    return set(out.stdout.split())


def test_the_command_line_imports_nothing_heavy_before_a_command_is_run():
    loaded = modules_after("import replan.main, replan.commands, replan.console, replan.errors")
    assert not loaded & set(HEAVY)


def test_a_robot_side_reads_and_verifies_a_certificate_without_twin_and_robot_model(tmp_path):
    from benchmarks.robot_side.perfect_robot import certificate, swing
    from control.motion_files.trajectory_file import write_trajectory
    from control.safety.certificate_file import write_certificate

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
