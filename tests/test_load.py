"""The load tool stalls and ends what it started, nothing else, and tells how the tests ended."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import LONG, TESTS
from tests.support.load.__main__ import ROOT
from tests.support.load.freezing import FOLDER, FROZEN, freeze, wake
from tests.support.load.processes import NotOursError, Process, descendants, process_table, send
from tests.support.load.stalls import LENGTH, Stalls
from tests.support.waiting import until

SLEEPER = [sys.executable, "-c", "import time\nprint(flush=True)\ntime.sleep(600)"]


@pytest.fixture
def sleeper():
    """A child that has started and would sleep for long."""
    with subprocess.Popen(SLEEPER, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stdout.readline()
        yield process
        process.kill()


def becomes(pid: int, letter: str) -> bool:
    """Whether a process comes into a state; a signal reaches its aim a little after it was sent."""
    return until(lambda: process_table()[pid].state == letter)


def test_a_child_is_stopped_and_woken(sleeper):
    send(sleeper.pid, signal.SIGSTOP)
    assert becomes(sleeper.pid, "T")
    send(sleeper.pid, signal.SIGCONT)
    assert becomes(sleeper.pid, "S")


def test_a_process_that_was_not_started_from_here_is_refused():
    with pytest.raises(NotOursError, match=f"process {os.getppid()} was not started from here"):
        send(os.getppid(), signal.SIGCONT)
    with pytest.raises(NotOursError, match="was not started from here"):
        send(os.getpid(), signal.SIGCONT)


def test_a_process_that_has_ended_is_refused(sleeper):
    sleeper.kill()
    sleeper.wait()
    with pytest.raises(NotOursError, match=f"process {sleeper.pid} has ended"):
        send(sleeper.pid, signal.SIGSTOP)


def test_descendants_are_the_living_ones_below():
    rows = [(1, 0, "S"), (2, 1, "S"), (3, 2, "T"), (4, 2, "Z"), (5, 3, "R"), (6, 1, "S")]
    table = {pid: Process(pid, parent, letter) for pid, parent, letter in rows}
    assert [process.pid for process in descendants([2], table)] == [3, 5]


def plan(seed: int, folder: Path, monkeypatch) -> list[tuple[float, int, signal.Signals]]:
    """Times, processes and signals of 40 s of stalls; of the processes, 7 is frozen by a test and 8 is stopped."""
    sent = []
    monkeypatch.setattr("tests.support.load.stalls.send", lambda pid, number: sent.append((now, pid, number)))
    living = [Process(pid, 1, "S") for pid in (5, 6, 7)] + [Process(8, 1, "T")]
    stalls, now = Stalls(seed, folder, 0.0), 0.0
    for now in np.arange(0.0, 40.0, 0.01):
        if stalls.due(now):
            stalls.step(now, living)
    stalls.wake()
    return sent


def test_stalls_follow_their_seed_and_leave_frozen_and_stopped_processes_alone(tmp_path, monkeypatch):
    (tmp_path / FROZEN).mkdir()
    (tmp_path / FROZEN / "7").touch()
    sent = plan(3, tmp_path, monkeypatch)
    assert sent == plan(3, tmp_path, monkeypatch) != plan(4, tmp_path, monkeypatch)
    assert {pid for _, pid, _ in sent} == {5, 6}
    for pid in (5, 6):
        times = [time for time, who, _ in sent if who == pid]
        assert [number for _, who, number in sent if who == pid] == [signal.SIGSTOP, signal.SIGCONT] * (len(times) // 2)
        lengths = np.subtract(times[1::2], times[::2])[:-1]  # the last one was cut short
        assert len(lengths) >= 5 and lengths.min() >= LENGTH[0] and lengths.max() < LENGTH[1] + 0.02


def test_what_a_test_freezes_meanwhile_is_not_woken_by_a_stalls_end(tmp_path, monkeypatch, sleeper):
    monkeypatch.setenv(FOLDER, str(tmp_path))
    (tmp_path / FROZEN).mkdir()
    stalls = Stalls(0, tmp_path, 0.0)
    stalls.step(1.0, [Process(sleeper.pid, os.getpid(), "S")])
    assert stalls.count == 1 and becomes(sleeper.pid, "T")
    freeze(sleeper.pid)
    stalls.wake()
    assert process_table()[sleeper.pid].state == "T"
    wake(sleeper.pid)
    assert becomes(sleeper.pid, "S") and not list((tmp_path / FROZEN).iterdir())


def load(tests: Path, *options: str) -> subprocess.Popen:
    """The tool with the tests of one file, without pytest's optional plugins."""
    command = [sys.executable, "-m", "tests.support.load", "--busy", "1", "--json", *options, "--", "-q", str(tests)]
    environment = {**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    return subprocess.Popen(
        command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def test_outcomes_stalls_and_what_was_left_over_are_told(tmp_path):
    (tmp_path / "test_one.py").write_text(f"""
import subprocess, time, pytest
CHILD = {SLEEPER!r}
def test_sound(): pass
def test_unsound(): assert False
def test_without_its_fixture(nothing): pass
@pytest.mark.skip
def test_left_out(): pass
def test_leaves_a_process():
    subprocess.Popen(CHILD, start_new_session=True)
    time.sleep(1.5)
""")
    process = load(tmp_path / "test_one.py", "--seed", "5")
    out, err = process.communicate()
    assert process.returncode == 1, err
    told = json.loads(out)
    (run,) = told["runs"]
    assert (told["busy"], told["seed"], run["stalls"] >= 1) == (1, 5, True)
    assert [run[kind] for kind in ("passed", "failed", "errors", "skipped")] == [2, 1, 1, 1]
    # Pytest names a file from the folder that it takes for the root, which depends on where the checkout lies.
    assert {name.rsplit("/", 1)[-1]: kind for name, kind in run["not_passed"].items()} == {
        "test_one.py::test_unsound": "failed",
        "test_one.py::test_without_its_fixture": "errors",
    }
    assert len(run["left_over"]) == 1 and "time.sleep(600)" in run["left_over"][0]


def test_an_interruption_leaves_nothing_running_and_nothing_stopped(tmp_path):
    (tmp_path / "test_one.py").write_text(f"""
import subprocess, sys
def test_endless():
    child = subprocess.Popen({SLEEPER!r}, start_new_session=True)
    open({str(tmp_path / "started")!r}, "w").write(str(child.pid))
    child.wait()
""")
    process = load(tmp_path / "test_one.py")
    assert until(lambda: (tmp_path / "started").exists())
    started = descendants([process.pid])
    assert len(started) >= 3  # pytest, its child, one that is busy
    process.send_signal(signal.SIGINT)
    _, err = process.communicate()
    assert process.returncode == 130, err
    assert not {one.pid for one in started} & set(process_table())


def test_files_that_start_first_exist():
    assert [name for name in LONG if not (TESTS / name).is_file()] == []
