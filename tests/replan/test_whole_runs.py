"""Whole runs in simulated cells of their own, as a user starts them, at the fastest pace."""

import json
import os
import signal
import subprocess
import sys
from contextlib import contextmanager

import numpy as np

from control.motion_files.reading import read_motion
from control.motion_files.resampling import to_trajectory
from hw_interface.cell.client import CellClient
from hw_interface.cell.process import start_sim_process
from perception.recordings.opening import open_recording
from tests.support.waiting import until


def start(tmp_path, goal, cell, *arguments):
    """Start a run as a user would."""
    return subprocess.Popen(
        [sys.executable, "-m", "replan.main", "run", goal, "--cell", cell, "--speed", "0", "--json", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=tmp_path,
    )


def finish(process):
    """Wait; returns (exit code, the JSON result, stderr)."""
    out, err = process.communicate()
    assert "Traceback" not in err, err
    return process.returncode, json.loads(out) if out.strip() else {}, err


def events(folder):
    return [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]


def only_run(tmp_path):
    """The folder of the only run below."""
    (folder,) = (tmp_path / "runs").iterdir()
    return folder


@contextmanager
def moving_run(tmp_path):
    """A run whose robot, a process of its own, moves now; the run, the robot's process and a client of it."""
    command = [sys.executable, "-m", "replan.main", "robot", "sim", "--cell", "cubes", "--endpoint", "tcp/127.0.0.1:0"]
    with start_sim_process(command) as robot, CellClient.connect(robot.endpoint) as client:
        goal = ("place the red cube on the crate", "cubes", "--no-video", "--robot", robot.endpoint)
        run = start(tmp_path, *goal)
        assert until(lambda: client.state().mode == "moving" or run.poll() is not None, 300.0)
        yield run, robot, client


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


def test_a_robot_process_that_is_killed_while_moving_ends_the_run_with_its_reason(tmp_path):
    with moving_run(tmp_path) as (run, robot, _):
        os.kill(robot.pid, signal.SIGKILL)
        _, err = run.communicate()
    (reason,) = [line for line in err.splitlines() if line.startswith("replan: ")]
    assert f"the robot process at {robot.endpoint} has ended" in reason
    assert run.returncode == 1
    assert events(only_run(tmp_path))[-1]["event"] == "ended_early"


def test_ctrl_c_brings_the_arm_to_rest_and_leaves_a_complete_record(tmp_path):
    with moving_run(tmp_path) as (run, _, client):
        run.send_signal(signal.SIGINT)
        _, err = run.communicate()
        assert run.returncode == 130, err
        state = client.state()
        assert state.mode == "stopped" and np.abs(state.qd).max() < 1e-6
    assert "Traceback" not in err
    last = events(only_run(tmp_path))[-1]
    assert (last["event"], last["error"]) == ("ended_early", "KeyboardInterrupt")
