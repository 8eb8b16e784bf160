"""A process that a test freezes on purpose, so that nobody else wakes it.

The load tool stops and wakes processes of the suite at random. It tells the suite its folder through the environment;
a process with a mark there belongs to the test that froze it.
"""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

FOLDER = "REPLAN_TESTS_LOAD"  # environment variable with the load tool's folder
FROZEN = "frozen"  # folder in it, with one file for each process that a test has frozen


def is_frozen(folder: Path, pid: int) -> bool:
    """Whether a test has frozen this process; the folder is the load tool's."""
    return (folder / FROZEN / str(pid)).exists()


def freeze(pid: int) -> None:
    """Stop a process until `wake`."""
    if folder := os.environ.get(FOLDER):
        (Path(folder) / FROZEN / str(pid)).touch()
    os.kill(pid, signal.SIGSTOP)


def wake(pid: int) -> None:
    """Let a frozen process go on; nothing happens if it has ended."""
    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGCONT)
    if folder := os.environ.get(FOLDER):
        (Path(folder) / FROZEN / str(pid)).unlink(missing_ok=True)


@contextmanager
def frozen(pid: int) -> Iterator[None]:
    """A process that stands still inside the block."""
    freeze(pid)
    try:
        yield
    finally:
        wake(pid)
