"""Ways to drive a joint by its handle: from the joint's kinematics and the handle's shape alone.

A hand takes the handle from many sides, by closing around it or by caging it loosely (a hook that cannot slip off
sideways), and goes along with it. The handle's path is given by the joint; how far the hand turns with it is free: a
share of a door's rotation, as wrists do not reach a full quarter turn. The door moves along in the geometric filter.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from control.collision_filter import JointAt, Phase
from control.grasps import pose
from control.handle_grasps import HandleGrasp, handle_grasps
from control.limits import REST_Q
from control.picking import BACK_OFF, MEDIUM, SLOW, SPARE_OPENING
from control.rotations import rotation_exp
from control.trajectory import GripperCommand, PathSegment
from control.twin_model import TwinJoint, TwinModel
from control.workbench import Workbench, path_length, straight_targets

SHARES = (0.5, 0.25, 0.75, 0.0, 1.0)  # of a hinge's rotation that the hand follows
DRIVE_STEP = 0.02  # [m] of the handle between waypoints
NARROW_SPARE = 0.010  # [m] that fingers open beyond a bar where they have to go between it and its door
CAGE = 0.008  # [m] beyond the bar that caging fingers stay open
HOOKED = 0.5  # least part of the handle's motion along the closing direction for a cage to pull
ROLL_EFFORT = 1.0  # per [rad] that a handle turns between the pads: it rolls there, and the door lags behind
CAGE_EFFORT = 0.5  # [rad] that a cage is worse than a grip
MOST_READY = 12
AT_ONCE = 8  # grasps that are taken along together


@dataclass(frozen=True)
class ReadyDrive:
    """A way to drive the joint that the arm can follow without touching anything but the handle.

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


@dataclass(frozen=True)
class JointMotion:
    """How a joint moves what hangs on it, in the world.

    Attributes:
        hinge: Whether it turns; else it slides.
        axis: Unit vector, shape (3,).
        anchor: Point on the axis in [m], shape (3,).
        start: Joint position in [rad] or [m] at which the hand takes hold.
        world_T_body: Pose of the moving body there, shape (4, 4).
    """

    hinge: bool
    axis: np.ndarray
    anchor: np.ndarray
    start: float
    world_T_body: np.ndarray

    @classmethod
    def of(cls, twin: TwinModel, joint: TwinJoint, position: float | None = None) -> "JointMotion":
        """Of a joint as it stands in a twin, or at another position in [rad] or [m]."""
        data, number = twin.start(), twin.model.joint(joint.name).id
        address = twin.model.jnt_qposadr[number]
        if position is not None:
            data.qpos[address] = position
            mujoco.mj_kinematics(twin.model, data)
            mujoco.mj_comPos(twin.model, data)
        body, start = data.body(joint.body), float(data.qpos[address])
        world_T_body = pose(body.xmat.reshape(3, 3).copy(), body.xpos.copy())
        hinge = twin.model.jnt_type[number] == mujoco.mjtJoint.mjJNT_HINGE
        return cls(bool(hinge), data.xaxis[number].copy(), data.xanchor[number].copy(), start, world_T_body)

    def carried(self, world_T_tool: np.ndarray, position: float, share: float = 1.0) -> np.ndarray:
        """A tool's pose (4, 4) when the joint has gone from the start to `position`, in [rad] or [m].

        The tool's point goes along with the body; its attitude turns by `share` of the joint's rotation.
        """
        way = position - self.start
        out = world_T_tool.copy()
        if not self.hinge:
            out[:3, 3] += self.axis * way
            return out
        out[:3, 3] = self.anchor + rotation_exp(self.axis * way) @ (world_T_tool[:3, 3] - self.anchor)
        out[:3, :3] = rotation_exp(self.axis * way * share) @ world_T_tool[:3, :3]
        return out

    def direction(self, point: np.ndarray) -> np.ndarray:
        """Unit vector in which a point (3,) of the body sets out as the joint position grows."""
        way = np.cross(self.axis, point - self.anchor) if self.hinge else self.axis
        return way / max(float(np.linalg.norm(way)), 1e-9)

    def lever(self, point: np.ndarray) -> float:
        """How far a point (3,) moves in [m] per [rad] or [m] of the joint."""
        return float(np.linalg.norm(np.cross(self.axis, point - self.anchor))) if self.hinge else 1.0


def ready_drives(
    bench: Workbench, joint: TwinJoint, goal: float, start: float | None = None, near: np.ndarray | None = None
) -> list[ReadyDrive]:
    """Up to `MOST_READY` ways to bring a joint to a position; least motion first.

    Args:
        bench: Surroundings of the search.
        joint: The subtask's joint.
        goal: Where it should stand in [rad] or [m].
        start: Where it stands in [rad] or [m]; as in the twin by default.
        near: Where the arm comes from in [rad], shape (7,); the start by default.
    """
    motion = JointMotion.of(bench.twin, joint, start)
    near = bench.start_q if near is None else near
    offered = handle_grasps(joint.handle, motion.world_T_body)
    bench.counts["grasps"] += len(offered)
    owners, solutions = bench.solve(np.array([g.world_T_tcp for g in offered]).reshape(-1, 4, 4))
    bench.counts["grasps_reachable"] += len(set(owners.tolist()))
    chosen = [offered[i] for i in owners]
    outwards, ok = bench.follow(
        solutions, [straight_targets(g.world_T_tcp, -BACK_OFF * g.world_T_tcp[:3, 2]) for g in chosen]
    )
    effort = [float(np.abs(q - near).max() + 0.2 * np.abs(q - REST_Q).max()) for q in solutions]
    out: list[tuple[float, ReadyDrive]] = []
    order = [int(i) for i in np.argsort(effort, kind="stable") if ok[i]]
    for first in range(0, len(order), AT_ONCE):
        free: list[tuple[int, float]] = []  # which solution, with which opening
        for i in order[first : first + AT_ONCE]:
            opening = _opening(bench, chosen[i], solutions[i], outwards[i], JointAt(motion.start))
            if opening is not None:
                free.append((i, opening))
        bench.counts["grasps_free"] += len(free)
        out += _taken_along(bench, motion, goal, near, chosen, solutions, outwards, free)
        if len(out) >= MOST_READY:
            break
    return [drive for _, drive in sorted(out, key=lambda row: row[0])]


def drive_segments(drive: ReadyDrive, joint: str, reach: np.ndarray, gripper_width: float) -> tuple[PathSegment, ...]:
    """Reach, take hold, drive, let go and leave.

    Args:
        drive: What follows the transit.
        joint: Name of the joint.
        reach: To the pre-grasp, shape (n, 7).
        gripper_width: Distance between the pads at the start in [m].
    """
    opens = abs(drive.opening - gripper_width) > 0.002
    hold = GripperCommand("grasp", drive.width) if drive.grip else GripperCommand("move", drive.width + CAGE)
    touching = ((joint, "fingers"),)
    return (
        PathSegment("reach", reach, GripperCommand("move", drive.opening) if opens else None),
        PathSegment("approach", drive.arrive, hold, None, touching, MEDIUM),
        PathSegment("drive", drive.along, GripperCommand("move", drive.opening), None, touching, SLOW),
        PathSegment("retreat", drive.leave, None, None, touching, MEDIUM),
    )


def _opening(bench: Workbench, grasp: HandleGrasp, q: np.ndarray, outwards: np.ndarray, at: JointAt) -> float | None:
    """The widest opening with which the hand can come to the handle, or None."""
    for opening in (bench.twin.gripper.opening, grasp.width + SPARE_OPENING, grasp.width + NARROW_SPARE):
        if (
            bench.filter.clear(q, Phase.GRASP, opening, at)
            and bench.filter.clear(outwards[-1], Phase.FREE, opening, at)
            and bench.filter.path_clear(outwards[:-1], Phase.GRASP, opening, at)
        ):
            return opening
    return None


def _taken_along(
    bench: Workbench,
    motion: JointMotion,
    goal: float,
    near: np.ndarray,
    grasps: list[HandleGrasp],
    solutions: np.ndarray,
    outwards: list[np.ndarray],
    free: list[tuple[int, float]],
) -> list[tuple[float, ReadyDrive]]:
    """Free ways along the joint's path for some grasps, in all shares of its rotation, with their efforts."""
    shares = SHARES if motion.hinge else (0.0,)
    rows = [(i, opening, share) for i, opening in free for share in shares]
    if not rows:
        return []
    reach = motion.lever(grasps[free[0][0]].world_T_tcp[:3, 3]) * abs(goal - motion.start)
    positions = np.linspace(motion.start, goal, max(3, int(np.ceil(reach / DRIVE_STEP)) + 1))
    targets = [
        np.array([motion.carried(grasps[i].world_T_tcp, p, share) for p in positions[1:]]) for i, _, share in rows
    ]
    along, ok = bench.follow(np.array([solutions[i] for i, _, _ in rows]), targets)
    leaving = [straight_targets(t[-1], -BACK_OFF * t[-1][:3, 2]) for t in targets]
    leaves, ok_leave = bench.follow(np.array([path[-1] for path in along]), leaving)
    bench.counts["drives_followed"] += int(np.sum(ok & ok_leave))
    out = []
    for n in np.flatnonzero(ok & ok_leave):
        i, opening, share = rows[n]
        rolled = (1.0 - share) * abs(goal - motion.start) if motion.hinge else 0.0
        if not _free_along(bench, along[n], positions[1:], leaves[n], grasps[i].width, opening):
            continue
        bench.counts["drives_free"] += 1
        path = np.vstack([solutions[i][None], along[n]])
        effort = float(np.abs(solutions[i] - near).max()) + path_length(path) + ROLL_EFFORT * rolled
        leave = np.vstack([path[-1:], leaves[n]])
        arrive = np.vstack([outwards[i][::-1], solutions[i][None]])
        sign = np.sign(goal - motion.start)
        for grip in (True, False):
            if not grip and not _hooked(motion, grasps[i].world_T_tcp, targets[n][-1], goal, sign):
                continue
            text = f"{grasps[i].text}, hand turns {share:.0%} of the way, {'grip' if grip else 'hook'}"
            drive = ReadyDrive(arrive, path, positions, leave, opening, grasps[i].width, grip, text)
            out.append((effort + (0.0 if grip else CAGE_EFFORT), drive))
    return out


def _free_along(
    bench: Workbench, along: np.ndarray, positions: np.ndarray, leave: np.ndarray, width: float, opening: float
) -> bool:
    """Whether the hand, the joint's body and the way out keep their distances; the end is looked at first."""
    check, at = bench.filter, JointAt(float(positions[-1]))
    for k in reversed(range(len(along))):
        if not check.clear(along[k], Phase.DRIVE, width, JointAt(float(positions[k]))):
            return False
    return (
        check.clear(along[-1], Phase.GRASP, opening, at)
        and check.clear(leave[-1], Phase.FREE, opening, at)
        and check.path_clear(leave[:-1], Phase.GRASP, opening, at)
    )


def _hooked(motion: JointMotion, first: np.ndarray, last: np.ndarray, goal: float, sign: float) -> bool:
    """Whether a finger stands behind the handle, seen along its motion, from start to end."""
    set_out = motion.direction(first[:3, 3])
    arrive = rotation_exp(motion.axis * (goal - motion.start)) @ set_out if motion.hinge else set_out
    return bool(min(abs(set_out @ first[:3, 1]), abs(arrive @ last[:3, 1])) >= HOOKED and sign != 0)
