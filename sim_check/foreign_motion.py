"""Motions of other people: what their gripper events mean for the things in the scene.

A file says when the gripper closes and opens, not around what. Whoever validates it names the objects that are
handled; from then on a closing is a grasp of the next one, and an opening lets it go.
"""

from collections.abc import Sequence
from dataclasses import replace

from control.errors import ConfigError
from control.trajectory import SAMPLE_TIME, Trajectory, TrajectorySegment


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
    stretches: list[TrajectorySegment] = []
    waiting = list(handles)
    last = len(trajectory.q)
    start, now = 0, held
    grasped: set[str] = set()

    def stretch(name: str, stop: int, holding: str | None) -> None:
        nonlocal start
        if stop > start:
            stretches.append(TrajectorySegment(name, start, stop, holding))
            start = stop

    for event in trajectory.gripper:
        at = min(last, round(event.time / SAMPLE_TIME))
        stretch("carry" if now else "reach", at, now)
        if event.command.kind != "grasp":
            now = None
        elif now is None and waiting:
            now = waiting[0] if len(handles) == 1 else waiting.pop(0)
            grasped.add(now)
            # What fingers close around is in the hand once they have had their time.
            stretch("grasp", min(last, at + max(1, round(event.dwell / SAMPLE_TIME))), None)
    stretch("carry" if now else "leave", last, now)
    missed = [name for name in handles if name not in grasped and name != held]
    if missed:
        raise ConfigError(
            f"the gripper never closes around '{missed[0]}': it grasps {len(grasped)} times in this motion; name "
            "objects in the order in which they are grasped, and those that are only touched under --touches"
        )
    return replace(trajectory, segments=tuple(stretches))
