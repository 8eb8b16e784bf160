"""Stalls: processes of the suite stop for a while, again and again, as on a machine that does not schedule them.

The plan is drawn from a seed: pauses, lengths and which share of the living processes is hit. Which processes live at
that time depends on the machine, so two runs with one seed resemble each other but are not the same.
"""

import random
import signal
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from tests.support.load.freezing import is_frozen
from tests.support.load.processes import NotOursError, Process, send

LENGTH = (0.3, 1.5)  # of a stall, in [s]
PAUSE = (0.2, 1.0)  # from the end of a stall to the next, in [s]
ALL_AT_ONCE = 0.25  # share of the stalls that hit every process, as a machine that stands still does


class Stalls:
    """Stops and wakes processes of the suite by a drawn plan.

    Attributes:
        count: Stalls so far; one that hit several processes at once counts once.
    """

    def __init__(self, seed: int, folder: Path, now: float) -> None:
        """Plan the first stall.

        Args:
            seed: Of the plan.
            folder: The load tool's, with the marks of processes that tests have frozen themselves, see `freezing`.
            now: The clock's time, in [s]; later times come from the same clock.
        """
        self._random = random.Random(seed)
        self._folder = folder
        self._stopped: list[int] = []
        self._next = now + self._random.uniform(*PAUSE)
        self.count = 0

    def due(self, now: float) -> bool:
        """Whether a stall begins or ends now."""
        return now >= self._next

    def step(self, now: float, living: Sequence[Process]) -> None:
        """End the present stall or begin the next one.

        Args:
            now: The clock's time, in [s].
            living: Processes that may be stalled; the ones that are stopped already are left alone.
        """
        if self._stopped:
            self.wake()
            self._next = now + self._random.uniform(*PAUSE)
            return
        length, share = self._random.uniform(*LENGTH), self._random.random()
        able = [process.pid for process in living if process.state != "T" and not is_frozen(self._folder, process.pid)]
        chosen = able if share < ALL_AT_ONCE or not able else [self._random.choice(able)]
        for pid in chosen:
            with suppress(NotOursError):  # ended meanwhile
                send(pid, signal.SIGSTOP)
                self._stopped.append(pid)
        self.count += bool(self._stopped)
        self._next = now + (length if self._stopped else PAUSE[0])

    def wake(self) -> None:
        """Let the stalled processes go on, but for those that a test froze meanwhile."""
        for pid in self._stopped:
            if not is_frozen(self._folder, pid):
                with suppress(NotOursError):
                    send(pid, signal.SIGCONT)
        self._stopped = []
