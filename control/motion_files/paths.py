"""From a motion file to a path without times, for `control.retiming.retime`.

The path is what the file's motion follows: the straight lines between its rows where it has positions alone, and the
curve that its velocities describe where it has them. It is cut where the gripper is commanded and nowhere else
(the retimer stops at each cut, so an arm that moved on while its gripper acted stops there now); one of our own files
is cut at its own segments too, which start and end at rest and say what is held and what may touch.
"""

import numpy as np

from control.motion_files.contents import MotionFile
from control.motion_files.gripper_events import gripper_events
from control.motion_files.resampling import to_trajectory
from control.trajectory.samples import (
    SAMPLE_TIME,
    GripperCommand,
    JointPath,
    PathSegment,
    TrajectorySegment,
)

NEAR = 2e-4  # [rad]; waypoints nearer than this to the one before are left out


def to_path(motion: MotionFile, grasp_force: float | None = None) -> JointPath:
    """The path of a motion: dense waypoints, gripper commands after the segment that leads to where they are given.

    Args:
        motion: Any motion file.
        grasp_force: As for `control.motion_files.resampling.to_trajectory`.
    """
    if motion.trajectory is None and motion.qd is None:
        q, times, events = motion.q, motion.times - motion.times[0], gripper_events(motion, grasp_force)
        stretches = (TrajectorySegment("motion", 0, len(q)),)
    else:
        trajectory = to_trajectory(motion, grasp_force)
        q, events, stretches = trajectory.q, trajectory.gripper, trajectory.segments
        times = np.arange(len(q)) * SAMPLE_TIME
    commands: dict[int, list[GripperCommand]] = {}
    for event in events:
        commands.setdefault(int(np.argmin(np.abs(times - event.time))), []).append(event.command)
    segments: list[PathSegment] = []
    begin = 0
    for stretch in stretches or (TrajectorySegment("motion", 0, len(q)),):
        inside = sorted(k for k in commands if stretch.start <= k < stretch.stop)
        for cut in dict.fromkeys([*inside, stretch.stop - 1]):
            waypoints = _thinned(q[begin : cut + 1])
            given = commands.get(cut, [])
            # A second command at the same moment needs a segment of its own, which does not move.
            for k, command in enumerate(given or [None]):
                if len(waypoints) > 1 or command is not None:
                    points = waypoints if k == 0 else waypoints[-1:]
                    segments.append(PathSegment(stretch.name, points, command, stretch.held, stretch.touching))
            begin = cut
    if not segments:
        segments.append(PathSegment((stretches or (TrajectorySegment("motion", 0, 0),))[0].name, q[:1]))
    return JointPath(_numbered(segments) if len(stretches) < 2 else tuple(segments))


def _thinned(q: np.ndarray) -> np.ndarray:
    """Rows at least NEAR apart, the first and the last among them, shape (m >= 1, 7)."""
    kept = [0]
    for k in range(1, len(q)):
        if np.max(np.abs(q[k] - q[kept[-1]])) > NEAR:
            kept.append(k)
    if kept[-1] != len(q) - 1 and np.any(q[kept[-1]] != q[-1]):
        if len(kept) > 1:
            kept.pop()
        kept.append(len(q) - 1)
    return np.array(q[kept])


def _numbered(segments: list[PathSegment]) -> tuple[PathSegment, ...]:
    """Segments of one stretch, told apart by number when there are several."""
    if len(segments) == 1:
        return tuple(segments)
    return tuple(
        PathSegment(f"{s.name} {k}", s.q, s.gripper, s.held, s.touching) for k, s in enumerate(segments, start=1)
    )
