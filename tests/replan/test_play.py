"""`replan robot play` and `replan robot speed`: a certified trajectory is played as it is, or refused in one line."""

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.robot_side.perfect_robot import certificate, from_here, swing
from control.errors import RefusedError, StoppedError
from control.motion_files.trajectory_file import write_trajectory
from control.safety.certificate_file import write_certificate
from control.trajectory.samples import Trajectory
from hw_interface.cell.client import CellClient
from hw_interface.cell.process import SimProcess
from replan.robot.play import play
from tests.support.robot_side.hw_support import idle_client, robot_process
from tests.support.waiting import until


@pytest.fixture(scope="module")
def robot() -> Iterator[SimProcess]:
    with robot_process("perfect", speed=1.0) as process:
        yield process


@pytest.fixture
def client(robot: SimProcess) -> Iterator[CellClient]:
    with idle_client(robot.endpoint) as client:
        yield client


def files(folder: Path, trajectory: Trajectory, **changes: object) -> list[str]:
    write_trajectory(folder / "motion.npz", trajectory)
    write_certificate(folder / "certificate.json", certificate(trajectory, **changes))
    return [str(folder / "motion.npz"), str(folder / "certificate.json")]


def command(client: CellClient, *arguments: str) -> list[str]:
    return [sys.executable, "-m", "replan.main", "robot", *arguments, "--robot", client.endpoint]


def replan(client: CellClient, *arguments: str) -> subprocess.CompletedProcess:
    return subprocess.run(command(client, *arguments), capture_output=True, text=True, check=False)


@pytest.mark.real_time
def test_a_motion_is_played_with_progress_and_a_report(client: CellClient):
    motion = from_here(client, 0.6, 0.05)
    lines: list[str] = []
    report = play(motion, certificate(motion), client.endpoint, lines.append, 0.5)
    assert (report.samples, report.slowest, report.fastest) == (len(motion.q), 0.5, 0.5)
    assert report.seconds == pytest.approx(1.2, abs=0.05)
    assert "speed 0.5" in lines[0] and "100 %: 0.6 of 0.6 s of the motion" in lines[-1]
    assert len(lines) > 5
    np.testing.assert_array_equal(client.state().q_d, motion.q[-1])


def test_what_its_certificate_does_not_cover_is_refused_by_the_robot(client: CellClient):
    motion = from_here(client, 0.6, 0.05)
    with pytest.raises(RefusedError) as caught:
        play(motion, certificate(swing(0.6, 0.051)), client.endpoint, lambda line: None)
    assert caught.value.code == "trajectory_changed"


@pytest.mark.real_time
def test_a_robot_that_stops_by_itself_is_told_with_what_to_do(client: CellClient):
    motion = from_here(client, 3.0, 0.3)
    threading.Timer(0.8, client.stop).start()
    with pytest.raises(StoppedError, match="stopped on request"):
        play(motion, certificate(motion), client.endpoint, lambda line: None)


@pytest.mark.real_time
def test_the_command_plays_exactly_the_file(client: CellClient, tmp_path: Path):
    motion = from_here(client, 0.4, 0.02)
    done = replan(client, "play", *files(tmp_path, motion), "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["samples"] == len(motion.q)
    np.testing.assert_array_equal(client.state().q_d, motion.q[-1])
    again = replan(client, "play", str(tmp_path / "motion.npz"), str(tmp_path / "certificate.json"))
    assert again.returncode == 4
    (reason,) = [line for line in again.stderr.splitlines() if line.startswith("replan: ")]
    assert "was used already" in reason and "Traceback" not in again.stderr


def test_the_command_says_in_one_line_why_the_robot_refuses(client: CellClient, tmp_path: Path):
    motion = from_here(client, 0.4, 0.02)
    done = replan(client, "play", *files(tmp_path, motion, firmware="panda system 3.x"))
    assert done.returncode == 4
    (reason,) = [line for line in done.stderr.splitlines() if line.startswith("replan: ")]
    assert "for firmware 'panda system 3.x'" in reason
    write_trajectory(tmp_path / "motion.npz", replace(motion, segments=()))
    done = replan(client, "play", str(tmp_path / "motion.npz"), str(tmp_path / "certificate.json"))
    assert done.returncode == 4 and "not the one that was judged" in done.stderr


def test_a_certificate_that_is_none_is_a_usage_error(client: CellClient, tmp_path: Path):
    paths = files(tmp_path, from_here(client, 0.4, 0.02))
    Path(paths[1]).write_text("{}")
    done = replan(client, "play", *paths)
    assert done.returncode == 2 and "is no certificate: field 'serial'" in done.stderr


@pytest.mark.real_time
@pytest.mark.parametrize(
    ("number", "code", "told"),
    [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "SIGTERM"), (signal.SIGHUP, 129, "SIGHUP")],
)
def test_whoever_ends_the_command_has_the_arm_rest_on_the_path(
    client: CellClient, tmp_path: Path, number: signal.Signals, code: int, told: str
):
    motion = from_here(client, 40.0, 0.3)  # ended long before
    process = subprocess.Popen(
        command(client, "play", *files(tmp_path, motion)),
        stderr=subprocess.PIPE,
        text=True,
        # A script's shell starts background jobs so.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),
    )
    assert until(lambda: client.state().progress > 800 and client.state().mode == "moving")
    os.kill(process.pid, number)
    _, error = process.communicate()
    assert process.returncode == code and told in error and "Traceback" not in error
    state = client.state()
    assert state.mode == "stopped" and not any(state.qd)
    assert np.abs(motion.q - np.array(state.q_d)).max(axis=1).min() < 1e-3


@pytest.mark.real_time
def test_the_speed_is_changed_from_another_terminal_while_it_moves(client: CellClient):
    motion = from_here(client, 40.0, 0.3)  # ended as soon as the speed has changed
    lines: list[str] = []
    stopped: list[StoppedError] = []

    def run() -> None:
        with pytest.raises(StoppedError) as caught:
            play(motion, certificate(motion), client.endpoint, lines.append)
        stopped.append(caught.value)

    player = threading.Thread(target=run)
    player.start()
    assert until(lambda: client.state().mode == "moving")
    done = replan(client, "speed", "0.6", "--json")
    assert done.returncode == 0 and json.loads(done.stdout)["speed_wanted"] == 0.6
    assert until(lambda: client.state().speed == 0.6)
    assert client.state().mode == "moving"
    client.stop()
    player.join()
    assert stopped and "speed" in lines[0]


@pytest.mark.parametrize("speed", ["0", "1.5", "nan"])
def test_a_speed_that_was_not_judged_is_refused_in_one_line(client: CellClient, speed: str):
    done = replan(client, "speed", speed)
    assert done.returncode == 4 and "Traceback" not in done.stderr
    assert len([line for line in done.stderr.splitlines() if line.startswith("replan: ")]) == 1
    assert client.state().speed_wanted == 1.0
