"""Changing the rate at which a trajectory's clock runs, without leaving its path. Needs numpy only.

The samples are q(p(t)), where the progress p counts the trajectory's samples and r = p' is its rate. With

    q' r,   q'' r^2 + q' r',   q''' r^3 + 3 q'' r r' + q' r''

for velocity, acceleration and jerk, what keeps the limits at r = 1 keeps them at any smaller rate, and during a change
when r' and r'' are small enough: the shortest change that does is searched. Its r' goes evenly from what it is now to a
plateau, stays, and goes evenly to 0, so r'' is bounded, and a change may begin in the middle of another.
"""

from collections.abc import Callable, Iterator

import numpy as np

from control.robot.limits import RobotLimits
from control.trajectory.playback import PROGRESS, RATE, Playback, at_progress
from control.trajectory.samples import SAMPLE_TIME

RAMP = 0.2  # share of the change over which r' goes to its plateau, and again from there to 0
SHORTEST, LONGEST, GROWTH = 0.005, 10.0, 1.04  # [s], [s], ratio: the ladder of durations to choose from
# When to begin, in rows from now. A change that begins later may be over sooner, or be the only one: in the tail of
# another change, or while the arm decelerates at its limit anyway.
DELAYS = (0, 10, 20, 40, 80, 160, 320, 640, 1280)
HISTORY = 3  # rows that a third difference reaches back to
ROUNDING = 1e-6  # differences of float64 positions near 3 rad carry about 4e-16 / dt^3 = 4e-7 of noise
OVERSHOOT = 1e-9  # of a rate beyond 0 or 1: rounding

Torque = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def changes(
    playback: Playback, index: int, target: float, limits: RobotLimits, torque: Torque | None = None
) -> Iterator[tuple[int, np.ndarray]]:
    """Ways to change the rate: the shortest that begins at once, and then each that begins later but is over sooner.

    Args:
        playback: What is being commanded.
        index: Row that was commanded last.
        target: Rate to end with, 0..1.
        limits, torque: As for `keeps_limits`.

    Yields:
        The row after which the change begins, and the clock of the rows that follow it until the rate is reached or
        the trajectory ends, shape (m, 3).
    """
    ladder = SHORTEST * GROWTH ** np.arange(int(np.log(LONGEST / SHORTEST) / np.log(GROWTH)) + 1)
    soonest = np.inf  # [s] from now until a change is over
    for delay in DELAYS:
        begin = index + delay
        if begin >= len(playback.q):
            return
        durations = ladder[ladder < soonest - delay * SAMPLE_TIME]
        # Whether a change is gentle enough is as good as monotonic in its duration, and what is found was checked.
        best, low, high = None, 0, len(durations)
        while low < high:
            middle = (low + high) // 2
            clock = ramp(playback.clock[begin], target, float(durations[middle]))
            if not _turns_back_or_hurries(clock):
                clock = until(clock, len(playback.trajectory.q) - 1)
                if not keeps_limits(playback, begin, _with_end(playback, clock), limits, torque):
                    low = middle + 1
                    continue
                best, soonest = clock, delay * SAMPLE_TIME + float(durations[middle])
            high = middle
        if best is not None:
            yield begin, best


def ramp(now: np.ndarray, target: float, duration: float) -> np.ndarray:
    """Clock of the rows after this one while its rate goes to the target in `duration` [s], shape (m, 3).

    The slope goes from what it is, s0, to a plateau s in the first fifth T1 of the time T, and to 0 in the last. The
    rate changes by its integral, (s0 + s) T1 / 2 + s (T - 2 T1) + s T1 / 2, which gives s.
    """
    steps = max(1, round(duration / SAMPLE_TIME))
    p0, r0, s0 = now
    first = RAMP * steps
    plateau = ((target - r0) - s0 * first / 2.0) / (steps - first)
    t = np.arange(1, steps + 1, dtype=float)
    bend = (plateau - s0) / first

    def rising(t: np.ndarray | float) -> tuple:
        return p0 + t * (r0 + t * (s0 / 2.0 + t * bend / 6.0)), r0 + t * (s0 + t * bend / 2.0), s0 + t * bend

    p1, r1, _ = rising(first)
    u = t - first
    even = p1 + u * (r1 + u * plateau / 2.0), r1 + u * plateau, np.full(steps, plateau)
    u2 = steps - 2.0 * first
    p3 = p1 + u2 * (r1 + u2 * plateau / 2.0) + first * target - plateau * first**2 / 6.0
    left = steps - t
    fading = plateau * left / first
    falling = p3 - left * (target - fading * left / 6.0), target - fading * left / 2.0, fading
    phase = np.where(t <= first, 0, np.where(t <= steps - first, 1, 2))
    return np.stack([np.choose(phase, three) for three in zip(rising(t), even, falling, strict=True)], axis=1)


def until(clock: np.ndarray, end: int) -> np.ndarray:
    """The clock, cut off where the trajectory ends: there the arm rests by itself."""
    beyond = int(np.searchsorted(clock[:, PROGRESS], end))
    if beyond == len(clock):
        return clock
    cut = clock[: beyond + 1].copy()
    cut[-1, PROGRESS] = end
    return cut


def _turns_back_or_hurries(clock: np.ndarray) -> bool:
    rate = clock[:, RATE]
    return bool(rate.min() < -OVERSHOOT or rate.max() > 1.0 + OVERSHOOT)


def _with_end(playback: Playback, clock: np.ndarray) -> np.ndarray:
    """Positions of a change and of a few rows after it: its end shows in the differences of those, too."""
    end = len(playback.trajectory.q) - 1
    after = np.minimum(clock[-1, PROGRESS] + clock[-1, RATE] * np.arange(1, HISTORY + 1), end)
    return at_progress(playback.trajectory.q, np.concatenate([clock[:, PROGRESS], after]))


def keeps_limits(
    playback: Playback, index: int, q: np.ndarray, limits: RobotLimits, torque: Torque | None = None
) -> bool:
    """Whether commanding what is asked for keeps the limits by finite differences.

    Args:
        playback: What is being commanded.
        index: Row that is commanded before it.
        q: Positions to command in [rad], shape (m, 7).
        limits: Of position, velocity, acceleration and jerk; of torque and torque rate, too, with `torque`.
        torque: (q, qd, qdd), each of shape (n, 7), to torques in [Nm] of the same shape; None leaves them out.
    """
    rows = np.clip(np.arange(index - HISTORY + 1, index + 1), 0, None)
    stream = np.concatenate([playback.q[rows], q])
    differences = [np.diff(stream, n=order, axis=0) / SAMPLE_TIME**order for order in (1, 2, 3)]
    for order, difference, limit in zip((1, 2, 3), differences, (limits.qd, limits.qdd, limits.qddd), strict=True):
        if np.any(np.abs(difference[HISTORY - order :]) > limit + ROUNDING):
            return False
    if np.any(q < limits.q_min) or np.any(q > limits.q_max):
        return False
    if torque is None:
        return True
    tau = torque(stream[2:], differences[0][1:], differences[1])  # from row `index` on
    rates = np.diff(tau, axis=0) / SAMPLE_TIME
    return bool(np.all(np.abs(tau[1:]) <= limits.tau) and np.all(np.abs(rates) <= limits.taud))
