"""Geometry for injected faults: what overlaps, where the hand can go, and motions that go on somewhere else.

Overlaps and distances come from MuJoCo itself, not from what the verdict measures with.
"""

import mujoco
import numpy as np

from benchmarks.motion.base_motions import Base, spliced
from control.errors import RetimingError
from control.retiming.retime import retime
from control.trajectory.samples import JointPath, PathSegment, Trajectory
from control.twin_model import ARM_BODIES, ARM_JOINTS, FINGER_BODIES, HAND_BODY, TABLE_BODY

ROBOT = (*ARM_BODIES, HAND_BODY, *FINGER_BODIES)
SPOTS = 300  # places on the table that are tried
ROOM = 0.12  # [m] about such a place


def go_on(base: Base, row: int, ways: list[np.ndarray]) -> Trajectory | None:
    """The motion with further ways, retimed from rest to rest, after one of its samples at rest; None if impossible."""
    path = JointPath(tuple(PathSegment(f"part{i}", q) for i, q in enumerate(ways)))
    try:
        extra = retime(path, base.robot, base.limits, base.safety)
    except RetimingError:
        return None
    return spliced(base.trajectory, row, row, extra.q, extra.qd, extra.qdd)


def overlaps(base: Base, q: np.ndarray) -> tuple[float, float]:
    """Deepest overlap in [m] within the robot, and of the robot with anything else, at joints q after the motion."""
    model, data = base.twin.model, mujoco.MjData(base.twin.model)
    data.qpos[:] = base.rollout.end
    data.qpos[[int(model.joint(name).qposadr[0]) for name in ARM_JOINTS]] = q
    mujoco.mj_forward(model, data)
    own = world = 0.0
    for contact in data.contact[: data.ncon]:
        names = {model.body(int(model.geom_bodyid[g])).name for g in contact.geom}
        if names <= set(ROBOT) and names != set(FINGER_BODIES):
            own = max(own, -float(contact.dist))
        elif names & set(ROBOT) and names != set(FINGER_BODIES):
            world = max(world, -float(contact.dist))
    return own, world


def gives_way(base: Base) -> bool:
    """Whether the thing is put on something that moves under a load, as the plate of a scale does."""
    model, target = base.twin.model, base.spec.primary.target
    if target is None or target not in base.cell.furniture:
        return False
    owner = model.body(target).id
    return any(int(model.body_rootid[int(model.jnt_bodyid[j])]) == owner for j in range(model.njnt)) and not any(
        joint.owner == target for joint in base.twin.joints
    )


def room_below(base: Base, name: str, row: int) -> float:
    """Height in [m] of an object's lowest point above the nearest thing below or beside it, the robot apart."""
    model, data = base.twin.model, mujoco.MjData(base.twin.model)
    data.qpos[:] = base.rollout.qpos[min(row // 2, len(base.rollout.qpos) - 1)]
    mujoco.mj_kinematics(model, data)
    body = model.body(name).id
    solid = (model.geom_contype | model.geom_conaffinity) != 0
    own = np.flatnonzero((model.geom_bodyid == body) & solid)
    robot = [model.body(n).id for n in ROBOT]
    others = np.flatnonzero((model.geom_bodyid != body) & solid & ~np.isin(model.geom_bodyid, robot))
    segment = np.zeros(6)
    return min(mujoco.mj_geomDistance(model, data, int(a), int(b), 0.2, segment) for a in own for b in others)


def hand_down(base: Base, spot: np.ndarray, height: float) -> np.ndarray | None:
    """Joints that bring the tool centre point, hand down, to a place (x, y) and height in the world in [m]."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = *spot, height
    return _solved(base, pose, base.trajectory.q[-1])


def lowered_hand(base: Base, q: np.ndarray, down: float) -> np.ndarray | None:
    """Joints near q with the hand lower by so much in [m]."""
    pose = base.cell.robot.world_T_base @ base.robot.tcp_pose(q)
    pose[2, 3] -= down
    return _solved(base, pose, q)


def _solved(base: Base, pose: np.ndarray, seed: np.ndarray) -> np.ndarray | None:
    found = base.arm.solve_ik(np.linalg.inv(base.cell.robot.world_T_base) @ pose[None], seed[None], per_pose=1)
    return found.q[0] if len(found.q) else None


def free_spot(base: Base, rng: np.random.Generator) -> np.ndarray | None:
    """A place (x, y) on the table with `ROOM` about it at the motion's end."""
    model, data = base.twin.model, mujoco.MjData(base.twin.model)
    data.qpos[:] = base.rollout.end
    mujoco.mj_kinematics(model, data)
    others = [
        g
        for g in range(model.ngeom)
        if (model.geom_contype[g] or model.geom_conaffinity[g])
        and model.body(int(model.geom_bodyid[g])).name not in (TABLE_BODY, *ROBOT)
    ]
    for _ in range(SPOTS):
        spot = rng.uniform((0.35, -0.35), (0.6, 0.35))
        apart = [np.linalg.norm(data.geom_xpos[g][:2] - spot) - model.geom_rbound[g] for g in others]
        if min(apart, default=1.0) > ROOM:
            return spot
    return None
