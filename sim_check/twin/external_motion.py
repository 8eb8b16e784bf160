"""Motions of other people: what their gripper commands mean for the things in the scene.

A file says when the gripper closes and opens, not around what. Whoever validates it names the objects that are
handled; from then on a grasp is one of the next of them, and any other command lets it go.
"""

from collections.abc import Sequence
from dataclasses import replace

from control.errors import ConfigError
from control.trajectory.samples import SAMPLE_TIME, GripperCommand, JointPath, Trajectory, TrajectorySegment


class _Hand:
    """What is in the hand after each command.

    Args:
        handles: Objects in the order in which they are grasped; one name stands for every grasp.
        held: The object that is in the hand from the start, or None.
    """

    def __init__(self, handles: Sequence[str], held: str | None) -> None:
        self._names, self._waiting, self._grasped = tuple(handles), list(handles), set[str]()
        self.holds = self._first = held

    def told(self, command: GripperCommand) -> bool:
        """Take a command; returns whether it grasps one of the objects."""
        if command.kind != "grasp":
            self.holds = None
            return False
        if self.holds is not None or not self._waiting:
            return False
        self.holds = self._waiting[0] if len(self._names) == 1 else self._waiting.pop(0)
        self._grasped.add(self.holds)
        return True

    def refuse_missed(self) -> None:
        """Raise ConfigError when an object was named that was never grasped."""
        missed = [n for n in self._names if n not in self._grasped and n != self._first]
        if missed:
            raise ConfigError(
                f"the gripper never closes around '{missed[0]}': it grasps {len(self._grasped)} times in this motion; "
                "name objects in the order in which they are grasped, and those that are only touched under --touches"
            )


def path_with_handling(path: JointPath, handles: Sequence[str], held: str | None) -> JointPath:
    """The same waypoints with segments that say what is in the hand, so that its weight is counted in retiming.

    Args:
        path: Without objects in its segments; commands that are meant to hold something are grasps.
        handles, held: As in `with_handling`.

    Raises:
        ConfigError: An object is named that the gripper does not close around.
    """
    if not handles and held is None:
        return path
    hand, segments = _Hand(handles, held), []
    for segment in path.segments:
        segments.append(replace(segment, held=hand.holds))
        if segment.gripper is not None:
            hand.told(segment.gripper)
    hand.refuse_missed()
    return JointPath(tuple(segments))


def with_handling(trajectory: Trajectory, handles: Sequence[str], held: str | None) -> Trajectory:
    """The same samples with segments that say what is in the hand.

    Args:
        trajectory: Without objects in its segments; closings that are meant to hold something are grasps.
        handles: Objects in the order in which they are grasped; one name stands for every grasp.
        held: The object that is in the hand from the start, or None.

    Returns:
        A trajectory whose segments end where the gripper is told something, and say what is held; what may touch is
        left open. Nothing changes where no object is named.

    Raises:
        ConfigError: An object is named that the gripper does not close around.
    """
    if not handles and held is None:
        return trajectory
    hand = _Hand(handles, held)
    stretches: list[TrajectorySegment] = []
    last = len(trajectory.q)
    start = 0

    def stretch(name: str, stop: int, holding: str | None) -> None:
        nonlocal start
        if stop > start:
            stretches.append(TrajectorySegment(name, start, stop, holding))
            start = stop

    for event in trajectory.gripper:
        at = min(last, round(event.time / SAMPLE_TIME))
        stretch("carry" if hand.holds else "reach", at, hand.holds)
        if hand.told(event.command):
            # What fingers close around is in the hand once they have had their time.
            stretch("grasp", min(last, at + max(1, round(event.dwell / SAMPLE_TIME))), None)
    stretch("carry" if hand.holds else "leave", last, hand.holds)
    hand.refuse_missed()
    return replace(trajectory, segments=tuple(stretches))
