"""What holds for the whole suite."""

import signal
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
# Files of whole runs and of robots in real time, the longest first. They start first, so that the processes which share
# the suite end together; a file that is not listed starts where its name says.
LONG = (
    "replan/test_whole_runs.py",
    "benchmarks/test_faults.py",
    "perception/known_shapes/test_known_models.py",
    "hw_interface/panda/test_driver.py",
    "hw_interface/cell/test_stalls.py",
    "replan/test_command_line.py",
    "control/planners/test_several_terms.py",
    "replan/test_api.py",
    "benchmarks/test_verdicts.py",
    "planning/baselines/test_pddl.py",
    "replan/test_robotiq_motions.py",
    "replan/test_play.py",
)


def pytest_configure() -> None:
    """Tests send signals to themselves and to their children, also where a shell or `nohup` has them ignored."""
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if signal.getsignal(signal.SIGHUP) == signal.SIG_IGN:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Long files start first, each as a whole."""
    place = {TESTS / name: i for i, name in enumerate(LONG)}
    items.sort(key=lambda item: place.get(item.path, len(LONG)))
