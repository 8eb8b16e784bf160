"""From samples of a gripper's width to the commands behind them.

A width counts as linear between rows, as joints in a file do. A command is given at the row from which the width
changes, and asks for the width at which it stays for SETTLED or turns back; changes up to STILL are noise.

Widths do not tell a grasp from closing to a width: a closing is a grasp only where the file says so (gripper_force
above zero while it closes) or the caller does.
"""

import numpy as np

from control.motion_files.contents import MotionFile
from control.trajectory.samples import GripperCommand, GripperEvent

STILL = 5e-4  # [m]
TRACE = 5e-5  # [m]; a change that has begun is followed by steps of this size
SETTLED = 0.1  # [s]
SAME_POSITION = 1e-9  # [rad]
SHORTEST_REST = 0.05  # [s]; rows of a motion that turns back may be equal too, but not for as long as that


def rests(times: np.ndarray, q: np.ndarray) -> list[tuple[int, int]]:
    """First and last rows of stretches of at least SHORTEST_REST in which no joint moves.

    Args:
        times: In [s], shape (n,).
        q: Joint positions in [rad], shape (n, 7).
    """
    still = np.concatenate([[False], np.max(np.abs(np.diff(q, axis=0)), axis=1) <= SAME_POSITION, [False]])
    edges = np.flatnonzero(np.diff(still.astype(int)))
    spans = zip(edges[::2], edges[1::2], strict=True)
    return [(int(a), int(b)) for a, b in spans if times[b] - times[a] >= SHORTEST_REST - 1e-9]


def gripper_events(motion: MotionFile, grasp_force: float | None = None) -> tuple[GripperEvent, ...]:
    """Commands that explain a motion's gripper widths; none when it has no widths, its own events when it is ours.

    The arm may be moving when a command is given. Its dwell is the time that the arm rests from then on, or at least
    what the width takes to change.

    Args:
        motion: With times as in the file; events count from its first row.
        grasp_force: Closings grasp with this force in [N] wherever the file has none; None leaves them movements.
    """
    if motion.trajectory is not None or motion.gripper_width is None:
        return motion.gripper
    times = motion.times - motion.times[0]
    resting = rests(times, motion.q)
    events = []
    for first, last in _changes(times, motion.gripper_width):
        target, start = max(float(motion.gripper_width[last]), 0.0), float(motion.gripper_width[first])
        command = GripperCommand("move", target)
        if target < start:
            force = grasp_force or 0.0
            if motion.gripper_force is not None:
                force = float(np.max(motion.gripper_force[first : last + 1])) or force
            if force > 0.0:
                command = GripperCommand("grasp", target, force)
        rest_end = next((times[b] for a, b in resting if a <= first < b), 0.0)
        dwell = float(max(times[last], rest_end) - times[first])
        events.append(GripperEvent(float(times[first]), dwell, command))
    return tuple(events)


def _changes(times: np.ndarray, width: np.ndarray) -> list[tuple[int, int]]:
    """Rows at which a width begins to change and has reached where it stays or turns back."""
    changes: list[tuple[int, int]] = []
    settled, k, n = 0, 1, len(width)
    while k < n:
        if abs(width[k] - width[settled]) <= STILL:
            k += 1
            continue
        before = np.flatnonzero(np.abs(width[settled:k] - width[settled]) <= TRACE)
        first, way = settled + int(before[-1]), np.sign(width[k] - width[settled])
        last, k = k, k + 1
        while k < n:
            beyond = way * (width[k] - width[last])
            if beyond > TRACE:
                last = k
            elif beyond < -STILL or times[k] - times[last] > SETTLED:
                break
            k += 1
        changes.append((first, last))
        settled = last
        k = last + 1
    return changes
