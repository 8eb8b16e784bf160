"""A trajectory as it is commanded: the samples of its path at whatever rate its clock runs. Needs numpy only.

Sample k of a playback is q(p_k): the trajectory's own path at progress p, which counts the trajectory's samples and
may lie between two of them. The rate r = p' is the share of the trajectory's own speed: 1 plays it as it is, 0 rests.

Between two samples q is the quintic polynomial with their positions and with the first and second derivatives that
five-point differences give them. The second derivative is continuous, so resampled at rate r speeds scale with r,
accelerations with r^2 and jerks with r^3, however small r is: the samples are rounded off, not played as corners.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from control.errors import TrajectoryError
from control.trajectory.samples import SAMPLE_TIME, GripperEvent, Trajectory, TrajectorySegment

STENCIL = np.arange(-2, 4)  # samples around a fractional progress that its position depends on
NODE = 1e-9  # of a sample: progress this near to a sample has reached it
PROGRESS, RATE, SLOPE = 0, 1, 2  # columns of a clock


@dataclass(frozen=True)
class Playback:
    """What is commanded from a motion's start to its end, one row a millisecond.

    Attributes:
        trajectory: What is played.
        q: Joint positions in [rad], shape (n, 7).
        qd: Joint velocities in [rad/s], shape (n, 7).
        qdd: Joint accelerations in [rad/s^2], shape (n, 7).
        clock: Progress in samples of the trajectory, its rate in samples per millisecond (the share of the
            trajectory's own speed), and the slope of the rate per millisecond; shape (n, 3).
    """

    trajectory: Trajectory
    q: NDArray[np.float64]
    qd: NDArray[np.float64]
    qdd: NDArray[np.float64]
    clock: NDArray[np.float64]

    @classmethod
    def of(cls, trajectory: Trajectory, rate: float = 1.0) -> "Playback":
        """All of a trajectory at one rate in (0, 1]; at rate 1 exactly its samples.

        Raises:
            TrajectoryError: The rate is not in (0, 1].
        """
        check_rate(rate)
        end = len(trajectory.q) - 1
        clock = steady(-rate, rate, end)
        if rate == 1.0:
            return cls(trajectory, trajectory.q, trajectory.qd, trajectory.qdd, clock)
        q = at_progress(trajectory.q, clock[:, PROGRESS])
        q = np.concatenate([q, q[-1:]])
        qd, qdd = _derivatives(q[:1], q)
        qd[0], qdd[0] = 0.0, 0.0  # the polynomials before the second sample know of motion already
        return cls(trajectory, q, qd, qdd, np.concatenate([clock, clock[-1:]]))

    @property
    def duration(self) -> float:
        """Time from the first to the last row in [s]."""
        return (len(self.q) - 1) * SAMPLE_TIME

    def continued(self, index: int, clock: np.ndarray, q: np.ndarray | None = None) -> "Playback":
        """The same up to row `index`, then another clock until it ends, where the arm rests.

        Args:
            index: Last row that stays.
            clock: What follows, shape (m >= 1, 3).
            q: Positions that belong to it in [rad], shape (m, 7); from the path unless given.
        """
        q = at_progress(self.trajectory.q, clock[:, PROGRESS]) if q is None else q
        # The derivatives of the last row that stays depend on what follows it.
        first, before = slice(0, index), self.q[max(0, index - 1) : max(0, index - 1) + 1]
        q = np.concatenate([self.q[index : index + 1], q, q[-1:]])
        qd, qdd = _derivatives(before, q)
        if index == 0:
            qd[0], qdd[0] = self.qd[0], self.qdd[0]
        return Playback(
            self.trajectory,
            np.concatenate([self.q[first], q]),
            np.concatenate([self.qd[first], qd]),
            np.concatenate([self.qdd[first], qdd]),
            np.concatenate([self.clock[: index + 1], clock, clock[-1:]]),
        )

    def sample(self, row: int) -> int:
        """The trajectory's sample that is commanded or was passed last at a row; their number after the last row."""
        if row >= len(self.q):
            return len(self.trajectory.q)
        return int(self.clock[row, PROGRESS] + NODE)

    def as_trajectory(self) -> Trajectory:
        """What is commanded as a trajectory of its own, to be checked like any other.

        Gripper events and segments begin with the first row at or after their samples. Dwells last as much longer as
        the clock runs slower; events after a stop are left out.
        """
        if self.q is self.trajectory.q:
            return self.trajectory
        events = []
        for event in self.trajectory.gripper:
            given = self._row_of(event.time / SAMPLE_TIME)
            over = min(self._row_of((event.time + event.dwell) / SAMPLE_TIME), len(self.q) - 1)
            if given < len(self.q):
                dwell = max(event.dwell, (over - given) * SAMPLE_TIME)
                events.append(GripperEvent(given * SAMPLE_TIME, dwell, event.command))
        segments: list[TrajectorySegment] = []
        for segment in self.trajectory.segments:
            start, stop = self._row_of(segment.start), self._row_of(segment.stop)
            if start < stop:
                segments.append(replace(segment, start=start, stop=stop))
        return Trajectory(self.q, self.qd, self.qdd, tuple(events), tuple(segments), self.trajectory.joint_names)

    def _row_of(self, sample: float) -> int:
        """The first row at or after a sample; the number of rows where the playback never gets there."""
        return int(np.searchsorted(self.clock[:, PROGRESS], sample - NODE))


def check_rate(rate: float) -> None:
    """Refuse a rate that a trajectory may not be played at.

    Raises:
        TrajectoryError: It is not in (0, 1].
    """
    if not 0.0 < rate <= 1.0:
        raise TrajectoryError(
            f"speed {rate:g} is not valid; it must be above 0 and at most 1 (the speed that the motion was judged at): "
            "a faster motion needs a verdict of its own"
        )


def steady(progress: float, rate: float, end: int) -> np.ndarray:
    """Clock of the rows after a progress at one rate until the end, shape (m, 3); empty at the end."""
    count = max(0, int(np.ceil((end - progress) / rate - NODE)))
    clock = np.empty((count, 3))
    clock[:, PROGRESS] = np.minimum(progress + rate * np.arange(1, count + 1), end)
    clock[-1:, PROGRESS] = end
    clock[:, RATE], clock[:, SLOPE] = rate, 0.0
    return clock


def _polynomials() -> np.ndarray:
    """Weight of each sample of the stencil as a polynomial of the fraction u, coefficients by power, shape (6, 6).

    With value, first and second derivative q0, v0, a0 at u = 0 and q1, v1, a1 at u = 1, and D = q1 - q0, Hermite's
    quintic has the coefficients below; v and a are the fourth-order central differences of five samples.
    """
    q0, q1 = np.eye(6)[2], np.eye(6)[3]
    first, second = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0, np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) / 12.0
    v0, v1, a0, a1 = np.append(first, 0.0), np.append(0.0, first), np.append(second, 0.0), np.append(0.0, second)
    d = q1 - q0
    return np.array(
        [
            q0,
            v0,
            a0 / 2.0,
            10.0 * d - 6.0 * v0 - 4.0 * v1 - 1.5 * a0 + 0.5 * a1,
            -15.0 * d + 8.0 * v0 + 7.0 * v1 + 1.5 * a0 - a1,
            6.0 * d - 3.0 * (v0 + v1) - 0.5 * (a0 - a1),
        ]
    )


WEIGHTS = _polynomials()


def at_progress(samples: np.ndarray, progress: np.ndarray) -> np.ndarray:
    """Positions at fractional progress, shape (m, 7); whole progress gives the samples bit for bit."""
    base = np.floor(progress).astype(int)
    u = progress - base
    q = np.zeros((len(progress), samples.shape[1]))
    for node, c in zip(STENCIL, WEIGHTS.T, strict=True):
        weight = c[0] + u * (c[1] + u * (c[2] + u * (c[3] + u * (c[4] + u * c[5]))))
        q += weight[:, None] * samples[np.clip(base + node, 0, len(samples) - 1)]  # at rest beyond either end
    return q


def _derivatives(before: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Central differences of rows that follow one row and end at rest, in [rad/s] and [rad/s^2]."""
    previous, following = np.concatenate([before, q[:-1]]), np.concatenate([q[1:], q[-1:]])
    qd = (following - previous) / (2.0 * SAMPLE_TIME)
    qdd = (following - 2.0 * q + previous) / SAMPLE_TIME**2
    qd[-1], qdd[-1] = 0.0, 0.0  # what little is left of them where the arm rests at once is within one step's limits
    return qd, qdd
