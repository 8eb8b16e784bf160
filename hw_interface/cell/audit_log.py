"""The audit log of a robot side: who asked for what, and what the robot did. Append-only, one JSON object a line.

    {"number": 17, "time": 1790000000.123, "event": "accepted", ..., "crc": 1234567890}

Every line is written by one call to the operating system and carries a check sum over what stands before it, so a
process that is killed at any moment leaves at most one incomplete last line, which a reader names and leaves out. Lines
of motions are also forced to the disk.
"""

import json
import os
import time
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from control.errors import ConfigError, MachineError


class AuditLog:
    """An open audit log.

    Args:
        path: File to append to; made with its folders where it is not there.
        clock: Wall clock in [s].

    Raises:
        MachineError: It cannot be written.
    """

    def __init__(self, path: Path, clock: Callable[[], float] = time.time) -> None:
        self.path, self._clock = path, clock
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._number = _last_number(path)
            self._file = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
            if not _ends_a_line(path):
                os.write(self._file, b"\n")  # what a killed writer left incomplete stays a line of its own
        except OSError as error:
            raise MachineError(
                f"the audit log '{path}' cannot be written ({error.strerror}); free or name another place: "
                "--audit-log FILE"
            ) from error

    def record(self, event: str, force: bool = False, **fields: Any) -> None:
        """Append a line.

        Args:
            event: What happened.
            force: Return only when it is on the disk.
            fields: JSON values.

        Raises:
            MachineError: It cannot be written, for instance because the disk is full.
        """
        self._number += 1
        body = {"number": self._number, "time": round(self._clock(), 6), "event": event, **fields}
        text = json.dumps(body, ensure_ascii=False, separators=(",", ":"))[:-1]
        line = f'{text},"crc":{zlib.crc32(text.encode())}}}\n'.encode()
        try:
            written = os.write(self._file, line)
            if written < len(line):
                raise OSError(28, "No space left on device")
            if force:
                os.fdatasync(self._file)
        except OSError as error:
            raise MachineError(
                f"the audit log '{self.path}' cannot be written ({error.strerror}); nothing moves without it: make "
                "room, then acknowledge"
            ) from error

    def close(self) -> None:
        """Close the file."""
        os.close(self._file)


@dataclass(frozen=True)
class DamagedLine:
    """A line of an audit log that is not whole.

    Attributes:
        line: Its number in the file, from 1.
        last: Whether it is the last one: a writer was killed there.
    """

    line: int
    last: bool


def read_audit_log(path: Path) -> Iterator[dict[str, Any] | DamagedLine]:
    """Its lines in order; those that are incomplete or were changed as `DamagedLine`.

    Raises:
        ConfigError: The file cannot be read.
    """
    try:
        lines = path.read_bytes().split(b"\n")
    except OSError as error:
        raise ConfigError(f"the audit log '{path}' cannot be read ({error.strerror})") from error
    if lines and not lines[-1]:
        lines.pop()
    for k, line in enumerate(lines):
        body = _checked(line)
        yield DamagedLine(k + 1, k + 1 == len(lines)) if body is None else body


def _checked(line: bytes) -> dict[str, Any] | None:
    head, separator, tail = line.rpartition(b',"crc":')
    if not separator or not tail.endswith(b"}") or not tail[:-1].isdigit() or int(tail[:-1]) != zlib.crc32(head):
        return None
    try:
        body = json.loads(line)
    except ValueError:
        return None
    return body if isinstance(body, dict) else None


def _last_number(path: Path) -> int:
    if not path.is_file():
        return 0
    numbers = [line["number"] for line in read_audit_log(path) if isinstance(line, dict)]
    return max((n for n in numbers if isinstance(n, int)), default=0)


def _ends_a_line(path: Path) -> bool:
    size = path.stat().st_size if path.is_file() else 0
    if size == 0:
        return True
    with path.open("rb") as file:
        file.seek(size - 1)
        return file.read(1) == b"\n"
