"""Whole runs in simulated cells of their own, as a user starts them, at the fastest pace."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from control.motion_files.reading import read_motion
from control.motion_files.resampling import to_trajectory
from perception.recordings.opening import open_recording

pytestmark = pytest.mark.timeout(240)


def start(tmp_path, goal, cell, *arguments, speed="0"):
    """Start a run as a user would."""
    return subprocess.Popen(
        [sys.executable, "-m", "replan.main", "run", goal, "--cell", cell, "--speed", speed, "--json", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=tmp_path,
    )


def finish(process):
    """Wait; returns (exit code, the JSON result, stderr)."""
    out, err = process.communicate(timeout=200)
    assert "Traceback" not in err, err
    return process.returncode, json.loads(out) if out.strip() else {}, err


def events(folder):
    return [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]


def only_run(tmp_path):
    """The folder of the only run below."""
    (folder,) = (tmp_path / "runs").iterdir()
    return folder


def wait_until_moving(process):
    """Read progress until the robot moves; returns the lines read."""
    lines = []
    for line in process.stderr:
        lines.append(line)
        if "robot: moving" in line:
            return lines
    raise AssertionError("the run ended before the robot moved:\n" + "".join(lines))


def child_of(pid):
    """Process id of the simulated cell that a run started."""
    children = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):  # a process may end while we look
            # The fourth field is the parent; the second, the name in parentheses, may contain spaces.
            if int(stat.read_text().rpartition(")")[2].split()[1]) == pid:
                children.append(int(stat.parent.name))
    (child,) = children
    return child


def test_a_typed_goal_moves_the_cube_and_leaves_its_evidence(tmp_path):
    code, result, _ = finish(start(tmp_path, "place the red cube on the crate", "cubes", "--mcap"))
    assert (code, result["reached"]) == (0, True), result
    folder = only_run(tmp_path)
    kinds = {e["event"] for e in events(folder)}
    assert {"run", "look", "motion", "verdict", "certificate", "executed", "result"} <= kinds
    assert (folder / "strip.png").stat().st_size > 10_000
    assert (folder / "run.mp4").stat().st_size > 10_000
    assert list(folder.glob("look_*.png"))
    # Two cameras, before and after the motion at least, placed in the recording as when they took the pictures.
    recorded = list(open_recording(folder / "run.mcap"))
    assert len({f.camera for f in recorded}) == 2 and len(recorded) >= 4
    seen = [f for path in sorted(folder.glob("look_*.npz")) for f in open_recording(path)]
    for frame in seen:
        nearest = min(recorded, key=lambda f: (f.camera != frame.camera, abs(f.stamp - frame.stamp)))
        np.testing.assert_allclose(nearest.world_T_camera, frame.world_T_camera, atol=1e-3)
    # What was sent is kept whole: it is what the certificate was issued for.
    certified = [e["certificate"]["trajectory_hash"] for e in events(folder) if e["event"] == "certificate"]
    kept = [to_trajectory(read_motion(file)).content_hash() for file in sorted(folder.glob("trajectory_*.npz"))]
    assert kept == certified
    # What was seen can be looked into again, without a robot.
    again = subprocess.run(
        [sys.executable, "-m", "replan.main", "perceive", str(folder / "look_001.npz"), "-n", "crate", "--json"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=True,
    )
    assert json.loads(again.stdout)["frames"][0]["objects"][0]["name"] == "crate"


def test_the_wrong_cube_on_the_crate_is_named_and_moved_first(tmp_path):
    code, result, _ = finish(start(tmp_path, "place the red cube on the crate", "cubes-blocked", "--no-video"))
    assert (code, result["reached"]) == (0, True), result
    assert result["replans"] >= 1
    causes = [e["cause"] for e in events(only_run(tmp_path)) if e["event"] == "failure"]
    assert any(c["kind"] == "blocked_by" and "yellow_cube" in c["bodies"] for c in causes)


def test_a_goal_about_something_absent_says_what_is_there_and_moves_nothing(tmp_path):
    code, result, err = finish(start(tmp_path, "place the banana in the bowl", "fruit-bowl", "--no-video"))
    assert code == 3
    assert "banana" in result["reason"]
    assert "bowl" in result["reason"]
    assert result["motions"] == 0
    assert "robot: moving" not in err


def test_a_robot_process_that_is_killed_while_moving_is_noticed_within_a_second(tmp_path):
    process = start(tmp_path, "place the red cube on the crate", "cubes", "--no-video", speed="1")
    wait_until_moving(process)
    time.sleep(0.5)
    os.kill(child_of(process.pid), signal.SIGKILL)
    killed = time.monotonic()
    assert process.stderr is not None
    for line in process.stderr:
        if line.startswith("replan: "):
            break
    else:
        raise AssertionError("the run ended without a reason")
    assert time.monotonic() - killed < 1.0
    assert "robot" in line
    process.communicate(timeout=30)
    assert process.returncode == 1
    assert events(only_run(tmp_path))[-1]["event"] == "ended_early"


def test_ctrl_c_brings_the_arm_to_rest_and_leaves_a_complete_record(tmp_path):
    process = start(tmp_path, "place the red cube on the crate", "cubes", "--no-video", speed="1")
    wait_until_moving(process)
    time.sleep(1.0)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=30)
    assert process.returncode == 130, err
    assert "Traceback" not in err
    last = events(only_run(tmp_path))[-1]
    assert (last["event"], last["error"]) == ("ended_early", "KeyboardInterrupt")
