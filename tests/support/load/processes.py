"""Processes below this one: who they are, signals that cannot hit a stranger, and their end.

Linux only. A process identifier can be used again for another process, so every signal goes through a process file
descriptor that was checked, after it had been opened, to belong to a descendant of this process.
"""

import ctypes
import os
import signal
import time
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

PR_SET_CHILD_SUBREAPER = 36  # linux/prctl.h


class NotOursError(Exception):
    """A process that this one did not start, or that has ended."""


@dataclass(frozen=True)
class Process:
    """One line of the process table.

    Attributes:
        pid: Its identifier.
        parent: Its parent's identifier.
        state: The kernel's letter: R, S, D, T (stopped), Z (ended, not yet reaped).
    """

    pid: int
    parent: int
    state: str

    @property
    def command(self) -> str:
        """Its command line, or "" if it has ended."""
        try:
            return Path(f"/proc/{self.pid}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace").strip()
        except OSError:
            return ""


def adopt_orphans() -> None:
    """Let processes whose parent ends become children of this one instead of the machine's first process."""
    if ctypes.CDLL(None, use_errno=True).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0):
        raise OSError(ctypes.get_errno(), "this kernel lets no process adopt orphans")


def process_table() -> dict[int, Process]:
    """All processes of the machine by identifier."""
    table = {}
    for entry in os.listdir("/proc"):
        if entry.isdigit():
            with suppress(OSError):  # ended meanwhile
                # The name, in brackets, may itself hold blanks and brackets.
                state, parent = Path(f"/proc/{entry}/stat").read_text().rpartition(")")[2].split()[:2]
                table[int(entry)] = Process(int(entry), int(parent), state)
    return table


def descendants(roots: Iterable[int], table: dict[int, Process] | None = None) -> list[Process]:
    """Running or stopped processes below some processes, these not included; parents before their children."""
    table = process_table() if table is None else table
    children: dict[int, list[Process]] = {}
    for process in table.values():
        children.setdefault(process.parent, []).append(process)
    found: dict[int, Process] = {}
    front = list(roots)
    while front:
        below = [child for pid in front for child in children.get(pid, ()) if child.pid not in found]
        found |= {child.pid: child for child in below}
        front = [child.pid for child in below]
    return [process for process in found.values() if process.state not in "ZX"]


def send(pid: int, number: signal.Signals) -> None:
    """Send a signal to a descendant of this process.

    Raises:
        NotOursError: The process has ended, or is no descendant. Nothing was sent.
    """
    try:
        handle = os.pidfd_open(pid)
    except OSError as error:
        raise NotOursError(f"process {pid} has ended or cannot be reached: {error}") from error
    try:
        if pid not in {process.pid for process in descendants([os.getpid()])}:
            raise NotOursError(f"process {pid} was not started from here; only processes below {os.getpid()} are")
        signal.pidfd_send_signal(handle, number)
    except ProcessLookupError as error:
        raise NotOursError(f"process {pid} has ended") from error
    finally:
        os.close(handle)


def reap_orphans(known: Iterable[int]) -> None:
    """Collect ended children that were adopted; the known ones are left to their own `Popen`."""
    for process in process_table().values():
        if process.state == "Z" and process.parent == os.getpid() and process.pid not in known:
            with suppress(ChildProcessError):
                os.waitpid(process.pid, os.WNOHANG)


def end_all(roots: Iterable[int], known: Iterable[int], grace: float = 1.0, patience: float = 3.0) -> list[str]:
    """End every process below some processes: asked first, killed after a while.

    Args:
        roots: Processes whose descendants end; they themselves do not.
        known: Children that have a `Popen` of their own, see `reap_orphans`.
        grace: Time in which they may end by themselves before they are asked, in [s].
        patience: Time from the request to the kill, in [s].

    Returns:
        Command lines of the processes that had to be ended.
    """
    roots, known = list(roots), set(known)
    ended: dict[int, str] = {}
    began = time.monotonic()
    while left := descendants(roots):
        kill = time.monotonic() - began > grace + patience
        for process in left if time.monotonic() - began > grace else []:
            if kill or process.pid not in ended:
                ended[process.pid] = process.command
                with suppress(NotOursError):
                    send(process.pid, signal.SIGKILL if kill else signal.SIGTERM)
                    send(process.pid, signal.SIGCONT)
        reap_orphans(known)
        time.sleep(0.02)
    reap_orphans(known)
    return list(ended.values())
