"""What the robot's own computer does, where neither twin nor pictures nor learned models are installed."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
ABSENT = (
    "torch,transformers,open3d,mujoco,cv2,toppra,trimesh,matplotlib,mcap,mcap_ros2,openai,pyrealsense2,"
    "opencv-python-headless,ray"
)
CHECKS = """
from hw_interface.cell import client
from hw_interface.link import keys as link_keys
from hw_interface.link import rights as link_rights
from hw_interface.link import transport
from hw_interface.panda import driver, hand_process, player, player_process, serve
from replan.robot import panda_hand
from replan.robot import panda_player
from replan.robot import panda as robot_panda
from replan.robot import router
from replan.robot.gate import cell_gate
gate, cell = cell_gate("cubes", ())
import time
from control.safety.certificate import Certificate
from hw_interface.simulated.fake_backend import PerfectRobot
from benchmarks.robot_side.perfect_robot import swing
motion = swing(0.5)
right = Certificate("1", motion.content_hash(), gate.profile, gate.firmware, time.time(), gate.limits_hash, time.time(),
    time.time() + 60.0)
gate.check(motion, right, motion.q[0], PerfectRobot().read(), time.time(), set())
print("checked", cell.name)
"""


def robot_computer(module: str, *arguments: str, absent: str = ABSENT) -> "subprocess.CompletedProcess[str]":
    """Run a module where the packages are absent."""
    command = [sys.executable, "-m", "tests.support.without_packages", absent, module, *arguments]
    return subprocess.run(command, capture_output=True, text=True, cwd=ROOT, env={**os.environ, "OMP_NUM_THREADS": "1"})


def test_the_gate_checks_a_motion_there(tmp_path: Path):
    (tmp_path / "checks.py").write_text(CHECKS)
    script = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import checks"
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            f"from tests.support.without_packages import hide; hide({ABSENT!r}.split(',')); {script}",
        ],
        capture_output=True,
        text=True,
        cwd=ROOT,
    )
    assert done.stdout == "checked cubes\n", done.stderr


def test_doctor_says_that_a_robots_process_is_possible_and_a_simulated_run_is_not():
    there = robot_computer("replan.main", "doctor", "--robot-side", "--json")
    assert there.returncode == 0, there.stderr
    assert json.loads(there.stdout)["can_run_robot"] is True
    everything = robot_computer("replan.main", "doctor")
    assert everything.returncode == 1 and "a simulated run is NOT possible" in everything.stdout


def test_its_commands_start_there_and_others_say_what_is_missing(tmp_path: Path):
    panda = robot_computer("replan.main", "robot", "panda", "--address", "127.0.0.77", "--audit-log", f"{tmp_path}/a")
    assert panda.returncode == 1 and "127.0.0.77" in panda.stderr and "Traceback" not in panda.stderr
    nobody = robot_computer("replan.main", "ros2", "--robot", "tcp/127.0.0.1:9")
    assert nobody.returncode == 1 and "no robot process answers" in nobody.stderr, nobody.stderr
    simulated = robot_computer("replan.main", "robot", "sim")
    assert simulated.returncode == 1 and "mujoco is not installed" in simulated.stderr


def test_without_the_library_that_encodes_one_line_says_what_to_install():
    shown = robot_computer("replan.main", "ros2", "--robot", "tcp/127.0.0.1:9", absent="rosbags")
    assert shown.returncode == 1
    assert shown.stderr.strip().splitlines() == [
        "replan: messages of ROS 2 need the package rosbags, which is not installed; run: make setup, or "
        "make setup-robot"
    ]


@pytest.mark.parametrize(
    ("absent", "call"),
    [
        ("mcap", "from perception.ros2.mcap_file import Ros2McapFile as call"),
        ("rosbags", "from perception.recordings.mcap_writing import McapFrameWriter as call"),
        ("mcap", "from perception.recordings.mcap_stream import McapStream as call"),
        ("mcap_ros2", "from perception.recordings.mcap_stream import McapStream as call"),
        ("mcap_ros2", "from control.motion_files.mcap_motions import read_mcap as call"),
    ],
)
def test_without_a_package_for_recordings_one_line_says_what_to_install(absent: str, call: str, tmp_path: Path):
    script = f"""
from pathlib import Path

import pytest
from tests.support.without_packages import hide
from replan_base.errors import ReplanError
hide([{absent!r}])
{call}
try:
    call(Path({str(tmp_path / "a.mcap")!r}))
except ReplanError as error:
    print(error)
"""
    (tmp_path / "a.mcap").touch()
    said = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT)
    (line,) = said.stdout.splitlines() or [said.stderr]
    assert f"the package {absent}" in line and "is not installed; run: make setup" in line


def test_its_lock_holds_the_versions_of_the_whole_and_nothing_heavy():
    def versions(path: str) -> set[str]:
        return set(re.findall(r"^([a-z0-9-]+==[^ ;]+)", (ROOT / path).read_text(), re.MULTILINE))

    robot = versions("requirements-robot.lock")
    assert robot < versions("requirements.lock"), "run: make lock"
    names = {entry.partition("==")[0] for entry in robot}
    assert {"panda-python", "pymodbus", "rosbags", "cryptography", "pin", "eclipse-zenoh"} <= names
    assert not names & {"torch", "transformers", "open3d", "mujoco", "opencv-python-headless", "triton"}
