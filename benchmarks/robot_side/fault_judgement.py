"""What must never happen, whatever fails: judged on the simulated control box's own history."""

from dataclasses import dataclass

import numpy as np

from benchmarks.robot_side.panda_side import History
from control.trajectory.samples import Trajectory

JOIN = 1.01e-4  # [rad] that a motion's first sample may be away from where the arm is held
OFF_PATH = 1e-6  # [rad] by which a commanded position may miss the path: rounding
IDLE, MOVE = 1, 2  # libfranka.RobotMode


@dataclass(frozen=True)
class Movement:
    """How the commanded position moved in a window of the history.

    Attributes:
        uncertified: Rows in which a client moved the arm although nothing was certified, or off the certified path.
        departure: Largest distance from the certified path of what a client commanded, per joint in [rad].
        to_rest: Robot time from the fault to rest in [s]; None when it never rests in the window.
        braked_by_box: Whether the control box itself brought the arm to rest.
    """

    uncertified: int
    departure: float
    to_rest: float | None
    braked_by_box: bool


def judge_movement(history: History, since: int, fault: int, trajectory: Trajectory) -> Movement:
    """Judge a window of the history.

    Args:
        history: Of the control box.
        since: Robot time in [ms] at which the window begins; the motion was accepted after it.
        fault: Robot time in [ms] of the fault.
        trajectory: The only motion that may be played in it.
    """
    window = history.time >= since
    time, mode, q_d = history.time[window], history.mode[window], history.q_d[window]
    steps = np.any(np.diff(q_d, axis=0) != 0.0, axis=1)
    moving = np.flatnonzero(steps) + 1
    by_client = moving[history.told[window][moving]]
    distance = distance_from(q_d[by_client], trajectory.q)
    departure = float(distance.max(initial=0.0))
    # Before the first sample the arm goes there from where it was held, within the tolerance of the start.
    uncertified = int(np.sum(distance > JOIN + OFF_PATH))
    after = moving[time[moving] > fault]
    rests = len(moving) == 0 or len(q_d) - moving[-1] > 100
    return Movement(
        uncertified,
        departure,
        (float(time[after[-1]] - fault) / 1000.0 if len(after) else 0.0) if rests else None,
        bool(np.any(~np.isin(mode[moving], (MOVE, IDLE)))),
    )


def distance_from(rows: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Distance per joint in [rad] of each row (m, 7) from the polyline through samples (n, 7), shape (m,)."""
    found = np.zeros(len(rows))
    for i, q in enumerate(rows):
        k = int(np.argmin(np.abs(samples - q).max(axis=1)))
        best = float(np.abs(samples[k] - q).max())
        for a, b in ((max(0, k - 1), k), (k, min(len(samples) - 1, k + 1))):
            way = samples[b] - samples[a]
            length = float(way @ way)
            share = 0.0 if length == 0.0 else float(np.clip((q - samples[a]) @ way / length, 0.0, 1.0))
            best = min(best, float(np.abs(samples[a] + share * way - q).max()))
        found[i] = best
    return found
