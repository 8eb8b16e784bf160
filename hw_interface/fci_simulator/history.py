"""What the simulated control box did in the last seconds, millisecond by millisecond: for tests and benchmarks."""

from pathlib import Path

import numpy as np

from control.errors import ConfigError

KEPT = 60_000  # milliseconds


class History:
    """A ring of the latest milliseconds."""

    def __init__(self) -> None:
        self._written = 0
        self._time = np.zeros(KEPT, dtype=np.int64)
        self._mode = np.zeros(KEPT, dtype=np.uint8)
        self._q_d = np.zeros((KEPT, 7))
        self._q = np.zeros((KEPT, 7))
        self._told = np.zeros(KEPT, dtype=bool)

    def add(self, milliseconds: int, mode: int, q_d: np.ndarray, q: np.ndarray, told: bool) -> None:
        """A millisecond.

        Args:
            milliseconds: Robot time.
            mode: Of the box.
            q_d, q: Commanded and measured positions in [rad], shape (7,).
            told: Whether the commanded position is a client's; else the box extrapolates, brakes or holds by itself.
        """
        k = self._written % KEPT
        self._time[k], self._mode[k], self._q_d[k], self._q[k] = milliseconds, mode, q_d, q
        self._told[k] = told
        self._written += 1

    def write(self, path: Path) -> int:
        """Write them to an NPZ file (time, mode, q_d, q, told), oldest first; returns how many there are.

        Raises:
            ConfigError: The file cannot be written.
        """
        first = max(0, self._written - KEPT)
        rows = np.arange(first, self._written) % KEPT
        try:
            with path.open("wb") as file:
                columns = {name: getattr(self, f"_{name}")[rows] for name in ("time", "mode", "q_d", "q", "told")}
                np.savez(file, **columns)
        except OSError as error:
            raise ConfigError(f"'{path}' cannot be written ({error.strerror})") from error
        return len(rows)
