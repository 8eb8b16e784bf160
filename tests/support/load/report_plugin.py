"""Pytest plugin of the load tool: which processes run tests, and how the tests ended."""

import json
import os
import time
from collections import Counter
from collections.abc import Generator
from pathlib import Path

import pytest

from tests.support.load.freezing import FOLDER
from tests.support.load.stalls import LENGTH

WORKERS = "workers"  # folder with one file for each process that runs tests, named by its identifier
RESULTS = "results.json"
REAL_TIME = "real_time"  # marker of tests, and what a worker's file says while it runs one


class RealTime:
    """Says while a test of a robot in real time runs: its time does not wait, so a stall rightly ends its motions."""

    def __init__(self, file: Path) -> None:
        self._file = file

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        """Have no stall begin during such a test, and wait for the end of one that has begun."""
        marked = item.get_closest_marker(REAL_TIME) is not None
        if marked and not self._file.read_text():
            self._file.write_text(REAL_TIME)
            time.sleep(LENGTH[1])
        elif not marked:
            self._file.write_text("")
        return (yield)


class Results:
    """Outcomes of the tests, written down when the session ends."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._counts: Counter[str] = Counter()
        self._not_passed: dict[str, str] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Count one phase of a test: setting up and clearing up count when they fail or skip."""
        if report.failed:
            kind = "failed" if report.when == "call" else "errors"
            self._not_passed[report.nodeid] = kind
        elif report.skipped:
            kind = "skipped"
        elif report.when == "call":
            kind = "passed"
        else:
            return
        self._counts[kind] += 1

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Count a file that could not be read as an error."""
        if report.failed and report.nodeid not in self._not_passed:
            self._not_passed[report.nodeid] = "errors"
            self._counts["errors"] += 1

    def pytest_sessionfinish(self) -> None:
        """Write the figures."""
        counts = {kind: self._counts[kind] for kind in ("passed", "failed", "errors", "skipped")}
        self._file.write_text(json.dumps(counts | {"not_passed": self._not_passed}))


def pytest_configure(config: pytest.Config) -> None:
    """Say that this process runs tests, or count the results of those that do."""
    folder = Path(os.environ[FOLDER])
    is_worker = hasattr(config, "workerinput")
    if is_worker or not config.getoption("numprocesses", None):
        own = folder / WORKERS / str(os.getpid())
        own.touch()
        config.pluginmanager.register(RealTime(own))
    if not is_worker:
        config.pluginmanager.register(Results(folder / RESULTS))
