"""From a motion file to the 1 kHz trajectory that a robot would play.

Every row is met exactly, so nothing that is wrong with a file is smoothed away: a jump between two rows stays one, at
a speed of at least the step over the time between them. Between rows of

* 1 ms: nothing is added; the samples are the rows. Missing derivatives are central differences.
* positions, velocities and accelerations: quintic polynomials;
* positions and velocities: cubic polynomials. Source for both: ros2_control, joint_trajectory_controller, "Trajectory
  representation": what ROS 2 plays between the same rows;
* positions alone: a cubic spline with continuous acceleration from rest to rest, where rests are the ends and every
  stretch in which no joint moves. (Straight lines, as ROS 2 has them, would need endless acceleration at each row.)

Where a file is at rest at an end and gives no acceleration there, that is zero: the first and last pieces become
quintic. How far curves leave the straight lines between rows is reported: between coarse rows they are a guess.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from control.motion_files.contents import MotionFile
from control.motion_files.gripper_events import gripper_events, rests
from control.trajectory.samples import SAMPLE_TIME, Trajectory, TrajectorySegment

ON_TIME = 1e-5  # [s]; a row this near to a whole millisecond is played there
WORTH_SAYING = 200.0  # [rad/s^3] of jerk from rounding; the least limit of a joint is 3750


@dataclass(frozen=True)
class ResamplingReport:
    """How a file became samples.

    Attributes:
        method: In words.
        departure: Largest distance of a joint from the straight line between its rows in [rad].
        at: When that is, in [s] from the start.
        joint: Index of that joint.
    """

    method: str
    departure: float
    at: float
    joint: int


def to_trajectory(motion: MotionFile, grasp_force: float | None = None) -> Trajectory:
    """A motion as it would be played; see `to_trajectory_with_report`."""
    return to_trajectory_with_report(motion, grasp_force)[0]


def to_trajectory_with_report(
    motion: MotionFile, grasp_force: float | None = None
) -> tuple[Trajectory, ResamplingReport]:
    """A motion as it would be played.

    Args:
        motion: A file of ours is played bit for bit; others as this module's docstring says, from time 0 on.
        grasp_force: Closings of the gripper grasp with this force in [N] wherever the file has none; None leaves them
            movements to a width.

    Returns:
        The trajectory, in one segment "motion" unless it is ours, and how it was made.
    """
    if motion.trajectory is not None:
        return motion.trajectory, ResamplingReport("the file's own samples", 0.0, 0.0, 0)
    times = motion.times - motion.times[0]
    if len(times) > 1 and np.max(np.abs(times - np.arange(len(times)) * SAMPLE_TIME)) <= ON_TIME:
        samples, method = _as_they_are(motion)
        departure = (0.0, 0.0, 0)
    else:
        count = max(2, int(np.ceil(times[-1] / SAMPLE_TIME - ON_TIME / SAMPLE_TIME)) + 1)
        at = np.minimum(np.arange(count) * SAMPLE_TIME, times[-1])
        qd, out_of, into, method = _derivatives(motion, times)
        samples = _pieces(times, motion.q, qd, out_of, into, at)
        departure = _departure(times, motion.q, at, samples[0])
    trajectory = Trajectory(
        *samples,
        gripper=gripper_events(motion, grasp_force),
        segments=(TrajectorySegment("motion", 0, len(samples[0])),),
    )
    return trajectory, ResamplingReport(method, *departure)


def _as_they_are(motion: MotionFile) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], str]:
    """Rows that are samples already; the arm rests before the first and after the last."""
    q = motion.q
    padded = np.concatenate([q[:1], q, q[-1:]])
    qd = (padded[2:] - padded[:-2]) / (2.0 * SAMPLE_TIME) if motion.qd is None else motion.qd
    qdd = (padded[2:] - 2.0 * q + padded[:-2]) / SAMPLE_TIME**2 if motion.qdd is None else motion.qdd
    missing = [w for w, a in (("velocities", motion.qd), ("accelerations", motion.qdd)) if a is None]
    by = f"; {' and '.join(missing)} by central differences" if missing else ""
    step = _rounded_to(q)
    jerk = 4.0 * step / SAMPLE_TIME**3  # a third difference of errors of half a step: (1 + 3 + 3 + 1) / 2
    noise = f"; positions are rounded to {step:.0e} rad, which alone makes jerks of up to {jerk:.0f} rad/s^3"
    return (q, qd, qdd), f"the file's rows, 1 ms apart{by}{noise if jerk >= WORTH_SAYING else ''}"


def _rounded_to(q: np.ndarray) -> float:
    """Step in [rad] that positions are rounded to: a power of ten, or that of 32-bit numbers; 0 when they are not."""
    if np.ptp(q, axis=0).max() == 0.0:
        return 0.0
    for decimals in range(2, 8):
        if np.max(np.abs(q * 10.0**decimals - np.rint(q * 10.0**decimals))) < 1e-6:
            return 10.0**-decimals
    if np.array_equal(q, q.astype(np.float32)):
        return float(np.spacing(np.float32(np.max(np.abs(q)))))
    return 0.0


def _derivatives(motion: MotionFile, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, str]:
    """Velocities at rows, shape (n, 7), accelerations out of and into each piece, shape (n - 1, 7), and the method."""
    if motion.qd is None:
        qd, qdd = _spline(times, motion.q)
        return (
            qd,
            qdd[:-1],
            qdd[1:],
            "cubic spline through the positions, from rest to rest (the file has no velocities)",
        )
    qd = motion.qd
    if motion.qdd is not None:
        return qd, motion.qdd[:-1], motion.qdd[1:], "quintic polynomials from the file's velocities and accelerations"
    h = np.diff(times)[:, None]
    slope = np.diff(motion.q, axis=0) / h
    out_of = (6.0 * slope - 4.0 * qd[:-1] - 2.0 * qd[1:]) / h
    into = (-6.0 * slope + 2.0 * qd[:-1] + 4.0 * qd[1:]) / h
    out_of[0] = np.where(qd[0] == 0.0, 0.0, out_of[0])
    into[-1] = np.where(qd[-1] == 0.0, 0.0, into[-1])
    return qd, out_of, into, "cubic polynomials from the file's velocities (it has no accelerations)"


def _spline(times: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Velocities and accelerations at rows of splines from rest to rest, each of shape (n, 7)."""
    qd, qdd = np.zeros_like(q), np.zeros_like(q)
    begin = 0
    for first, last in [*rests(times, q), (len(q) - 1, len(q) - 1)]:
        if first > begin:
            rows = slice(begin, first + 1)
            spline = CubicSpline(times[rows], q[rows], bc_type="clamped")
            qd[rows], qdd[rows] = spline(times[rows], 1), spline(times[rows], 2)
            qd[begin] = qd[first] = qdd[begin] = qdd[first] = 0.0
        begin = last
    return qd, qdd


def _pieces(
    times: np.ndarray, q: np.ndarray, qd: np.ndarray, out_of: np.ndarray, into: np.ndarray, at: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, velocities and accelerations of quintic polynomials between rows.

    On a piece of length h, with s = (t - t_k) / h in 0..1 and D = q_{k+1} - q_k:

        q(t) = q_k + h v_k s + h^2 a_k s^2 / 2 + c3 s^3 + c4 s^4 + c5 s^5
        c3 =  10 D - h (6 v_k + 4 v_{k+1}) - h^2 (3 a_k - a_{k+1}) / 2
        c4 = -15 D + h (8 v_k + 7 v_{k+1}) + h^2 (3 a_k - 2 a_{k+1}) / 2
        c5 =   6 D - 3 h (v_k + v_{k+1})   - h^2 (a_k - a_{k+1}) / 2

    the only polynomial of degree five with these positions, speeds and accelerations at both ends; it is the cubic
    when the accelerations are those of the cubic.

    Args:
        times, q, qd: Of the rows, shapes (n,), (n, 7), (n, 7).
        out_of, into: Accelerations at the start and end of each piece in [rad/s^2], shape (n - 1, 7).
        at: Times of the samples in [s], shape (m,), within those of the rows.
    """
    k = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    h = np.diff(times)[k][:, None]
    s = (at - times[k])[:, None] / h
    step = q[k + 1] - q[k]
    v0, v1, a0, a1 = h * qd[k], h * qd[k + 1], h**2 * out_of[k], h**2 * into[k]
    c3 = 10 * step - 6 * v0 - 4 * v1 - (3 * a0 - a1) / 2
    c4 = -15 * step + 8 * v0 + 7 * v1 + (3 * a0 - 2 * a1) / 2
    c5 = 6 * step - 3 * (v0 + v1) - (a0 - a1) / 2
    positions = q[k] + s * (v0 + s * (a0 / 2 + s * (c3 + s * (c4 + s * c5))))
    speeds = (v0 + s * (a0 + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))) / h
    accelerations = (a0 + s * (6 * c3 + s * (12 * c4 + s * 20 * c5))) / h**2
    end = s[:, 0] >= 1.0  # the last row exactly, without rounding
    positions[end], speeds[end], accelerations[end] = q[k[end] + 1], qd[k[end] + 1], into[k[end]]
    # Where accelerations jump at a row, one value says nothing of what is played: their samples are differences.
    accelerations[1:-1] = (positions[2:] - 2.0 * positions[1:-1] + positions[:-2]) / SAMPLE_TIME**2
    return positions, speeds, accelerations


def _departure(times: np.ndarray, q: np.ndarray, at: np.ndarray, positions: np.ndarray) -> tuple[float, float, int]:
    lines = np.stack([np.interp(at, times, q[:, joint]) for joint in range(q.shape[1])], axis=1)
    row, joint = np.unravel_index(int(np.argmax(np.abs(positions - lines))), lines.shape)
    return float(abs(positions[row, joint] - lines[row, joint])), float(at[row]), int(joint)
