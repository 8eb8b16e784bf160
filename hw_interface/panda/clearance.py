"""Clearances: how far along its certified path a player may go, each one ending at rest. Needs numpy only.

A player holds the certified samples itself. The supervisor never sends positions: a clearance gives the progress along
these samples for the milliseconds to come, at first as planned and then, on the path, down to rest. While all is well
the next clearance replaces the end of the one before in time. When none comes, because the supervisor has died, hangs
or has withdrawn the right to move, the player comes to rest by doing nothing else than what it was already told.

Rows count the milliseconds of a motion, as the rows of `control.trajectory.playback.Playback`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from control.errors import RefusedError
from control.robot.limits import RobotLimits
from control.trajectory.change_of_rate import HISTORY, ROUNDING
from control.trajectory.on_path_stop import stop_on_path
from control.trajectory.playback import NODE, PROGRESS, Playback, at_progress
from control.trajectory.samples import SAMPLE_TIME

MOST_ROWS = 16384  # of one clearance
KEPT_ROWS = 2 * MOST_ROWS  # that a player remembers
JOIN_ROWS = 50  # milliseconds in which a player goes from where the robot is held to the first sample
STEP_SLACK = 1e-6  # of a sample by which progress may exceed one a millisecond: rounding


@dataclass(frozen=True)
class Clearance:
    """The right to move until a rest.

    Attributes:
        first: Row that `progress` begins with.
        progress: Progress along the certified samples, one row a millisecond, shape (m >= 1,); at rest after the last.
        planned: Last row that is as planned; those after it only bring the arm to rest if nothing newer comes.
    """

    first: int
    progress: NDArray[np.float64]
    planned: int

    @property
    def last(self) -> int:
        """Its last row."""
        return self.first + len(self.progress) - 1


def clear(playback: Playback, first: int, lead: int, end: int, stop: int, limits: RobotLimits) -> Clearance:
    """What a player may do from a row on: as planned for `lead` rows, then the shortest way to rest.

    Args:
        playback: What is planned.
        first: First row of the clearance; the one before it stays as it is.
        lead: Rows that are cleared as planned, at least 1.
        end: Row of the playback at which the arm rests anyway (the end of a part).
        stop: Sample at which that is; a slow clock steps over it by less than a sample.
        limits: Published limits of the robot, which every row keeps.

    Raises:
        RefusedError: no_clearance: a rest is further away than a clearance may reach.
    """
    switch = planned = min(first + lead - 1, end)
    plan = playback
    if switch < end:
        rest = stop_on_path(playback, switch, limits)
        if rest is not playback and len(rest.q) - 1 < end:
            plan, end = rest, len(rest.q) - 1
        else:
            planned = end
    progress = plan.clock[first : end + 1, PROGRESS]
    if not 0 < len(progress) <= MOST_ROWS:
        raise RefusedError(
            "no_clearance",
            f"the next rest is {len(progress)} ms away; a clearance reaches 1 to {MOST_ROWS} ms: plan the motion with "
            "stops",
        )
    return Clearance(first, np.minimum(progress, stop), planned)


class ClearedPath:
    """The player's side: checks each clearance for itself and knows the position of every cleared row.

    Args:
        samples: Certified positions in [rad], shape (n, 7).
        limits: Published limits of the robot; a clearance that breaks one is refused.
        first: Row that the part begins with.
        begin: Progress at that row: the sample `start`, or less than one beyond it on a slow clock.
        start, stop: Samples that the part begins and ends with; progress never leaves them.
        q_held: Where the robot is held in [rad], shape (7,).
    """

    def __init__(
        self,
        samples: np.ndarray,
        limits: RobotLimits,
        first: int,
        begin: float,
        start: int,
        stop: int,
        q_held: np.ndarray,
    ) -> None:
        self._samples, self._limits = samples, limits
        self.stop = float(stop)
        self._start = float(start)
        self._progress = np.empty(KEPT_ROWS)
        self._q = np.empty((KEPT_ROWS, samples.shape[1]))
        q_first = at_progress(samples, np.array([begin]))[0]
        offset = q_held - q_first
        self._join = np.array([offset * (1.0 - _quintic(k / JOIN_ROWS)) for k in range(JOIN_ROWS)])
        self.first = self.last = self.planned = first
        before = first - np.arange(HISTORY)
        self._progress[before % KEPT_ROWS] = begin
        self._q[before % KEPT_ROWS] = q_first

    def accept(self, clearance: Clearance, commanded: int) -> str | None:
        """Take a clearance, or say why not; what was cleared before stays in force then.

        Args:
            clearance: What came.
            commanded: Row that was commanded last.
        """
        first, progress = clearance.first, clearance.progress
        if first <= commanded:
            return "late"
        if first > self.last + 1 or not 0 < len(progress) <= MOST_ROWS:
            return f"rows {first} to {clearance.last} do not follow row {self.last}"
        if not np.isfinite(progress).all():
            return "progress is not finite"
        steps = np.diff(progress, prepend=self._progress[(first - 1) % KEPT_ROWS])
        if steps.min() < -NODE or steps.max() > 1.0 + STEP_SLACK:
            return (
                f"progress changes by {steps.min():.3g} to {steps.max():.3g} samples a millisecond; 0 to 1 is allowed"
            )
        low, high = self._start, self.stop
        if progress[0] < low - NODE or progress[-1] > high + NODE:
            return f"progress {progress[0]:.1f} to {progress[-1]:.1f} leaves the part's samples {low:g} to {high:g}"
        q = at_progress(self._samples, progress)
        if broken := self._broken_limit(first, q):
            return broken
        rows = np.arange(first, first + len(progress)) % KEPT_ROWS
        self._progress[rows], self._q[rows] = progress, q
        self.last, self.planned = clearance.last, clearance.planned
        return None

    def command(self, elapsed: int) -> np.ndarray:
        """Position in [rad], shape (7,), so many milliseconds after the part began; the last cleared row after it."""
        row = self.row(elapsed)
        q = self._q[row % KEPT_ROWS]
        return q + self._join[elapsed] if elapsed < JOIN_ROWS else q

    def row(self, elapsed: int) -> int:
        """Row that is commanded so many milliseconds after the part began."""
        return min(self.first + max(0, elapsed - JOIN_ROWS), self.last)

    def progress(self, row: int) -> float:
        """Progress at a row that was cleared."""
        return float(self._progress[row % KEPT_ROWS])

    def _broken_limit(self, first: int, q: np.ndarray) -> str | None:
        """Which limit the rows break by finite differences, at rest after them."""
        limits = self._limits
        before = self._q[(first - np.arange(HISTORY, 0, -1)) % KEPT_ROWS]
        stream = np.concatenate([before, q, np.repeat(q[-1:], HISTORY, axis=0)])
        if np.any(q < limits.q_min) or np.any(q > limits.q_max):
            return "a position is outside the robot's limits"
        for order, limit, name in (
            (1, limits.qd, "velocity"),
            (2, limits.qdd, "acceleration"),
            (3, limits.qddd, "jerk"),
        ):
            difference = np.abs(np.diff(stream, n=order, axis=0)) / SAMPLE_TIME**order
            if np.any(difference[HISTORY - order :] > limit + ROUNDING):
                return f"{name} would break the robot's limit"
        return None


def _quintic(s: float) -> float:
    """From 0 to 1 with zero slope and curvature at both ends."""
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
