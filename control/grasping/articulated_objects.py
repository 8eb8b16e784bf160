"""Ways to move an articulated object by its handle: from the joint's kinematics and the handle's shape alone.

A hand takes the handle from many sides, by closing around it or by caging it loosely (a hook that cannot slip off
sideways), and goes along with it. The handle's path is given by the joint; how far the hand turns with it is free: a
share of a door's rotation, as wrists do not reach a full quarter turn. The door moves along in the geometric filter.
"""

from dataclasses import dataclass

import numpy as np

from control.grasping.articulation import JointMotion
from control.grasping.handle_grasps import handle_grasps
from control.grasping.picking import BACK_OFF, MEDIUM, SLOW, SPARE_OPENING
from control.path_planning.collision_filter import JointAt, Phase
from control.path_planning.planning_context import PlanningContext, path_length, straight_targets
from control.robot.limits import REST_Q
from control.robot.rotations import rotation_exp
from control.trajectory.samples import FINGERS, GripperCommand, PathSegment
from control.twin_model import TwinJoint

SHARES = (0.5, 0.25, 0.75, 0.0, 1.0)  # of a hinge's rotation that the hand follows
HANDLE_STEP = 0.02  # [m] of the handle between waypoints
PRESS = 0.01  # share of a joint's range that it is pressed on at an end of it: 5 mm at a door's handle
NARROW_SPARE = 0.010  # [m] that fingers open beyond a bar where they have to go between it and its door
LEAVE = (BACK_OFF, 0.06, 0.04)  # [m] back from a handle that was let go; the least clears the bar with the fingertips
CAGE = 0.008  # [m] beyond the bar that caging fingers stay open
HOOKED = 0.5  # least part of the handle's motion along the closing direction for a cage to pull
ROLL_EFFORT = 1.0  # per [rad] that a handle turns between the pads: it rolls there, and the door lags behind
# Largest part of a bar's direction across the pads, sin(15 degrees): a bar that turns between them pries them apart,
# and then jams as they open.
ASKEW = 0.26
CAGE_EFFORT = 0.5  # [rad] that a cage is worse than a grip
MOST_READY = 12
AT_ONCE = 24  # grasps that are taken along together
ROUGH_STEPS = 5  # stations of a first look along the joint's path


ALONG_FROM_END = 2  # index from the end of the segment that moves the joint, in `handle_segments`


@dataclass(frozen=True)
class HandleMotion:
    """A motion of the joint by its handle that the arm can follow without touching anything but the handle.

    Attributes:
        arrive: From pre-grasp to the handle, shape (n, 7).
        along: From the handle where it is to where it should be, shape (m, 7).
        positions: Joint positions along that way in [rad] or [m], shape (m,).
        leave: From there outwards, shape (k, 7).
        opening: Distance between the pads on the way in and out in [m].
        width: The handle's width between the pads in [m].
        grip: Whether the fingers close around it; else they cage it.
        text: For people.
    """

    arrive: np.ndarray
    along: np.ndarray
    positions: np.ndarray
    leave: np.ndarray
    opening: float
    width: float
    grip: bool
    text: str


def pressed_home(joint: TwinJoint, goal: float) -> float:
    """A goal at an end of the joint's range, a little beyond it: the joint stops there, wherever it truly stands."""
    closed, opened = joint.closed, joint.opened
    share = joint.fraction(goal)
    beyond = PRESS if share > 1.0 - PRESS else -PRESS if share < PRESS else 0.0
    return goal + beyond * (opened - closed)


def handle_segments(move: HandleMotion, joint: str, reach: np.ndarray, gripper_width: float) -> tuple[PathSegment, ...]:
    """Reach, take hold, move the joint, let go and leave.

    Args:
        move: What follows the free path.
        joint: Name of the joint.
        reach: To the pre-grasp, shape (n, 7).
        gripper_width: Distance between the pads at the start in [m].
    """
    opens = abs(move.opening - gripper_width) > 0.002
    hold = GripperCommand("grasp", move.width) if move.grip else GripperCommand("move", move.width + CAGE)
    touching = ((joint, FINGERS),)
    return (
        PathSegment("reach", reach, GripperCommand("move", move.opening) if opens else None),
        PathSegment("approach", move.arrive, hold, None, touching, MEDIUM),
        PathSegment("drive", move.along, GripperCommand("move", move.opening), None, touching, SLOW),
        PathSegment("retreat", move.leave, None, None, touching, MEDIUM),
    )


def continued_moves(context: PlanningContext, joint: TwinJoint, goal: float, opening: float) -> list[HandleMotion]:
    """Ways to take the joint on from where it stands to a goal, the hand being at its handle already.

    Args:
        context: Surroundings; the arm's start is at the handle.
        joint: The subtask's joint.
        goal: Where it should stand in [rad] or [m].
        opening: Distance between the pads in [m] with which the handle is let go.
    """
    motion, width = JointMotion.of(context.twin, joint), 2 * joint.handle.half_width
    tool, q = context.filter.tcp_pose(context.start_q), context.start_q
    reach = motion.lever(tool[:3, 3]) * abs(goal - motion.start)
    positions = np.linspace(motion.start, goal, max(3, int(np.ceil(reach / HANDLE_STEP)) + 1))
    out = []
    for share in SHARES if motion.hinge else (0.0,):
        targets = motion.carried_all(tool[None], positions[1:], np.array([share]))
        along, ok = context.follow(q[None], list(targets))
        leaves, far_enough = ways_off(context, along, [targets[0][-1]])
        if not (ok[0] and far_enough[0]) or not free_along(context, along[0], positions[1:], leaves[0], width, opening):
            continue
        path = np.vstack([q[None], along[0]])
        leave = np.vstack([path[-1:], leaves[0]])
        out.append(HandleMotion(q[None], path, positions, leave, opening, width, True, f"on, turning {share:.0%}"))
    return sorted(out, key=lambda move: path_length(move.along))


_Row = tuple[int, float]  # which grasp (and solution), share of the rotation


class Holds:
    """Holds of a joint's handle that the arm reaches, and how far each of them can be taken along.

    Args:
        context: Surroundings of the search.
        joint: The subtask's joint.
        goal: Where it should stand in [rad] or [m].
        start: Where it stands in [rad] or [m]; as in the twin by default.
        near: Where the arm comes from in [rad], shape (7,); the start by default.

    Attributes:
        stations: Joint positions on the way at which a hold may end, in [rad] or [m], shape (ROUGH_STEPS,); the last is
            the goal.
    """

    def __init__(
        self,
        context: PlanningContext,
        joint: TwinJoint,
        goal: float,
        start: float | None = None,
        near: np.ndarray | None = None,
    ) -> None:
        self._bench = context
        self._motion = motion = JointMotion.of(context.twin, joint, start)
        self._near = context.start_q if near is None else near
        self._bar = motion.world_T_body[:3, :3] @ joint.handle.axis
        goal = pressed_home(joint, goal)
        self.stations = motion.start + (goal - motion.start) * np.arange(1, ROUGH_STEPS + 1) / ROUGH_STEPS
        offered = handle_grasps(joint.handle, motion.world_T_body)
        context.counts["grasps"] += len(offered)
        owners, self._solutions = context.solve(np.array([g.world_T_tcp for g in offered]).reshape(-1, 4, 4))
        context.counts["grasps_reachable"] += len(set(owners.tolist()))
        self._grasps = [offered[i] for i in owners]
        self._outwards, ok = context.follow(
            self._solutions, [straight_targets(g.world_T_tcp, -BACK_OFF * g.world_T_tcp[:3, 2]) for g in self._grasps]
        )
        effort = [float(np.abs(q - self._near).max() + 0.2 * np.abs(q - REST_Q).max()) for q in self._solutions]
        self._order = [int(i) for i in np.argsort(effort, kind="stable") if ok[i]]
        self._passed: dict[_Row, int] = {}  # stations that a hold comes by, in a first look

    @property
    def furthest(self) -> int:
        """Number of stations that the best of the holds looked at so far comes by."""
        return max(self._passed.values(), default=0)

    def ready(self, stations: int = ROUGH_STEPS) -> list[HandleMotion]:
        """Up to `MOST_READY` ways to bring the joint to a station, the goal by default; least motion first."""
        shares = SHARES if self._motion.hinge else (0.0,)
        out: list[tuple[float, HandleMotion]] = []
        for first in range(0, len(self._order), AT_ONCE):
            rows = [(i, share) for i in self._order[first : first + AT_ONCE] for share in shares]
            self._look_at([row for row in rows if row not in self._passed])
            promising = [row for row in rows if self._passed[row] >= stations]
            self._bench.counts["drives_rough"] += len(promising)
            out += self._taken_along(self._free(promising), float(self.stations[stations - 1]))
            if len(out) >= MOST_READY:
                break
        return [move for _, move in sorted(out, key=lambda row: row[0])]

    def _look_at(self, rows: list[_Row]) -> None:
        """See how many stations some holds come by, in a few large steps; few of them come by all."""
        if not rows:
            return
        context = self._bench
        targets = self._targets(rows, self.stations)
        askew = self._askew(targets, self.stations)
        q = np.array([self._solutions[i] for i, _ in rows])
        left = np.arange(len(rows))
        context.counts["drives_tried"] += len(rows)
        self._passed |= dict.fromkeys(rows, 0)
        for k, position in enumerate(self.stations):
            along, ok = context.follow(q[left], list(targets[left, k : k + 1]), rough=True)
            at, on = JointAt(float(position)), []
            for n in np.flatnonzero(ok):
                row = rows[left[n]]
                fits = askew[left[n], k] <= ASKEW
                if fits and context.filter.clear(along[n][0], Phase.ARTICULATE, self._grasps[row[0]].width, at):
                    q[left[n]] = along[n][0]
                    self._passed[row] = k + 1
                    on.append(left[n])
            left = np.array(on, int)
            if not len(left):
                return

    def _free(self, rows: list[_Row]) -> list[tuple[int, float, float]]:
        """Those to which the hand can come: index, share, and the widest opening with which it can."""
        openings = {i: self._opening(i) for i in dict.fromkeys(i for i, _ in rows)}
        self._bench.counts["grasps_free"] += sum(o is not None for o in openings.values())
        return [(i, share, opening) for i, share in rows if (opening := openings[i]) is not None]

    def _taken_along(self, rows: list[tuple[int, float, float]], goal: float) -> list[tuple[float, HandleMotion]]:
        """Free ways along the joint's path and out, with their efforts."""
        if not rows:
            return []
        context, motion = self._bench, self._motion
        reach = motion.lever(self._grasps[rows[0][0]].world_T_tcp[:3, 3]) * abs(goal - motion.start)
        positions = np.linspace(motion.start, goal, max(3, int(np.ceil(reach / HANDLE_STEP)) + 1))
        targets = self._targets([(i, share) for i, share, _ in rows], positions[1:])
        along, ok = context.follow(np.array([self._solutions[i] for i, _, _ in rows]), list(targets))
        leaves, ok_leave = ways_off(context, along, [t[-1] for t in targets])
        context.counts["drives_followed"] += int(np.sum(ok & ok_leave))
        out = []
        for n in np.flatnonzero(ok & ok_leave):
            i, share, opening = rows[n]
            grasp, q = self._grasps[i], self._solutions[i]
            if not free_along(context, along[n], positions[1:], leaves[n], grasp.width, opening):
                continue
            context.counts["drives_free"] += 1
            rolled = (1.0 - share) * abs(goal - motion.start) if motion.hinge else 0.0
            path = np.vstack([q[None], along[n]])
            effort = float(np.abs(q - self._near).max()) + path_length(path) + ROLL_EFFORT * rolled
            leave = np.vstack([path[-1:], leaves[n]])
            arrive = np.vstack([self._outwards[i][::-1], q[None]])
            for grip in (True, False):
                if not grip and not _hooked(motion, grasp.world_T_tcp, targets[n][-1], goal):
                    continue
                text = f"{grasp.text}, hand turns {share:.0%} of the way, {'grip' if grip else 'hook'}"
                move = HandleMotion(arrive, path, positions, leave, opening, grasp.width, grip, text)
                out.append((effort + (0.0 if grip else CAGE_EFFORT), move))
        return out

    def _targets(self, rows: list[_Row], positions: np.ndarray) -> np.ndarray:
        tools = np.array([self._grasps[i].world_T_tcp for i, _ in rows])
        return self._motion.carried_all(tools, positions, np.array([share for _, share in rows]))

    def _askew(self, targets: np.ndarray, positions: np.ndarray) -> np.ndarray:
        """Part of the bar's direction that lies across the pads, 0..1.

        Args:
            targets: Poses of the tool, shape (rows, n, 4, 4).
            positions: Of the joint with them in [rad] or [m], shape (n,).

        Returns:
            Shape (rows, n).
        """
        bars = self._motion.turned(self._bar, positions)
        return np.abs(np.einsum("rni,ni->rn", targets[:, :, :3, 1], bars))

    def _opening(self, i: int) -> float | None:
        """The widest opening with which the hand can come to a handle, or None."""
        check, at = self._bench.filter, JointAt(self._motion.start)
        q, outwards, width = self._solutions[i], self._outwards[i], self._grasps[i].width
        for opening in (self._bench.twin.gripper.opening, width + SPARE_OPENING, width + NARROW_SPARE):
            if (
                check.clear(q, Phase.GRASP, opening, at)
                and check.clear(outwards[-1], Phase.FREE, opening, at)
                and check.path_clear(outwards[:-1], Phase.GRASP, opening, at)
            ):
                return opening
        return None


def ways_off(
    context: PlanningContext, along: list[np.ndarray], tools: list[np.ndarray]
) -> tuple[list[np.ndarray], np.ndarray]:
    """Back from the handle where the way along it ends, as far as the arm comes; whether it comes far enough.

    Args:
        context: Surroundings of the search.
        along: Ways along the handle, n arrays of shape (k, 7).
        tools: Poses of the tool at their ends, n arrays of shape (4, 4).
    """
    leaves: list[np.ndarray] = [path[-1:] for path in along]
    ok = np.zeros(len(along), bool)
    for distance in LEAVE:
        rest = np.flatnonzero(~ok)
        ends = np.array([along[n][-1] for n in rest]).reshape(-1, 7)
        ways = [straight_targets(tools[n], -distance * tools[n][:3, 2]) for n in rest]
        found, reached = context.follow(ends, ways)
        for n, leave in zip(rest[reached], (found[k] for k in np.flatnonzero(reached)), strict=True):
            leaves[n], ok[n] = leave, True
    return leaves, ok


def free_along(
    context: PlanningContext, along: np.ndarray, positions: np.ndarray, leave: np.ndarray, width: float, opening: float
) -> bool:
    """Whether the hand, the joint's body and the way out keep their distances; the end is looked at first."""
    check, at = context.filter, JointAt(float(positions[-1]))
    for k in reversed(range(len(along))):
        if not check.clear(along[k], Phase.ARTICULATE, width, JointAt(float(positions[k]))):
            return False
    return (
        check.clear(along[-1], Phase.GRASP, opening, at)
        and check.clear(leave[-1], Phase.FREE, opening, at)
        and check.path_clear(leave[:-1], Phase.GRASP, opening, at)
    )


def _hooked(motion: JointMotion, first: np.ndarray, last: np.ndarray, goal: float) -> bool:
    """Whether a finger stands behind the handle, seen along its motion, from start to end."""
    set_out = motion.direction(first[:3, 3])
    arrive = rotation_exp(motion.axis * (goal - motion.start)) @ set_out if motion.hinge else set_out
    return bool(min(abs(set_out @ first[:3, 1]), abs(arrive @ last[:3, 1])) >= HOOKED and goal != motion.start)
