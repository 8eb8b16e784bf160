"""Retiming: from a joint path to the 1 kHz trajectory that a robot plays.

Each segment goes from rest to rest (`control.retiming.segment_timing`); between them the gripper may act while the arm
rests. The joined stream keeps the limits because each segment does and joins are at rest.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from control.errors import RetimingError
from control.retiming.path_smoothing import distinct_waypoints
from control.retiming.segment_timing import RetimingOptions, SegmentReport, shortest_time, time_segment
from control.robot.dynamics import Payload, RobotModel
from control.robot.gripper import GripperModel
from control.robot.limits import RobotLimits
from control.safety.limits import SafetyLimits
from control.trajectory.samples import (
    SAMPLE_TIME,
    GripperCommand,
    GripperEvent,
    JointPath,
    PathSegment,
    Trajectory,
    TrajectorySegment,
)

STROKE_SLACK = 0.1  # [s] beyond a full stroke: starting, coming to rest and noticing it
JOIN_TOLERANCE = 1e-6  # [rad] between the end of one segment and the start of the next


@dataclass(frozen=True)
class RetimingReport:
    """How a path was retimed; segments without motion do not appear."""

    segments: tuple[SegmentReport, ...]

    @property
    def deviation(self) -> float:
        """Largest difference of a joint from the waypoints' polyline in [rad]."""
        return max((s.deviation for s in self.segments), default=0.0)

    @property
    def ratio(self) -> float:
        """Moving time relative to the bound, 1 = cannot be faster."""
        bound = sum(s.bound for s in self.segments)
        return sum(s.duration for s in self.segments) / bound if bound > 0 else 1.0


def retime(
    path: JointPath,
    robot: RobotModel,
    limits: RobotLimits,
    safety: SafetyLimits,
    options: RetimingOptions | None = None,
    payloads: Mapping[str, Payload] | None = None,
) -> Trajectory:
    """Time a path; see `retime_with_report`."""
    return retime_with_report(path, robot, limits, safety, options, payloads)[0]


def retime_with_report(
    path: JointPath,
    robot: RobotModel,
    limits: RobotLimits,
    safety: SafetyLimits,
    options: RetimingOptions | None = None,
    payloads: Mapping[str, Payload] | None = None,
) -> tuple[Trajectory, RetimingReport]:
    """Time a path.

    Args:
        path: Waypoints in [rad] by segment. Segments without motion only contribute their gripper command.
        robot: Rigid-body model for torques and the hand's speed.
        limits: Published limits of the robot.
        safety: Shares of them that may be used, and the hand's speeds. A segment's speed_scale slows all speeds down
            further; accelerations stay.
        options: Tolerance, dwells and tuning.
        payloads: What things weigh, by name; segments that hold one of them are timed with its weight in the hand.

    Returns:
        The trajectory, at rest at each end of each segment, and how it was made. The dwell of a gripper command is a
        trajectory segment of its own named after the command's kind ("grasp" or "move") that holds nothing, as the
        hand is closing or opening, and may touch what the path segment before it may.

    Raises:
        RetimingError: Waypoints that are malformed, outside the joint limits or not joined, a pose that the arm cannot
            hold, or a limit that no timing keeps; names the segment, the place and the limit.
        ConfigError: A payload's mass is not a number >= 0.
    """
    options = options or RetimingOptions()
    if not path.segments:
        raise RetimingError("the path has no segments; it needs at least one")
    loaded = _Loads(robot, payloads or {})
    pieces: list[np.ndarray] = []
    events: list[GripperEvent] = []
    stretches: list[TrajectorySegment] = []
    reports: list[SegmentReport] = []
    count = 0  # samples so far
    last: np.ndarray | None = None
    for segment in path.segments:
        q = _checked_waypoints(segment, last, limits, safety)
        if last is None:
            pieces.append(q[:1])
            count = 1
        start = count if stretches else 0
        last = q[-1]
        if np.any(q != q[0]):
            samples, report = time_segment(replace(segment, q=q), loaded(segment), limits, safety, options)
            reports.append(report)
            pieces.append(samples)
            count += len(samples)
            mass = None if segment.held is None else loaded.mass(segment.held)
            stretches.append(TrajectorySegment(segment.name, start, count, segment.held, segment.touching, mass))
        if segment.gripper is not None:
            start = count if stretches else 0
            dwell = _dwell(segment.gripper, options, robot.gripper)
            events.append(GripperEvent((count - 1) * SAMPLE_TIME, dwell, segment.gripper))
            rest = int(np.ceil(dwell / SAMPLE_TIME - 1e-6))
            pieces.append(np.repeat(q[-1:], rest, axis=0))
            count += rest
            stretches.append(TrajectorySegment(segment.gripper.kind, start, count, None, segment.touching))
    if count < 2:  # nothing moves and nothing is gripped: a trajectory has two samples at least
        assert last is not None
        pieces.append(last[None])
        first = path.segments[0]
        stretches.append(TrajectorySegment(first.name, 0, 2, first.held, first.touching))
    q = np.concatenate(pieces)
    padded = np.concatenate([q[:1], q, q[-1:]])
    trajectory = Trajectory(
        q=q,
        qd=(padded[2:] - padded[:-2]) / (2.0 * SAMPLE_TIME),
        qdd=(padded[2:] - 2.0 * q + padded[:-2]) / SAMPLE_TIME**2,
        gripper=tuple(events),
        segments=tuple(stretches),
    )
    return trajectory, RetimingReport(tuple(reports))


def shortest_moving_time(
    path: JointPath,
    robot: RobotModel,
    limits: RobotLimits,
    safety: SafetyLimits,
    options: RetimingOptions,
    payloads: Mapping[str, Payload] | None = None,
) -> float:
    """Shortest time in [s] of the smooth paths of all segments with unbounded jerk and torque rate.

    Arguments as for `retime_with_report`; the finer `options.grid`, the tighter.
    """
    loaded = _Loads(robot, payloads or {})
    moving = [s for s in path.segments if len(distinct_waypoints(np.asarray(s.q, float))) > 1]
    return sum(shortest_time(s, loaded(s), limits, safety, options) for s in moving)


class _Loads:
    """The robot with what each segment holds, made once for each thing."""

    def __init__(self, robot: RobotModel, payloads: Mapping[str, Payload]) -> None:
        self._robot, self._payloads = robot, payloads
        self._made: dict[str, RobotModel] = {}

    def mass(self, name: str) -> float | None:
        """What a thing weighs in [kg], where that is known."""
        return self._payloads[name].mass if name in self._payloads else None

    def __call__(self, segment: PathSegment) -> RobotModel:
        name = segment.held
        if name is None or name not in self._payloads:
            return self._robot
        if name not in self._made:
            self._made[name] = self._robot.with_payload(self._payloads[name])
        return self._made[name]


def _dwell(command: GripperCommand, options: RetimingOptions, gripper: GripperModel) -> float:
    """Time in [s] for a command: a slow gripper needs longer than usual for its whole stroke."""
    usual = options.grasp_dwell if command.kind == "grasp" else options.move_dwell
    return max(usual, round(gripper.full_stroke + STROKE_SLACK, 3))


def _checked_waypoints(
    segment: PathSegment, last: np.ndarray | None, limits: RobotLimits, safety: SafetyLimits
) -> np.ndarray:
    """Waypoints that begin exactly where the segment before ended, shape (m >= 1, 7); one where nothing moves."""
    q = np.array(segment.q, dtype=float)
    name = f"segment '{segment.name}'"
    if q.ndim != 2 or q.shape[1] != 7 or len(q) == 0:
        raise RetimingError(f"{name} has waypoints of shape {q.shape}; they need shape (n >= 1, 7)")
    if not np.all(np.isfinite(q)):
        row, joint = np.argwhere(~np.isfinite(q))[0]
        raise RetimingError(f"{name} is not finite at waypoint {row}, joint {joint + 1}")
    if not 0.0 < segment.speed_scale <= 1.0:
        raise RetimingError(f"{name} has speed_scale {segment.speed_scale}; it must be above 0 and at most 1")
    if last is not None:
        gap = np.abs(q[0] - last)
        if gap.max() > JOIN_TOLERANCE:
            joint = int(np.argmax(gap))
            raise RetimingError(
                f"{name} starts {gap.max():.4g} rad away from where the segment before it ends (joint {joint + 1}); "
                "begin it with that segment's last waypoint"
            )
        q[0] = last
    margin = np.minimum(q - limits.q_min, limits.q_max - q)
    if margin.min() < safety.joint_margin:
        row, joint = np.unravel_index(int(np.argmin(margin)), margin.shape)
        low, high = limits.q_min[joint] + safety.joint_margin, limits.q_max[joint] - safety.joint_margin
        raise RetimingError(
            f"{name} breaks joint_position at waypoint {row}: joint {joint + 1} is at {q[row, joint]:.4f} rad; "
            f"{low:.4f} to {high:.4f} rad is allowed with the margin of {safety.joint_margin} rad"
        )
    return q if len(distinct_waypoints(q)) > 1 else q[:1]
