"""Waiting for a condition instead of sleeping for a guessed time."""

import time
from collections.abc import Callable

# A machine with other work on it, or one that stands still for a while, makes a test slow and never wrong. Only a test
# that fails waits for so long.
GENEROUS = 60.0


def until(condition: Callable[[], object], seconds: float = GENEROUS) -> bool:
    """Whether the condition became true in time, in [s]; it is asked once more after the time is over."""
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            return bool(condition())
        time.sleep(0.01)
    return True
