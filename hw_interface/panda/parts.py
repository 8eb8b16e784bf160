"""A trajectory in parts that each begin and end at rest: what a control box plays in one go. Needs numpy only.

Thresholds of collisions and loads can be told to the control box only between motions, and a gripper needs an unknown
time while the arm waits. So a trajectory is played part by part; where nothing rests, a part goes on.
"""

from dataclasses import dataclass

import numpy as np

from control.trajectory.samples import SAMPLE_TIME, GripperEvent, Trajectory

REST_SPEED, REST_ACCELERATION = 1e-6, 1e-3  # [rad/s], [rad/s^2]; as the check of a trajectory's ends


@dataclass(frozen=True)
class Part:
    """Samples start <= k <= stop, the arm at rest at both.

    Attributes:
        held: Whether something is in the hand in all or some of it.
        handling: Whether fingers or held object may touch something.
        load: Mass in the hand in [kg].
        gripper: Command to give at the end, before the next part, or None.
    """

    start: int
    stop: int
    held: bool
    handling: bool
    load: float
    gripper: GripperEvent | None


def parts_of(trajectory: Trajectory) -> tuple[Part, ...]:
    """The parts of a trajectory, in order; together they move exactly as it does.

    A cut is made where the arm rests at the border of two segments or at a gripper event; the dwell of an event stands
    between two parts. An event that is given while the arm moves cuts nothing: it is in `moving_events`.
    """
    last = len(trajectory.q) - 1
    rest = _resting(trajectory)
    cuts: dict[int, tuple[int, GripperEvent | None]] = {last: (last, None)}  # end of a part -> start of the next
    for segment in trajectory.segments:
        # The sample at which a segment comes to rest is its last one, so the next one begins with its movement.
        border = next((k for k in (segment.start - 1, segment.start) if 0 < k < last and rest[k]), None)
        if border is not None:
            cuts[border] = (border, None)
    for event in trajectory.gripper:
        given, over = _sample(event.time), min(last, _sample(event.time + event.dwell))
        if given <= last and rest[given : over + 1].all():
            cuts = {at: cut for at, cut in cuts.items() if not given < at <= over or at == last}
            cuts[min(given, last)] = (over, event)
    parts, start = [], 0
    for stop in sorted(cuts):
        following, event = cuts[stop]
        if stop > start or event is not None:
            parts.append(_part(trajectory, start, stop, event))
        start = max(start, following)
    return tuple(parts)


def moving_events(trajectory: Trajectory, parts: tuple[Part, ...]) -> tuple[GripperEvent, ...]:
    """Gripper events that no part ends with: the arm does not rest while they last."""
    ended_with = {id(p.gripper) for p in parts}
    return tuple(e for e in trajectory.gripper if id(e) not in ended_with)


def _part(trajectory: Trajectory, start: int, stop: int, event: GripperEvent | None) -> Part:
    # A segment that only shares its border sample with the part says nothing about it.
    inside = [s for s in trajectory.segments if s.start <= max(stop - 1, start) and s.stop > start + 1]
    holding = [s for s in inside if s.held is not None]
    return Part(
        start=start,
        stop=stop,
        held=bool(holding),
        handling=any(s.touching for s in inside),
        load=max((s.held_mass or 0.0 for s in holding), default=0.0),
        gripper=event,
    )


def _resting(trajectory: Trajectory) -> np.ndarray:
    """At which samples the arm stands still, bool, shape (n,)."""
    # Joint by joint in memory: the largest of seven numbers a row takes ten times as long.
    speed, acceleration = (np.abs(np.asfortranarray(x)).max(axis=1) for x in (trajectory.qd, trajectory.qdd))
    return (speed <= REST_SPEED) & (acceleration <= REST_ACCELERATION)


def _sample(time: float) -> int:
    return round(time / SAMPLE_TIME)
