"""Progress of long work at the terminal: a bar where there is a terminal, else a line every few seconds."""

import sys
import time
from collections.abc import Callable
from typing import Any

EVERY = 5.0  # [s] between lines where there is no terminal


class Progress:
    """Counts steps on stderr: which of how many, and how long the rest will take. A context manager.

    Args:
        what: What a step is, for instance "frame".
        total: How many there are; None where that is unknown.
        say: Gets a line every few seconds, where no bar is drawn.
        quiet: Draw no bar: lines are said even where there is a terminal.
    """

    def __init__(self, what: str, total: int | None, say: Callable[[str], None], quiet: bool = False) -> None:
        self._what, self._total, self._say, self._quiet = what, total, say, quiet
        self._done, self._started = 0, time.monotonic()
        self._said_at = float("-inf")
        self._bar: Any = None
        self._task: Any = None

    def __enter__(self) -> "Progress":
        if not self._quiet and sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
            from rich.progress import Progress as Bar

            columns = (TextColumn(self._what), BarColumn(), MofNCompleteColumn(), TextColumn("left"))
            note = TextColumn("{task.description}")
            self._bar = Bar(*columns, TimeRemainingColumn(), note, console=Console(stderr=True), transient=True)
            self._bar.start()
            self._task = self._bar.add_task("", total=self._total)
        return self

    def step(self, note: str) -> None:
        """One more is done.

        Args:
            note: What came of it.
        """
        self._done += 1
        if self._bar is not None:
            self._bar.update(self._task, completed=self._done, description=note)
            return
        now = time.monotonic()
        if now - self._said_at >= EVERY or self._done == self._total:
            self._said_at = now
            self._say(f"{self._what} {self._done}{self._of()}: {note}{self._left(now)}")

    def _of(self) -> str:
        return "" if self._total is None else f" of {self._total}"

    def _left(self, now: float) -> str:
        if self._total is None or self._done >= self._total:
            return ""
        seconds = (now - self._started) / self._done * (self._total - self._done)
        return f" ({seconds:.0f} s left)" if seconds < 120 else f" ({seconds / 60:.0f} min left)"

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()
