"""objects.json while it grows: after every frame the file on disk is whole and valid, however the program ends."""

import json
import os
from pathlib import Path
from typing import Any

from control.errors import ConfigError
from perception.scene_file import LookRecord, SkippedRecord


class ResultFile:
    """Writes a `perception.scene_file.PerceptionResult` record by record; a context manager.

    Each record and the end of the file behind it go out in one write, over the end that stood there before.

    Args:
        path: Where to.
        source: Which detector and segmenter.
        out: Folder of the pictures.

    Raises:
        ConfigError: The file cannot be written.
    """

    def __init__(self, path: Path, source: str, out: Path) -> None:
        self.path = path
        self._skipped: list[SkippedRecord] = []
        self._count = 0
        head = f'{{"source": {json.dumps(source)}, "out": {json.dumps(str(out))}, "frames": ['
        try:
            self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
        except OSError as error:
            raise ConfigError(f"cannot write {path}: {error.strerror}; choose another folder with --out") from error
        self._end = 0  # offset of the end's first byte
        self._write(head, finished=False, metrics=None)

    def add(self, record: LookRecord) -> None:
        """One frame more."""
        text = json.dumps(record.model_dump(mode="json"))
        self._write(("," if self._count else "") + "\n" + text, finished=False, metrics=None)
        self._count += 1

    def skip(self, where: str, reason: str) -> None:
        """One part of the recording more that could not be used."""
        self._skipped.append(SkippedRecord(where=where, reason=reason))
        self._write("", finished=False, metrics=None)

    def finish(self, finished: bool, metrics: dict[str, Any] | None) -> None:
        """Write the end for good.

        Args:
            finished: Whether the recording was read to its end.
            metrics: Measured against the truth.
        """
        self._write("", finished, metrics)

    def _write(self, text: str, finished: bool, metrics: dict[str, Any] | None) -> None:
        rest = {"skipped": [s.model_dump() for s in self._skipped], "finished": finished, "metrics": metrics}
        end = "\n], " + json.dumps(rest)[1:] + "\n"
        data, body = (text + end).encode(), text.encode()
        # Blanks over what is left of a longer end; JSON allows them.
        left = os.fstat(self._file).st_size - self._end - len(data)
        os.pwrite(self._file, data + b" " * max(0, left), self._end)
        self._end += len(body)

    def __enter__(self) -> "ResultFile":
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._file)
