"""Coming to rest on the path: slows the clock of a trajectory down to zero instead of leaving its path.

The samples are q(p(t)), where the progress p counts the trajectory's samples and its rate r = p' (in samples per
millisecond) falls from 1 to 0. With

    q' r,   q'' r^2 + q' r',   q''' r^3 + 3 q'' r r' + q' r''

for velocity, acceleration and jerk, what keeps the limits at r = 1 keeps them during the fall when r' and r'' are
small enough: the shortest fall that does is searched. Its r' is a trapezoid, so r'' is bounded too. When the
trajectory's own end comes first, the arm rests there. Needs numpy only: a robot-side process stops on its own.
"""

from dataclasses import dataclass

import numpy as np

from control.errors import TrajectoryError
from control.limits import RobotLimits
from control.trajectory import SAMPLE_TIME, Trajectory

RAMP = 0.2  # share of the fall over which r' builds up, and again dies down
SHORTEST, LONGEST, GROWTH = 0.005, 10.0, 1.04  # [s], [s], ratio: the ladder of durations to choose from
HISTORY = 3  # samples that a third difference reaches back to
STENCIL = np.arange(-2, 4)  # samples around a fractional progress that the interpolating polynomial goes through


@dataclass(frozen=True)
class StopMotion:
    """A way to rest.

    Attributes:
        q: Samples every millisecond that follow the sample at which the stop was asked for, in [rad], shape (n, 7),
            n >= 1; the last one is where the arm rests.
        qd: Velocities in [rad/s], shape (n, 7); zero in the last row.
        qdd: Accelerations in [rad/s^2], shape (n, 7); zero in the last row.
        progress: Where on the trajectory the arm rests, in samples from its start.
    """

    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    progress: float


def stop_on_path(trajectory: Trajectory, index: int, limits: RobotLimits) -> StopMotion:
    """The shortest way to rest on the trajectory's own path.

    Args:
        trajectory: What is being played; it keeps the limits itself.
        index: Sample that the arm was commanded last.
        limits: Published limits of position, velocity, acceleration and jerk, which every sample keeps by finite
            differences with the samples before it. Torques follow from the acceleration limits and are not looked at.

    Returns:
        Samples to command from the next millisecond on. Where the arm rests at `index` already, that is one sample.
        A trajectory without any room below its limits is played to its end.

    Raises:
        TrajectoryError: `index` is outside the trajectory.
    """
    end = len(trajectory.q) - 1
    if not 0 <= index <= end:
        raise TrajectoryError(f"cannot stop at sample {index}; the trajectory has samples 0 to {end}")
    stay = trajectory.q[index : index + 1]
    if _keeps_limits(trajectory.q, index, stay, limits):
        return _motion(trajectory.q, index, stay, float(index))
    # Playing on is the longest candidate; whether a fall is gentle enough is as good as monotonic in its duration,
    # and the search only ever returns a candidate that was checked.
    best = np.arange(index + 1.0, end + 1.0)
    best_q = trajectory.q[index + 1 :]
    durations = SHORTEST * GROWTH ** np.arange(int(np.log(LONGEST / SHORTEST) / np.log(GROWTH)) + 1)
    low, high = 0, len(durations)
    while low < high:
        middle = (low + high) // 2
        progress = _slowing_down(index, float(durations[middle]), end)
        q = _at_progress(trajectory.q, progress)
        if _keeps_limits(trajectory.q, index, q, limits):
            high, best, best_q = middle, progress, q
        else:
            low = middle + 1
    return _motion(trajectory.q, index, np.concatenate([best_q, best_q[-1:]]), float(best[-1]))


def _slowing_down(index: int, duration: float, end: int) -> np.ndarray:
    """Progress after each further millisecond until the rate is 0, or until the end of the trajectory."""
    steps = max(1, round(duration / SAMPLE_TIME))
    x = np.arange(1, steps + 1) / steps
    # r = 1 - f(x) with f' a trapezoid of area 1 and this height; p is the integral of r, g that of f.
    height = 1.0 / (1.0 - RAMP)
    left = 1.0 - x
    rising = height * x**3 / (6.0 * RAMP)
    even = height * (RAMP**2 / 6.0 + RAMP * (x - RAMP) / 2.0 + (x - RAMP) ** 2 / 2.0)
    falling = 0.5 - left + height * left**3 / (6.0 * RAMP)
    g = np.where(x <= RAMP, rising, np.where(x <= 1.0 - RAMP, even, falling))
    progress = index + steps * (x - g)
    beyond = int(np.searchsorted(progress, end))
    return progress if beyond == len(progress) else np.append(progress[:beyond], float(end))


def _at_progress(samples: np.ndarray, progress: np.ndarray) -> np.ndarray:
    """Samples at fractional progress, shape (m, 7), by Lagrange's polynomial through the six samples around each."""
    base = np.floor(progress).astype(int)
    fraction = progress - base
    rows = np.clip(base[:, None] + STENCIL, 0, len(samples) - 1)  # at rest beyond either end
    weights = np.ones((len(progress), len(STENCIL)))
    for k, node in enumerate(STENCIL):
        for other in STENCIL:
            if other != node:
                weights[:, k] *= (fraction - other) / (node - other)
    return np.einsum("mk,mkj->mj", weights, samples[rows])


def _with_history(samples: np.ndarray, index: int, q: np.ndarray) -> np.ndarray:
    """The commanded samples up to `index`, then q; HISTORY rows more than q."""
    return np.concatenate([samples[np.clip(np.arange(index - HISTORY + 1, index + 1), 0, None)], q])


def _keeps_limits(samples: np.ndarray, index: int, q: np.ndarray, limits: RobotLimits) -> bool:
    """Whether commanding q after samples[index], and then nothing new, keeps the limits by finite differences."""
    stream = np.concatenate([_with_history(samples, index, q), np.repeat(q[-1:], HISTORY, axis=0)])
    for order, limit in ((1, limits.qd), (2, limits.qdd), (3, limits.qddd)):
        difference = np.diff(stream, n=order, axis=0)[HISTORY - order :] / SAMPLE_TIME**order
        if np.any(np.abs(difference) > limit):
            return False
    return bool(np.all(q >= limits.q_min) and np.all(q <= limits.q_max))


def _motion(samples: np.ndarray, index: int, q: np.ndarray, progress: float) -> StopMotion:
    """Samples with their derivatives: central differences, at rest after the last one."""
    before = _with_history(samples, index, q)[HISTORY - 1 : -1]
    after = np.concatenate([q[1:], q[-1:]])
    qd = (after - before) / (2.0 * SAMPLE_TIME)
    qdd = (after - 2.0 * q + before) / SAMPLE_TIME**2
    qd[-1], qdd[-1] = 0.0, 0.0  # what little is left of them where the arm rests at once is within one step's limits
    return StopMotion(q=q, qd=qd, qdd=qdd, progress=progress)
