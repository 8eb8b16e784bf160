"""Motions of other people: what their gripper events mean for the things in the scene.

A file says when the gripper closes and opens, not around what. Whoever validates it names the objects that are
handled; from then on a closing is a grasp of the next one, and an opening lets it go.
"""

from collections.abc import Sequence
from dataclasses import replace

from control.errors import ConfigError
from control.trajectory import SAMPLE_TIME, GripperCommand, GripperEvent, Trajectory, TrajectorySegment

SAME_WIDTH = 1e-4  # [m]: a command that is nearer than this to the one before it closes nothing


def with_handling(
    trajectory: Trajectory, handles: Sequence[str], held: str | None, start_width: float, grasp_force: float
) -> Trajectory:
    """The same samples with segments that say what the fingers are at, and closings that grasp.

    Args:
        trajectory: Without objects in its segments.
        handles: Objects in the order in which they are grasped; one name stands for every grasp.
        held: The object that is in the hand from the start, or None.
        start_width: Distance between the pads at the start in [m].
        grasp_force: In [N], for closings of which the file gives no force.

    Returns:
        A trajectory whose segments end where the gripper is told something, and say what is held; what may touch is
        left open. Nothing changes where no object is named.

    Raises:
        ConfigError: An object is named that the gripper does not close around.
    """
    if not handles and held is None:
        return trajectory
    events: list[GripperEvent] = []
    stretches: list[TrajectorySegment] = []
    waiting = list(handles)
    last = len(trajectory.q)
    start, width, now = 0, start_width, held
    grasped: set[str] = set()

    def stretch(name: str, stop: int, holding: str | None) -> None:
        nonlocal start
        if stop > start:
            stretches.append(TrajectorySegment(name, start, stop, holding))
            start = stop

    for event in trajectory.gripper:
        at = min(last, round(event.time / SAMPLE_TIME))
        stretch("carry" if now else "reach", at, now)
        command = event.command
        closing = command.kind == "grasp" or command.width < width - SAME_WIDTH
        if closing and now is None and waiting:
            now = waiting[0] if len(handles) == 1 else waiting.pop(0)
            grasped.add(now)
            force = command.force if command.kind == "grasp" else grasp_force
            event = replace(event, command=GripperCommand("grasp", command.width, force))
            # What fingers close around is in the hand once they have had their time.
            stretch("grasp", min(last, at + max(1, round(event.dwell / SAMPLE_TIME))), None)
        elif not closing:
            now = None
        events.append(event)
        width = command.width
    stretch("carry" if now else "leave", last, now)
    missed = [name for name in handles if name not in grasped and name != held]
    if missed:
        raise ConfigError(
            f"the gripper never closes around '{missed[0]}': it closes {len(grasped)} times in this file; name objects "
            "in the order in which they are grasped, and those that are only touched under --touches"
        )
    return replace(trajectory, gripper=tuple(events), segments=tuple(stretches))
