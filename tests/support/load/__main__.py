"""Run the suite beside busy processes and random stalls of its own processes, and print how many tests failed.

    python -m tests.support.load                        the whole suite, as `make test` runs it
    python -m tests.support.load --runs 2 --json        twice, one JSON object on stdout, the tests' output on stderr
    python -m tests.support.load --busy 4 --seed 3 tests/replan -k ctrl_c

Arguments from the first that is not an option of this command go to pytest; `--` comes before options of pytest.
Stalled are the processes that tests start: robot processes, cells, clients. The processes that run the tests are not,
unless `--stall-workers` asks for it. Nor are simulated control boxes: a real one is a computer of its own that keeps
its milliseconds, and libfranka gives up on one that is silent for a second. Nor are processes of tests that are marked
`real_time` while these run: the time of a real robot does not wait, so a stall rightly ends its motion at rest.
Whatever was started here is ended here, also after Ctrl-C, SIGTERM or SIGHUP.
Exit code: 0 if every test of every run passed, 1 if not, 130 when interrupted.
"""

import argparse
import json
import os
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from tests.support.load.freezing import FOLDER, FROZEN
from tests.support.load.processes import (
    NotOursError,
    Process,
    adopt_orphans,
    descendants,
    end_all,
    process_table,
    reap_orphans,
)
from tests.support.load.report_plugin import REAL_TIME, RESULTS, WORKERS
from tests.support.load.stalls import Stalls

ROOT = Path(__file__).resolve().parents[3]
SUITE = ["-n", "2", "--dist", "loadfile", "--no-loadscope-reorder", "tests"]
SPARED = ("research-interface", "research_interface", "control_box_process")  # in the command line of a control box
TICK = 0.02  # between two looks at the processes, in [s]
PATIENCE = 30.0  # for pytest to end after an interruption, in [s]
# Ends by itself with its parent, should that be killed.
BUSY = "import os\nwhile os.getppid() == {parent}:\n    sum(range(100_000))"


@dataclass(frozen=True)
class Figures:
    """What one run of the suite came to.

    Attributes:
        passed, failed, errors, skipped: Tests by how they ended; an error is a failure outside a test's own body.
        seconds: How long the run took.
        stalls: How often processes were stopped.
        exit_code: Pytest's.
        not_passed: Names of the tests that failed, with "failed" or "errors".
        left_over: Command lines of processes that the tests had started and not ended.
    """

    passed: int
    failed: int
    errors: int
    skipped: int
    seconds: float
    stalls: int
    exit_code: int
    not_passed: dict[str, str]
    left_over: list[str]

    @property
    def sound(self) -> bool:
        """Whether every test passed."""
        return self.exit_code == 0 and self.failed == self.errors == 0


class Interruption:
    """Signals that end the tool: noted once, so that everything can be ended in order."""

    def __init__(self) -> None:
        self.count = 0
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, self._note)

    def _note(self, *_: object) -> None:
        self.count += 1


def stallable(folder: Path, workers_too: bool) -> list[Process]:
    """Living processes that tests have started, and the ones that run the tests if asked for.

    Simulated control boxes and the processes of a test in real time are left out.
    """
    table = process_table()
    workers = {int(file.name) for file in (folder / WORKERS).iterdir() if file.read_text() != REAL_TIME}
    ours = {process.pid: process for process in descendants([os.getpid()], table)}
    below = descendants(workers & set(ours), table)
    started = [process for process in below if not any(part in process.command for part in SPARED)]
    return started + [ours[pid] for pid in sorted(workers & set(ours)) if workers_too]


def run_suite(arguments: Sequence[str], options: argparse.Namespace, seed: int, interruption: Interruption) -> Figures:
    """One run of pytest under load."""
    with tempfile.TemporaryDirectory(prefix="replan-load-") as name:
        folder = Path(name)
        for part in (FROZEN, WORKERS):
            (folder / part).mkdir()
        command = [sys.executable, "-m", "pytest", "-p", "tests.support.load.report_plugin", *arguments]
        began = time.monotonic()
        # In a session of its own: a Ctrl-C at the terminal reaches this process alone, which then ends the others.
        suite = subprocess.Popen(
            command,
            cwd=ROOT,
            env={"OMP_NUM_THREADS": "1", **os.environ, FOLDER: name},
            stdout=sys.stderr if options.json else None,
            start_new_session=True,
        )
        busy: list[subprocess.Popen] = []
        stalls = Stalls(seed, folder, began)
        try:
            for _ in range(options.busy):
                busy.append(subprocess.Popen([sys.executable, "-c", BUSY.format(parent=os.getpid())]))
            told_at = None
            while suite.poll() is None:
                now = time.monotonic()
                if interruption.count and told_at is None:
                    told_at = now
                    stalls.wake()
                    suite.send_signal(signal.SIGINT)
                elif told_at is not None and (now - told_at > PATIENCE or interruption.count > 1):
                    break
                elif told_at is None and options.stalls and stalls.due(now):
                    stalls.step(now, stallable(folder, options.stall_workers))
                reap_orphans({suite.pid, *(process.pid for process in busy)})
                time.sleep(TICK)
        finally:
            stalls.wake()
            with suppress(NotOursError):
                for process in busy:
                    process.kill()
                    process.wait()
            seconds = time.monotonic() - began
            left_over = end_all([os.getpid()], {suite.pid})
            code = suite.wait()
        results = {"passed": 0, "failed": 0, "errors": 0, "skipped": 0, "not_passed": {}}
        if (folder / RESULTS).exists():
            results = json.loads((folder / RESULTS).read_text())
    return Figures(**results, seconds=round(seconds, 1), stalls=stalls.count, exit_code=code, left_over=left_over)


def printed(figures: Figures) -> str:
    """The figures of a run as lines of text."""
    lines = [f"{figures.not_passed[name]}: {name}" for name in sorted(figures.not_passed)]
    lines += [f"left over: {command}" for command in figures.left_over]
    lines.append(
        f"{figures.passed} passed, {figures.failed} failed, {figures.errors} errors, {figures.skipped} skipped, "
        f"{figures.stalls} stalls, {figures.seconds} s"
    )
    return "\n".join(lines)


def main(given: Sequence[str] | None = None) -> int:
    """Parse the command line, run the suite as often as asked and print the figures."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.support.load", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--busy", type=int, default=8, help="processes that only use a core (8)")
    parser.add_argument(
        "--stalls", action=argparse.BooleanOptionalAction, default=True, help="stop processes at random"
    )
    parser.add_argument("--stall-workers", action="store_true", help="stop the processes that run the tests, too")
    parser.add_argument("--seed", type=int, default=0, help="of the stalls; each further run adds 1 (0)")
    parser.add_argument("--runs", type=int, default=1, help="how often the suite runs (1)")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    parser.add_argument("pytest", nargs=argparse.REMAINDER, help=f"arguments of pytest ({shlex.join(SUITE)})")
    options = parser.parse_args(given)
    arguments = options.pytest[1:] if options.pytest[:1] == ["--"] else options.pytest
    adopt_orphans()
    interruption = Interruption()
    runs: list[Figures] = []
    while len(runs) < options.runs and not interruption.count:
        runs.append(run_suite(arguments or SUITE, options, options.seed + len(runs), interruption))
        print(printed(runs[-1]), file=sys.stderr if options.json else sys.stdout, flush=True)
    if options.json:
        setting = {name: getattr(options, name) for name in ("busy", "stalls", "stall_workers", "seed")}
        print(json.dumps({**setting, "runs": [asdict(run) for run in runs]}))
    if interruption.count:
        return 130
    return 0 if all(run.sound for run in runs) else 1


if __name__ == "__main__":
    sys.exit(main())
