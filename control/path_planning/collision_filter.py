"""Which arm configurations keep their distance: a geometric filter that is run before any simulation.

The distance of each pair of geoms that matters is held against the clearance of the safety table for what the two
bodies are. One configuration costs about 60 us, a thousandth of simulating a motion.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum

import mujoco
import numpy as np
from numpy.typing import NDArray

from control.safety.limits import SafetyLimits
from control.twin_model import (
    ARM_BODIES,
    ARM_JOINTS,
    FINGER_BODIES,
    FINGER_JOINTS,
    HAND_BODY,
    TCP_SITE,
    TwinModel,
)

PLANNING_MARGIN = 0.003  # [m] on top of the judged clearances: what smoothing, tracking and sampling may eat
# [m] more between hand and door or handle while the hand moves a joint: loaded servos and doors lag
ARTICULATION_MARGIN = 0.006
NEAR_MARGIN = 0.001  # [m], the same for the last stretch to a grasp between close walls: slow, short and straight
SELF_TOLERANCE = 0.001  # [m] between what is planned and what is judged of the robot's own parts
HAND_TO_GRASPED = 0.004  # [m] between the hand (not its fingers) and the object that it grasps
PRESSED = 0.006  # [m] that an object may seem to overlap what carries it: errors of two perceived heights
FEW = 12  # pairs whose exact distances cost less than looking at their boxes
BOX_SLACK = 1e-4  # [m] beyond a limit within which boxes alone do not decide: more than exact distances are off by
IGNORE = -1.0  # [m], a threshold that no pair falls below


class Phase(IntEnum):
    """What the hand is doing, which decides who may be close to whom."""

    FREE = 0  # nothing in the hand, everything is an obstacle
    GRASP = 1  # fingers around the object, which stands on its own
    CARRY = 2  # the object moves with the hand, away from everything
    CONTACT = 3  # the object moves with the hand and may touch what carries it
    ARTICULATE = 4  # fingers at the handle of a joint, which moves with the hand
    RETREAT = 5  # the object moves with the hand, out of what is close to it where it stands


class _Kind(IntEnum):
    WORLD = 0
    ARM = 1
    FINGER = 2
    OBJECT = 3
    BASE = 4  # links that cannot be moved away from the mounting
    SUPPORT = 5
    PANEL = 6  # what moves with the joint, its handle apart


_OUTSIDE = (_Kind.WORLD, _Kind.SUPPORT)
_LACKS = {"arm": _Kind.ARM, "finger": _Kind.FINGER, "held": _Kind.OBJECT}
PARTS = ("self", "arm", "finger", "held")  # whose distances are told apart


@dataclass(frozen=True)
class Held:
    """An object that moves with the hand.

    Attributes:
        tcp_T_object: Pose of the object's body in the frame of the tool centre point, shape (4, 4).
    """

    tcp_T_object: NDArray[np.float64]


@dataclass(frozen=True)
class JointAt:
    """The handled joint at a position.

    Attributes:
        position: In [rad] or [m].
    """

    position: float


ObjectAt = Held | JointAt | np.ndarray | None


class CollisionFilter:
    """Distances of arm, fingers and one handled object from everything else.

    Pairs of geoms whose bounding spheres are apart by more than their clearance cost one row of a numpy expression;
    for the few others MuJoCo computes the exact distance. (Contacts with margins would be no substitute: between boxes
    they are missed now and then.)

    Args:
        twin: Where to look.
        safety: Clearances.
        subject: Name of the handled object or joint, or None.
        supports: Names of bodies that may touch the subject in `Phase.CONTACT`.
        margin: Extra distance in [m] beyond the safety table's clearances.
        others: Objects that may be handled beside the subject: like it they are no obstacles in `Phase.GRASP`.

    Attributes:
        checks: Configurations looked at so far.
        rejected_by: How often each body was what a configuration came too close to.
    """

    def __init__(
        self,
        twin: TwinModel,
        safety: SafetyLimits,
        subject: str | None = None,
        supports: Iterable[str] = (),
        margin: float = PLANNING_MARGIN,
        others: Iterable[str] = (),
    ) -> None:
        model = twin.model
        self.model, self._data = model, mujoco.MjData(model)
        self._qpos0, self._start_q = np.array(twin.qpos), np.asarray(twin.q, float)
        self.subject = subject
        self.checks = 0
        self.rejected_by: Counter[str] = Counter()
        self._arm = [int(model.joint(n).qposadr[0]) for n in ARM_JOINTS]
        self._fingers = [int(model.joint(n).qposadr[0]) for n in FINGER_JOINTS]
        self._tcp = model.site(TCP_SITE).id
        joint = twin.joint(subject) if subject else None
        self._address = free_joint_address(model, subject) if subject and joint is None else None
        self._joint = int(model.joint(joint.name).qposadr[0]) if joint else None
        self._segment = np.zeros(6)  # where mj_geomDistance leaves the nearest points
        kind = _geom_kinds(twin, subject, frozenset(supports))
        for name in others:
            kind[_geom_kinds(twin, name, frozenset()) == _Kind.OBJECT] = _Kind.OBJECT
        table = _thresholds(safety, margin)
        pairs = _pairs(model, kind, table)
        self._kind = kind
        self._by_phase = [PairSet(model, pairs, table[phase][kind[pairs[:, 0]], kind[pairs[:, 1]]]) for phase in Phase]
        self._object_alone = [pairs.of_kinds(kind, _Kind.OBJECT, _OUTSIDE) for pairs in self._by_phase]
        self._relax_start(twin)

    def tcp_pose(self, q: np.ndarray) -> np.ndarray:
        """Pose of the tool centre point in the world at joints q [rad], shape (4, 4)."""
        self._data.qpos[self._arm] = q
        mujoco.mj_kinematics(self.model, self._data)
        return self._site_pose()

    def clear(self, q: np.ndarray, phase: Phase, width: float, object_at: ObjectAt = None) -> bool:
        """Whether one configuration keeps all distances; counts the body in the way if not.

        Args:
            q: Arm joints in [rad], shape (7,).
            phase: What the hand is doing.
            width: Distance between the pads in [m].
            object_at: Where the subject is: with the hand, at a pose (4, 4), at a joint position, or None where the
                twin has it.
        """
        self._place(q, width, object_at)
        self.checks += 1
        pairs = self._by_phase[phase]
        for i in pairs.near(self._data, prune=True).tolist():
            if self._distance(pairs, i) < pairs.limit[i]:
                self.rejected_by[self._outer_body(*pairs.geoms[i])] += 1
                return False
        return True

    def object_clear(self, world_T_object: np.ndarray, phase: Phase) -> bool:
        """Whether the handled object alone keeps its distances from the world at a pose (4, 4), robot left out."""
        self._place(self._start_q, 0.0, world_T_object)
        self.checks += 1
        pairs, own = self._by_phase[phase], self._object_alone[phase]
        return all(self._distance(pairs, i) >= pairs.limit[i] for i in pairs.near(self._data, prune=True) if own[i])

    def path_clear(self, path: np.ndarray, phase: Phase, width: float, object_at: ObjectAt = None) -> bool:
        """Whether all configurations of a path, shape (n, 7), keep all distances; a coarse selection comes first."""
        coarse = np.arange(0, len(path), 4)
        order = np.concatenate([coarse, np.setdiff1d(np.arange(len(path)), coarse)])
        return all(self.clear(path[i], phase, width, object_at) for i in order)

    def pairs(self, phase: Phase) -> "PairSet":
        """The pairs of geoms that have to keep a distance in a phase, with those distances."""
        return self._by_phase[phase]

    def part(self, a: int, b: int) -> str | None:
        """Whose distance a pair of geoms is about: one of `PARTS`, or None where the world is not concerned."""
        kinds = self._kind[[a, b]].tolist()
        if all(k in (_Kind.ARM, _Kind.FINGER, _Kind.BASE) for k in kinds):
            return "self"
        if not any(k in (_Kind.WORLD, _Kind.SUPPORT, _Kind.PANEL) for k in kinds):
            return None
        return next(n for n, k in _LACKS.items() if k in kinds or (k == _Kind.ARM and _Kind.BASE in kinds))

    def bodies(self, a: int, b: int) -> tuple[str, str]:
        """Names of the bodies of two geoms, the one outside (neither robot nor handled object) last."""
        outer = self._outer_body(a, b)
        names = [body_name(self.model, int(self.model.geom_bodyid[g])) for g in (a, b)]
        return (names[1], outer) if names[0] == outer else (names[0], outer)

    def _distance(self, pairs: "PairSet", i: int) -> float:
        a, b = pairs.pair[i]
        reach = max(float(pairs.limit[i]), 0.0) + 0.001
        return float(mujoco.mj_geomDistance(self.model, self._data, a, b, reach, self._segment))

    def _place(self, q: np.ndarray, width: float, object_at: ObjectAt) -> None:
        data = self._data
        data.qpos[:] = self._qpos0
        data.qpos[self._arm] = q
        data.qpos[self._fingers] = width / 2
        if isinstance(object_at, JointAt):
            data.qpos[self._joint] = object_at.position
        elif object_at is not None and self._address is not None:
            pose = object_at
            if isinstance(object_at, Held):
                mujoco.mj_kinematics(self.model, data)
                pose = self._site_pose() @ object_at.tcp_T_object
            write_free_pose(data.qpos, self._address, np.asarray(pose))
        mujoco.mj_kinematics(self.model, data)

    def _site_pose(self) -> np.ndarray:
        pose = np.eye(4)
        pose[:3, :3] = self._data.site_xmat[self._tcp].reshape(3, 3)
        pose[:3, 3] = self._data.site_xpos[self._tcp]
        return pose

    def _relax_start(self, twin: TwinModel) -> None:
        """Pairs that start inside their clearance may stay as close as they are, so that the arm can leave.

        What the object stands in counts on its way out alone, unless the hand has it already.
        """
        self._place(twin.q, twin.gripper_width, None)
        for phase in (Phase.FREE, Phase.CARRY, Phase.RETREAT):
            pairs, own = self._by_phase[phase], self._object_alone[phase]
            for i in pairs.near(self._data):
                if phase != Phase.RETREAT and own[i] and twin.held is None:
                    continue
                pairs.limit[i] = min(pairs.limit[i], self._distance(pairs, i) - SELF_TOLERANCE)

    def _outer_body(self, a: int, b: int) -> str:
        """Of a pair, the body that is neither robot nor handled object where there is one."""
        outer = a if self._kind[a] in (_Kind.WORLD, _Kind.SUPPORT) else b
        if _Kind.PANEL in self._kind[[a, b]] and self._kind[outer] not in (_Kind.WORLD, _Kind.SUPPORT):
            outer = a if self._kind[a] == _Kind.PANEL else b
        return body_name(self.model, int(self.model.geom_bodyid[outer]))


class PairSet:
    """Pairs of geoms with the distance that they must keep.

    Args:
        model: The twin's model.
        pairs: Indices of geoms, shape (m, 2); where one of them is a plane it is the first.
        limit: Least distance of each pair in [m], shape (m,); pairs with `IGNORE` are left out.

    Attributes:
        geoms: Indices, shape (n, 2).
        pair: The same as plain numbers.
        limit: Least distance in [m], shape (n,).
    """

    def __init__(self, model: mujoco.MjModel, pairs: np.ndarray, limit: np.ndarray) -> None:
        keep = limit > IGNORE
        self.geoms, self.limit = pairs[keep], limit[keep].copy()
        self.pair: list[tuple[int, int]] = [(int(a), int(b)) for a, b in self.geoms]
        self._first, self._second = (np.ascontiguousarray(column) for column in self.geoms.T)
        plane = model.geom_type[self._first] == mujoco.mjtGeom.mjGEOM_PLANE
        self._plane = np.flatnonzero(plane)
        self._radius = np.where(plane, 0.0, model.geom_rbound[self._first]) + model.geom_rbound[self._second]
        self._bound = model.geom_rbound.copy()
        self._bound[model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE] = np.inf  # its box means nothing
        self._box_at, self._box_half = model.geom_aabb[:, :3].copy(), model.geom_aabb[:, 3:].copy()

    def of_kinds(self, kind: np.ndarray, one: int, others: tuple[int, ...]) -> np.ndarray:
        """Whether one geom of a pair is of one kind and the other of some others, shape (n,)."""
        a, b = kind[self.geoms[:, 0]], kind[self.geoms[:, 1]]
        return ((a == one) & np.isin(b, others)) | ((b == one) & np.isin(a, others))

    def near(self, data: mujoco.MjData, prune: bool = False, reach: float | None = None) -> np.ndarray:
        """Indices of pairs whose bounding spheres come within their limit, nearest first.

        Args:
            data: With up-to-date kinematics.
            prune: Leave out pairs whose boxes already keep them apart by more than their limit.
            reach: Look for pairs within this distance in [m] as well, where their limit is less.
        """
        limit = self.limit if reach is None else np.maximum(self.limit, reach)
        at = data.geom_xpos
        offset = at.take(self._second, axis=0) - at.take(self._first, axis=0)
        between = np.sqrt(np.einsum("ij,ij->i", offset, offset))
        if len(self._plane):
            rows = self._plane
            normal = data.geom_xmat[self._first[rows]][:, [2, 5, 8]]
            between[rows] = np.einsum("ij,ij->i", offset[rows], normal)
        gap = between - self._radius - limit
        rows = np.flatnonzero(gap < 0.0)
        rows = rows[np.argsort(gap[rows], kind="stable")]
        if prune and len(rows) > FEW:
            a, b = self._first[rows], self._second[rows]
            least = np.maximum(self._box_to_sphere(data, a, b), self._box_to_sphere(data, b, a))
            rows = rows[least < limit[rows] + BOX_SLACK]
        return rows

    def _box_to_sphere(self, data: mujoco.MjData, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Distance in [m] of the boxes of geoms `a` from the bounding spheres of geoms `b`: their least distance."""
        offset = data.geom_xpos[b] - data.geom_xpos[a]
        local = np.einsum("nji,nj->ni", data.geom_xmat[a].reshape(-1, 3, 3), offset)
        outside = np.maximum(np.abs(local - self._box_at[a]) - self._box_half[a], 0.0)
        return np.sqrt(np.einsum("ij,ij->i", outside, outside)) - self._bound[b]


def body_name(model: mujoco.MjModel, body: int) -> str:
    """Name of a body; that of the nearest named ancestor where it has none."""
    while body and not model.body(body).name:
        body = int(model.body_parentid[body])
    return model.body(body).name


def free_joint_address(model: mujoco.MjModel, name: str) -> int | None:
    """Where the free joint of a body starts in qpos, or None when the body is fixed."""
    body = model.body(name)
    if model.body_dofnum[body.id] != 6:
        return None
    return int(model.jnt_qposadr[model.body_jntadr[body.id]])


def write_free_pose(qpos: np.ndarray, address: int, pose: np.ndarray) -> None:
    """Write a pose (4, 4) into the seven numbers of a free joint."""
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(pose[:3, :3]).ravel())
    qpos[address : address + 3] = pose[:3, 3]
    qpos[address + 3 : address + 7] = quat


def subtree_root(model: mujoco.MjModel, body: int) -> int:
    """The ancestor of a body that hangs at the world itself."""
    while model.body_parentid[body]:
        body = int(model.body_parentid[body])
    return body


def _geom_kinds(twin: TwinModel, subject: str | None, supports: frozenset[str]) -> np.ndarray:
    model = twin.model
    doors = {j.body for j in twin.joints}
    kinds = np.zeros(model.ngeom, int)
    base, arm = {*ARM_BODIES[:2]}, {*ARM_BODIES[2:], HAND_BODY}
    for geom in range(model.ngeom):
        body = int(model.geom_bodyid[geom])
        name = body_name(model, body)
        if name in arm:
            kinds[geom] = _Kind.ARM
        elif name in FINGER_BODIES:
            kinds[geom] = _Kind.FINGER
        elif name in base:
            kinds[geom] = _Kind.BASE
        else:
            # What opens is a thing of its own: neither its furniture as a support nor the furniture as a subject.
            root = name if name in doors else body_name(model, subtree_root(model, body))
            if subject is not None and subject in doors and subject == name:
                kinds[geom] = _Kind.OBJECT if _is_handle(twin, geom, subject) else _Kind.PANEL
            elif subject is not None and subject in (name, root):
                kinds[geom] = _Kind.OBJECT
            elif {name, root} & supports:
                kinds[geom] = _Kind.SUPPORT
    return kinds


def _is_handle(twin: TwinModel, geom: int, joint: str) -> bool:
    """Whether a geom of a joint's body holds the middle of its handle."""
    model = twin.model
    handle = next(j.handle for j in twin.joints if j.body == joint)
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
    local = turn.reshape(3, 3).T @ (handle.centre - model.geom_pos[geom])
    half = model.geom_aabb[geom, 3:]
    return bool((np.abs(local - model.geom_aabb[geom, :3]) <= half).all())


def _pairs(model: mujoco.MjModel, kind: np.ndarray, table: np.ndarray) -> np.ndarray:
    """Pairs of geoms that some phase has a limit for and that MuJoCo would let touch, planes first, shape (n, 2)."""
    excluded = {(int(s) >> 16, int(s) & 0xFFFF) for s in model.exclude_signature}
    out = []
    for a in range(model.ngeom):
        for b in range(a + 1, model.ngeom):
            if (table[:, kind[a], kind[b]] <= IGNORE).all():
                continue
            if not (
                model.geom_contype[a] & model.geom_conaffinity[b] or model.geom_contype[b] & model.geom_conaffinity[a]
            ):
                continue
            bodies = sorted((int(model.geom_bodyid[a]), int(model.geom_bodyid[b])))
            first, second = (int(model.body_weldid[x]) for x in bodies)
            parents = (
                int(model.body_weldid[model.body_parentid[first]]),
                int(model.body_weldid[model.body_parentid[second]]),
            )
            joined = first and second and (parents[1] == first or parents[0] == second)
            if first == second or joined or (bodies[0], bodies[1]) in excluded or (bodies[1], bodies[0]) in excluded:
                continue
            out.append((b, a) if model.geom_type[b] == mujoco.mjtGeom.mjGEOM_PLANE else (a, b))
    return np.array(out, int).reshape(-1, 2)


def _thresholds(safety: SafetyLimits, margin: float) -> np.ndarray:
    """Least distance in [m] for each phase and pair of kinds, shape (phases, kinds, kinds)."""
    table = np.full((len(Phase), len(_Kind), len(_Kind)), IGNORE)
    arm, finger, held = (c + margin for c in (safety.arm_clearance, safety.finger_clearance, safety.held_clearance))
    for phase in Phase:
        t = table[phase]
        for outside in (_Kind.WORLD, _Kind.SUPPORT):
            t[_Kind.ARM, outside] = arm
            t[_Kind.FINGER, outside] = finger
        own = safety.self_clearance + min(margin, SELF_TOLERANCE)
        t[_Kind.ARM, _Kind.ARM] = t[_Kind.ARM, _Kind.BASE] = own
        t[_Kind.FINGER, _Kind.ARM] = t[_Kind.FINGER, _Kind.BASE] = own
        if phase == Phase.FREE:
            t[_Kind.ARM, _Kind.OBJECT], t[_Kind.FINGER, _Kind.OBJECT] = arm, finger
        else:
            t[_Kind.ARM, _Kind.OBJECT] = HAND_TO_GRASPED if phase == Phase.GRASP else 0.0
        if phase in (Phase.CARRY, Phase.CONTACT, Phase.RETREAT):
            t[_Kind.OBJECT, _Kind.WORLD] = t[_Kind.OBJECT, _Kind.BASE] = held
            t[_Kind.OBJECT, _Kind.SUPPORT] = -PRESSED if phase == Phase.CONTACT else held
        # A panel keeps off the hand in every phase; while the hand moves it, the panel and its handle keep off the
        # world as well.
        t[_Kind.ARM, _Kind.PANEL], t[_Kind.FINGER, _Kind.PANEL] = arm, finger
        if phase == Phase.ARTICULATE:
            t[_Kind.ARM, _Kind.PANEL] += ARTICULATION_MARGIN
            t[_Kind.ARM, _Kind.OBJECT] = HAND_TO_GRASPED + ARTICULATION_MARGIN
            for part in (_Kind.OBJECT, _Kind.PANEL):
                t[part, _Kind.WORLD] = t[part, _Kind.SUPPORT] = t[part, _Kind.BASE] = held
        table[phase] = np.maximum(t, t.T)
    return table
