"""Time in which this process itself ran: a process that stood still has waited for nobody meanwhile.

A wall clock goes on while a process is suspended or not scheduled. Whatever was said to it in that time is still on its
way through its own threads when it runs again, so silence counts only from look to look of a process that runs.
"""

import time
from collections.abc import Callable

LOOK = 0.1  # [s] between two looks that count in full; who waits looks more often


class OwnTime:
    """A stopwatch that each look advances by the time since the look before, and by `longest` at most.

    Args:
        clock: Monotonic clock in [s].
        longest: Most that counts between two looks in [s].

    Attributes:
        counted: Time so far in [s].
        stood_still: Time in [s] that did not count.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic, longest: float = 2 * LOOK) -> None:
        self._clock, self._longest = clock, longest
        self._mark = clock()
        self.counted = self.stood_still = 0.0

    def look(self) -> float:
        """Count the time since the last look; returns what was counted so far in [s]."""
        now = self._clock()
        passed, self._mark = now - self._mark, now
        counts = min(passed, self._longest)
        self.counted += counts
        self.stood_still += passed - counts
        return self.counted

    def restart(self) -> None:
        """Begin at zero again."""
        self._mark = self._clock()
        self.counted = self.stood_still = 0.0
