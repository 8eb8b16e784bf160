"""Starting a simulated cell as a child process, and ending it."""

import json
import os
import select
import signal
import subprocess
import tempfile
import time
from collections.abc import Sequence
from types import TracebackType
from typing import IO

from control.errors import MachineError, RobotGoneError

END_TIMEOUT = 5.0  # [s] between asking a process to end and killing it


class SimProcess:
    """A running simulated cell.

    Attributes:
        endpoint: Where it listens.
        pid: Its process id.
        epoch: Identity of this run.
        ready: All that its ready line said.
    """

    def __init__(self, process: "subprocess.Popen[str]", errors: IO[bytes], ready: dict[str, object]) -> None:
        self._process = process
        self._errors = errors
        self.endpoint = str(ready["endpoint"])
        self.pid = process.pid
        self.epoch = str(ready["epoch"])
        self.ready = ready

    def __enter__(self) -> "SimProcess":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def running(self) -> bool:
        """Whether the process has not ended."""
        return self._process.poll() is None

    def errors(self, characters: int = 4000) -> str:
        """The end of what the process wrote to stderr."""
        return _tail(self._errors, characters)

    def close(self) -> None:
        """Ask the process to end, kill it if it does not; never raises because it has ended already."""
        _end(self._process)
        self._errors.close()


def start_sim_process(command: Sequence[str], deadline: float = 60.0) -> SimProcess:
    """Start a simulated cell and wait until it is ready.

    It runs in a session of its own, so that Ctrl-C in a terminal reaches only the client, which then brings the arm
    to rest. It is told this process's id, so that it ends when this process is killed.

    Args:
        command: Program and arguments; `--parent-pid PID` is added to them. It must print the ready line of
            `hw_interface.cell.pacing.announce` on stdout.
        deadline: Longest wait for that line in [s].

    Raises:
        ConfigError: The program cannot be started, or ended before it was ready (with the end of its stderr).
        RobotGoneError: It was not ready in time; it has been ended.
    """
    errors = tempfile.TemporaryFile()  # noqa: SIM115 (kept open as long as the process runs)
    try:
        process = subprocess.Popen(
            [*command, "--parent-pid", str(os.getpid())],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
            start_new_session=True,
        )
    except OSError as error:
        errors.close()
        raise MachineError(f"cannot start the simulated cell '{command[0]}': {error}") from error
    try:
        ready = _wait_ready(process, errors, deadline)
        return SimProcess(process, errors, ready)
    except BaseException:
        _end(process)
        errors.close()
        raise


def _wait_ready(process: "subprocess.Popen[str]", errors: IO[bytes], deadline: float) -> dict[str, object]:
    assert process.stdout is not None
    until = time.monotonic() + deadline
    # Read bytes as they come: a buffered readline would block beyond the deadline on half a line.
    descriptor, received = process.stdout.fileno(), b""
    while (left := until - time.monotonic()) > 0:
        readable, _, _ = select.select([descriptor], [], [], min(left, 0.2))
        if not readable:
            continue
        chunk = os.read(descriptor, 65536)
        if not chunk:
            code = process.wait(END_TIMEOUT)
            why = _tail(errors, 2000)
            raise MachineError(f"the simulated cell ended before it was ready (exit code {code}): {why}")
        received += chunk
        for line in received.split(b"\n")[:-1]:
            try:
                ready = json.loads(line)
            except ValueError:
                continue
            if isinstance(ready, dict) and ready.get("ready") is True and {"endpoint", "epoch"} <= ready.keys():
                return ready
    raise RobotGoneError(
        f"the simulated cell was not ready within {deadline:g} s and has been ended: {_tail(errors, 2000)}"
    )


def _tail(errors: IO[bytes], characters: int) -> str:
    # The child writes at the same file offset, so it must not be moved.
    start = max(0, os.fstat(errors.fileno()).st_size - characters)
    return os.pread(errors.fileno(), characters, start).decode(errors="replace").strip() or "no message"


def _end(process: "subprocess.Popen[str]") -> None:
    if process.poll() is None:
        process.send_signal(signal.SIGTERM)
        process.send_signal(signal.SIGCONT)  # a suspended process could not end
        try:
            process.wait(END_TIMEOUT)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
    if process.stdout is not None:
        process.stdout.close()
