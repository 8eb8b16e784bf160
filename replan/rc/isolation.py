"""A program in a process of its own, with a time limit, that leaves nothing running whatever happens to it."""

import os
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

LOOK_EVERY = 1.0  # [s] between looks at which processes it has started
KEPT = 4000  # characters of what it wrote to stderr


class Interrupted(Exception):
    """The program was ended because its runner was told to stop."""


@dataclass(frozen=True)
class Outcome:
    """How a program ended.

    Attributes:
        ended: `done` with exit code 0, `crashed` with any other or by a signal, `timed_out` and was killed.
        out: All of stdout.
        errors: The end of stderr.
        code: Exit code; negative for a signal.
        seconds: Wall time in [s].
    """

    ended: Literal["done", "timed_out", "crashed"]
    out: str
    errors: str
    code: int
    seconds: float


def run_isolated(
    command: Sequence[str],
    given: str,
    limit_s: float,
    stop: threading.Event | None = None,
    environment: Mapping[str, str] | None = None,
) -> Outcome:
    """Run a program to its end.

    Args:
        command: Program and arguments.
        given: Its stdin.
        limit_s: Longest wall time in [s]; then it is killed.
        stop: Kill it when this is set.
        environment: Of the program; this process's own if None.

    Raises:
        Interrupted: `stop` was set.
        OSError: The program cannot be started.
    """
    started = time.monotonic()
    with tempfile.TemporaryFile() as stdin, tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as errors:
        stdin.write(given.encode())
        stdin.seek(0)
        # A session of its own, so that Ctrl-C at the terminal reaches only the runner, which then ends it.
        process = subprocess.Popen(
            command, stdin=stdin, stdout=out, stderr=errors, start_new_session=True, env=environment
        )
        family: dict[int, str] = {}
        timed_out = False
        try:
            while process.poll() is None:
                family |= _descendants(process.pid)
                if stop is not None and stop.is_set():
                    raise Interrupted(f"'{command[0]}' was ended because the run was interrupted")
                left = limit_s - (time.monotonic() - started)
                if left <= 0:
                    timed_out = True
                    break
                try:
                    process.wait(min(LOOK_EVERY, left))
                except subprocess.TimeoutExpired:
                    continue
        finally:
            family |= _descendants(process.pid)
            if process.poll() is None:
                process.kill()
            process.wait()
            _end_all(family)
        code = process.returncode
        ended = "timed_out" if timed_out else "done" if code == 0 else "crashed"
        for file in (out, errors):
            file.seek(0)
        tail = errors.read().decode(errors="replace")[-KEPT:]
        return Outcome(ended, out.read().decode(errors="replace"), tail, code, time.monotonic() - started)


def _descendants(root: int) -> dict[int, str]:
    """Processes that a process started, directly or not, each with the time at which it began."""
    parents: dict[int, tuple[int, str]] = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            # The second field, the name in parentheses, may contain spaces; then state and parent, and 20th the start.
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:  # it ended while we looked
            continue
        parents[int(stat.parent.name)] = (int(fields[1]), fields[19])
    found: dict[int, str] = {}
    grown = {root}
    while grown:
        grown = {pid for pid, (parent, _) in parents.items() if parent in grown and pid not in found}
        found |= {pid: parents[pid][1] for pid in grown}
    return found


def _end_all(family: Mapping[int, str]) -> None:
    """Kill those that still run; one that has another start time is another process with a used number."""
    for pid, began in family.items():
        try:
            fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
            if fields[19] == began:
                os.kill(pid, signal.SIGKILL)
        except (OSError, IndexError):
            continue
