"""Where the seconds of a run go: every moment belongs to exactly one named part."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Literal, get_args

Part = Literal["perception", "planning", "search", "diagnosis", "retiming", "verdict", "moving"]
PARTS: tuple[Part, ...] = get_args(Part)


class Stopwatch:
    """Shares out wall time. What no other part claims is planning: the loop and whoever answers its questions.

    Args:
        clock: Seconds that only grow.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._running: list[Part] = ["planning"]
        self._since = clock()
        self._seconds: dict[Part, float] = dict.fromkeys(PARTS, 0.0)

    @contextmanager
    def part(self, name: Part) -> Iterator[None]:
        """Time spent inside belongs to this part, but for parts that begin and end within."""
        self._settle()
        self._running.append(name)
        try:
            yield
        finally:
            self._settle()
            self._running.pop()

    def _settle(self) -> None:
        now = self._clock()
        self._seconds[self._running[-1]] += now - self._since
        self._since = now

    @property
    def seconds(self) -> dict[Part, float]:
        """Wall time by part so far, in [s]; their sum is the time since the stopwatch was made."""
        self._settle()
        return dict(self._seconds)
