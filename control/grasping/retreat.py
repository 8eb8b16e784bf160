"""How an object comes free of what it stands in or lies on: straight moves, found without regard to the hand.

Most things are lifted. What something keeps from rising, such as a bar behind two handles, is moved out sideways; what
stands in furniture leaves through the opening. The object may stay as close to its surroundings as it is at the start
(`Phase.RETREAT`); it is out where it keeps the distance of a carried object (`Phase.CARRY`).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from control.path_planning.collision_filter import Phase
from control.path_planning.planning_context import PlanningContext, straight_targets

LIFT = 0.06  # [m] straight up after a grasp, and straight down before a release
RISE = 0.005  # [m] off what carries the object, before it is moved sideways
OVER_FLOOR = 0.03  # [m] above a shelf on the way out of furniture
IN_FRONT = 0.12  # [m] in front of an opening where the object's centre is then
LONGEST = 0.45  # [m] of a move sideways
STEP = 0.01  # [m] between poses that are looked at
BEYOND = 0.02  # [m] that a move goes on after the object has come free
LAST = 0.04  # [m] of a last move towards the robot
GO_ON = 0.15  # [m] that it could still go then, upwards or towards the robot
SAME = np.cos(np.radians(0.5))  # cosine of the angle below which two directions are one
COMPASS = 8  # directions that are tried beside the object's own axes


@dataclass(frozen=True)
class WayOut:
    """Straight moves one after the other.

    Attributes:
        moves: Displacements in the world in [m], shape (k, 3).
    """

    moves: NDArray[np.float64]

    @property
    def length(self) -> float:
        """Of all moves in [m]."""
        return float(np.linalg.norm(self.moves, axis=1).sum())

    def targets(self, world_T_tool: np.ndarray) -> np.ndarray:
        """Poses of a tool (or object) along the way, shape (n, 4, 4), without the start (4, 4)."""
        out, start = [], world_T_tool
        for move in self.moves:
            out.append(straight_targets(start, move))
            start = out[-1][-1]
        return np.vstack(out)


def ways_out(context: PlanningContext) -> list[WayOut]:
    """Ways out for the subject, the shortest first; lifting alone wherever that is free."""
    pose = context.objects[str(context.subtask.subject)].pose
    up = WayOut(np.array([[0.0, 0.0, LIFT]]))
    inside = _through_opening(context, pose)
    if inside is not None and _free(context, pose, inside):
        return [inside]
    if _free(context, pose, up):
        return [up]
    found = []
    for direction in _directions(context, pose):
        way = _sideways(context, pose, direction)
        if way is not None:
            found.append(way)
    return sorted(found, key=lambda way: way.length) or [up]


def _free(context: PlanningContext, pose: np.ndarray, way: WayOut) -> bool:
    poses = way.targets(pose)
    return _goes(context, poses) and _open(context, poses[-1])


def _open(context: PlanningContext, pose: np.ndarray) -> bool:
    """Whether the object could go on from a pose, upwards or towards the robot: in a loop or a box it could not."""
    for direction in (np.array([0.0, 0.0, 1.0]), _inwards(context, pose)):
        ahead = straight_targets(pose, GO_ON * direction)
        if all(context.filter.object_clear(p, Phase.CARRY) for p in ahead):
            return True
    return False


def _directions(context: PlanningContext, pose: np.ndarray) -> list[np.ndarray]:
    """Level unit vectors: the object's own axes both ways, those of what stands fixed, and those of a compass.

    A slot may be turned by a degree against what was perceived in it, which is a finger's breadth at its end.
    """
    fixed = [context.objects[o.name].pose[:3, :3].T for o in context.twin.objects if not o.movable]
    own = pose[:3, :3].T
    angles = np.arange(COMPASS) * 2 * np.pi / COMPASS
    compass = np.array([[np.cos(a), np.sin(a), 0.0] for a in angles])
    out: list[np.ndarray] = []
    for axis in np.vstack([own, -own, *fixed, *(-f for f in fixed), compass]):
        level = np.array([axis[0], axis[1], 0.0])
        size = np.linalg.norm(level)
        if size > 0.9 and not any(level @ known / size > SAME for known in out):
            out.append(level / size)
    return out


def _sideways(context: PlanningContext, pose: np.ndarray, direction: np.ndarray) -> WayOut | None:
    """The shortest way in a direction, or None where something is in the way or it is too far.

    It ends `BEYOND` after the object has come free. What slides along a wall comes free of it only by a last move
    towards the robot, as soon as nothing is before it any more.
    """
    rise = np.array([0.0, 0.0, RISE])
    out, free_since = pose.copy(), None
    last = LAST * _inwards(context, pose)
    for length in np.arange(0.0, LONGEST + STEP / 2, STEP):
        out[:3, 3] = pose[:3, 3] + rise + length * direction
        if not context.filter.object_clear(out, Phase.RETREAT):
            return None
        if not context.filter.object_clear(out, Phase.CARRY):
            free_since = None
            back = straight_targets(out, last)
            if _goes(context, back) and _open(context, back[-1]):
                return WayOut(np.array([rise, length * direction, last]))
            continue
        free_since = length if free_since is None else free_since
        if length - free_since >= BEYOND and _open(context, out):
            return WayOut(np.array([rise, length * direction]))
    return None


def _goes(context: PlanningContext, poses: np.ndarray) -> bool:
    """Whether the object can be moved through poses (n, 4, 4) and is free at the last."""
    return context.filter.object_clear(poses[-1], Phase.CARRY) and all(
        context.filter.object_clear(p, Phase.RETREAT) for p in poses[:-1]
    )


def _inwards(context: PlanningContext, pose: np.ndarray) -> np.ndarray:
    """Level unit vector from a pose towards the robot, shape (3,)."""
    way = context.base_position - pose[:3, 3]
    way[2] = 0.0
    return way / max(float(np.linalg.norm(way)), 1e-9)


def _through_opening(context: PlanningContext, pose: np.ndarray) -> WayOut | None:
    """Out of the furniture that the object stands in, or None where it stands in none."""
    for compartment in context.twin.compartments:
        owner = context.objects[compartment.owner].pose
        local = owner[:3, :3].T @ (pose[:3, 3] - owner[:3, 3])
        if not ((local >= compartment.low) & (local <= compartment.high)).all():
            continue
        along = int(np.argmax(np.abs(compartment.outward)))
        edge = (compartment.low if compartment.outward[along] < 0 else compartment.high)[along]
        depth = abs(float(edge - local[along])) + IN_FRONT
        outward = owner[:3, :3] @ compartment.outward
        return WayOut(np.array([[0.0, 0.0, OVER_FLOOR], depth * outward]))
    return None
