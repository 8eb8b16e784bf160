"""The record of one run: a folder with an append-only event log and every picture.

events.jsonl holds one JSON object a line: `event`, `time` (seconds since the run began), `wall` (UNIX time) and the
event's own fields. Every line is flushed as it is written, so that a killed run leaves a complete record.
"""

import dataclasses
import datetime
import math
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import structlog
from pydantic import BaseModel

from control.errors import ConfigError


def plain(value: Any) -> Any:
    """The value as JSON knows it: dataclasses as objects, arrays as lists, large arrays as their shape.

    Numbers that JSON has no words for (NaN, infinities) become strings.
    """
    if isinstance(value, BaseModel):
        return plain(value.model_dump())
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, np.ndarray):
        if value.size > 64:
            return f"array{value.shape} of {value.dtype}"
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [plain(v) for v in value]
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    return str(value)


class Episode:
    """A run's folder and event log.

    Args:
        folder: Made when absent; must be empty or new.

    Attributes:
        folder: The folder.
        on_event: Called with each event's name and fields, for other records; None for nobody.

    Raises:
        ConfigError: The folder cannot be made or written to.
    """

    def __init__(self, folder: Path) -> None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._file = (folder / "events.jsonl").open("a", encoding="utf-8")
        except OSError as error:
            raise ConfigError(f"cannot write the run's folder {folder}: {error.strerror}; choose --runs-dir") from error
        self.folder = folder
        self.on_event: Callable[[str, dict[str, Any]], None] | None = None
        self._start = time.monotonic()
        self._logger = structlog.wrap_logger(
            structlog.WriteLogger(self._file), processors=[structlog.processors.JSONRenderer(sort_keys=False)]
        )
        self._counters: dict[str, int] = {}

    @classmethod
    def create(cls, runs_dir: Path, label: str) -> "Episode":
        """A new folder in `runs_dir`, named by date, time and label."""
        stamp = datetime.datetime.now().strftime("%Y-%m-%d_%H-%M-%S")
        slug = "-".join("".join(c if c.isalnum() else " " for c in label.lower()).split())[:48] or "run"
        folder, k = runs_dir / f"{stamp}_{slug}", 1
        while folder.exists():
            k += 1
            folder = runs_dir / f"{stamp}_{slug}_{k}"
        return cls(folder)

    def log(self, event: str, **data: Any) -> None:
        """Append one event; values may be dataclasses, arrays or anything that `plain` knows."""
        fields = {k: plain(v) for k, v in data.items()}
        stamps = {"time": round(time.monotonic() - self._start, 3), "wall": round(time.time(), 3)}
        self._logger.msg(event, **stamps, **fields)
        self._file.flush()
        if self.on_event is not None:
            self.on_event(event, fields)

    def numbered(self, stem: str, suffix: str) -> Path:
        """A new path in the folder: stem_001.suffix, stem_002.suffix, ..."""
        self._counters[stem] = self._counters.get(stem, 0) + 1
        return self.folder / f"{stem}_{self._counters[stem]:03d}.{suffix}"

    def keep(self, name: str, text: str) -> None:
        """Write a text file of this name into the folder."""
        (self.folder / name).write_text(text, encoding="utf-8")

    def close(self) -> None:
        """Close the log."""
        self._file.close()
