"""Pytest plugin of the load tool: which processes run tests, and how the tests ended."""

import json
import os
from collections import Counter
from pathlib import Path

import pytest

from tests.support.load.freezing import FOLDER

WORKERS = "workers"  # folder with one file for each process that runs tests, named by its identifier
RESULTS = "results.json"


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
        (folder / WORKERS / str(os.getpid())).touch()
    if not is_worker:
        config.pluginmanager.register(Results(folder / RESULTS))
