"""Motions with one injected fault each, by construction: what the verdict has to turn down, and by which check.

Every function takes a planned motion and a source of randomness and returns a case, or None where the motion offers
no occasion for the fault (nothing is held, no place beside the way is free).
"""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import mujoco
import numpy as np

from benchmarks.judging.fault_geometry import (
    ROBOT,
    free_spot,
    gives_way,
    go_on,
    hand_down,
    lowered_hand,
    overlaps,
    room_below,
)
from benchmarks.motion.base_motions import Base, Case, rescaled
from benchmarks.motion.placed_obstacles import NAME, Wanted, obstacle_below
from control.path_planning.rrt_connect import straight
from control.robot.dynamics import Payload
from control.trajectory.samples import SAMPLE_TIME, GripperCommand, GripperEvent
from control.twin_model import ARM_BODIES, ARM_JOINTS, FINGER_BODIES, HAND_BODY, TCP_SITE

TRIES = 300
TOUCHED = frozenset({"arm_clearance", "finger_clearance", "held_clearance", "unwanted_contact", "contact_force"})


def _case(base: Base, kind: str, checks: set[str] | frozenset[str], **changes) -> Case:
    own = Case(kind, base.trajectory, base.twin, base.spec, base.safety, checks=frozenset(checks))
    return replace(own, **changes)


def excess_speed(base: Base, rng: np.random.Generator) -> Case | None:
    """One free segment is played so fast that its fastest joint exceeds the allowed speed by 5 to 50 %."""
    moving = [i for i, s in enumerate(base.trajectory.segments) if s.stop - s.start > 300 and not s.touching]
    if not moving:
        return None
    index = int(rng.choice(moving))
    segment = base.trajectory.segments[index]
    allowed = base.limits.qd * base.safety.velocity_scale
    share = float((np.abs(base.trajectory.qd[segment.start : segment.stop]) / allowed).max())
    if share < 0.1:
        return None
    faster = rescaled(base.trajectory, index, rng.uniform(1.05, 1.5) / share)
    return _case(base, "joint_speed", {"joint_velocity"}, trajectory=faster)


def excess_jerk(base: Base, rng: np.random.Generator) -> Case:
    """One sample of one joint lies off its curve: by so much that the third difference is 1.5 to 100 times its limit.

    A single displaced sample d makes third differences of d, -3 d, 3 d, -d over the cube of a millisecond.
    """
    t = base.trajectory
    row, joint = int(rng.integers(200, len(t.q) - 200)), int(rng.integers(7))
    size = np.exp(rng.uniform(np.log(1.5), np.log(100.0)))
    bump = np.zeros_like(t.q)
    bump[row, joint] = size * base.limits.qddd[joint] * SAMPLE_TIME**3 / 3 * rng.choice([-1.0, 1.0])
    qd = t.qd + np.gradient(bump, SAMPLE_TIME, axis=0)
    qdd = t.qdd + np.gradient(np.gradient(bump, SAMPLE_TIME, axis=0), SAMPLE_TIME, axis=0)
    kinked = replace(t, q=t.q + bump, qd=qd, qdd=qdd)
    return _case(base, "jerk", {"joint_jerk"}, trajectory=kinked)


def self_collision(base: Base, rng: np.random.Generator) -> Case | None:
    """The motion goes on, straight in its joints, into a configuration in which the robot's parts overlap by 5 mm."""
    end, margin = base.trajectory.q[-1], 0.05  # [rad] from the joints' limits
    for _ in range(TRIES):
        goal = rng.uniform(base.limits.q_min + margin, base.limits.q_max - margin)
        if overlaps(base, goal)[0] < 0.005:
            continue
        way = straight(end, goal)
        if any(overlaps(base, q)[1] > 0.0 for q in way):
            continue
        longer = go_on(base, len(base.trajectory.q) - 1, [way, straight(goal, end)])
        if longer is not None:
            return _case(base, "self_collision", {"self_clearance", "self_contact"}, trajectory=longer)
    return None


def graze(depth: float) -> Callable[[Base, np.random.Generator], Case | None]:
    """An obstacle stands so high under the way that robot or held object overlap it by `depth` [m] at one moment."""

    def make(base: Base, rng: np.random.Generator) -> Case | None:
        twin = obstacle_below(base, Wanted(-depth), rng)
        if twin is None:
            return None
        return _case(base, f"graze_{round(depth * 1e3)}mm", TOUCHED, twin=twin, culprit=NAME)

    return make


def dropped(base: Base, rng: np.random.Generator) -> Case | None:
    """The gripper opens while it carries something high above everything."""
    carried = [s for s in base.trajectory.segments if s.held and not s.touching and s.stop - s.start > 200]
    if not carried:
        return None
    segment = carried[int(rng.integers(len(carried)))]
    row = int(rng.integers(segment.start + 50, segment.stop - 100))
    low = room_below(base, segment.held or "", row)
    if low < 0.05:
        return None
    event = GripperEvent(row * SAMPLE_TIME, 0.5, GripperCommand("move", base.twin.gripper.opening))
    events = tuple(sorted((*base.trajectory.gripper, event), key=lambda e: e.time))
    return _case(base, "dropped", {"held_kept"}, trajectory=replace(base.trajectory, gripper=events))


def knocked_over(base: Base, rng: np.random.Generator) -> Case | None:
    """A slender neighbour stands in the way of the moving hand, which strikes it 5 cm below its top.

    It falls, or is pushed along where something stops its fall.
    """
    wanted = Wanted(-0.05, width=(0.04, 0.05), speed=0.08, height=0.12)
    twin = obstacle_below(base, wanted, rng)
    return None if twin is None else _case(base, "knocked_over", {"tipped", "moved"}, twin=twin, culprit=NAME)


def excess_force(base: Base, rng: np.random.Generator) -> Case | None:
    """What is put down is pressed 8 to 20 mm into what carries it; where nothing is, the fingers into the table."""
    depth = rng.uniform(0.008, 0.02)
    put = [s for s in base.trajectory.segments if s.held and s.name == "lower"]
    if put and gives_way(base):
        return None
    if put:
        row = put[-1].stop - 1
        fall = max(0.0, room_below(base, put[-1].held or "", row))  # things are let go a little above what carries them
        ways = [base.trajectory.q[row], lowered_hand(base, base.trajectory.q[row], fall + depth)]
    else:
        row = len(base.trajectory.q) - 1
        spot = free_spot(base, rng)
        if spot is None:
            return None
        tip = base.twin.support_height + base.twin.gripper.fingertip
        ways = [base.trajectory.q[row], hand_down(base, spot, tip + 0.10), hand_down(base, spot, tip - depth)]
    if any(q is None for q in ways):
        return None
    corners = [q for q in ways if q is not None]
    there = [straight(a, b) for a, b in pairwise(corners)]
    if not put and any(overlaps(base, q)[1] > 0.0 for q in there[0]):
        return None
    pressed = go_on(base, row, [*there, *[way[::-1] for way in there[::-1]]])
    if pressed is None:
        return None
    return _case(base, "force", {"contact_force", "pressing_force"}, trajectory=pressed)


def bad_start(base: Base, rng: np.random.Generator) -> Case:
    """One joint starts 6 to 100 mrad from where the robot is and comes to the planned way within a second.

    q(t) += d (1 - s(t / 1 s)),  s(u) = u^3 (10 - 15 u + 6 u^2)
    """
    t = base.trajectory
    joint = int(rng.integers(7))
    off = np.exp(rng.uniform(np.log(1.2), np.log(20.0))) * base.safety.start_tolerance * rng.choice([-1.0, 1.0])
    u = np.clip(np.arange(len(t.q)) * SAMPLE_TIME, 0.0, 1.0)
    q, qd, qdd = t.q.copy(), t.qd.copy(), t.qdd.copy()
    q[:, joint] += off * (1 - u**3 * (10 - 15 * u + 6 * u**2))
    qd[:, joint] -= off * 30 * u**2 * (1 - u) ** 2
    qdd[:, joint] -= off * 60 * u * (1 - 3 * u + 2 * u**2)
    return _case(base, "bad_start", {"start_state"}, trajectory=replace(t, q=q, qd=qd, qdd=qdd))


def keep_out(base: Base, rng: np.random.Generator) -> Case | None:
    """A zone lies about a point inside a link, the hand or a finger at some moment, and not about the start."""
    model, data = base.twin.model, mujoco.MjData(base.twin.model)
    parts = [model.body(name).id for name in (*ARM_BODIES[3:], HAND_BODY, *FINGER_BODIES)]
    solid = (model.geom_contype | model.geom_conaffinity) != 0
    geoms = np.flatnonzero(np.isin(model.geom_bodyid, parts) & solid)
    robot = np.flatnonzero(np.isin(model.geom_bodyid, [model.body(n).id for n in ROBOT]) & solid)
    start = base.twin.start()
    for _ in range(TRIES):
        row, geom = int(rng.integers(len(base.rollout.qpos))), int(rng.choice(geoms))
        data.qpos[:] = base.rollout.qpos[row]
        mujoco.mj_kinematics(model, data)
        at, half = data.geom_xpos[geom].copy(), rng.uniform(0.02, 0.06, 3)
        apart = np.maximum(np.abs(start.geom_xpos[robot] - at) - half, 0.0)
        if (np.linalg.norm(apart, axis=1) > model.geom_rbound[robot]).all():
            zone = (tuple(map(float, at - half)), tuple(map(float, at + half)))
            safety = replace(base.safety, keep_out=(*base.safety.keep_out, zone))
            return _case(base, "keep_out", {"keep_out"}, safety=safety)
    return None


def excess_torque(base: Base, rng: np.random.Generator) -> Case | None:
    """A load whose weight alone takes one joint to 1.15 to 1.6 times its torque limit at some moment.

        tau(m) = g(q) + m J_z(q)^T |g|

    with MuJoCo's model of the arm, which is not the one that the verdict computes torques with.
    """
    model, data = base.twin.model, mujoco.MjData(base.twin.model)
    dofs = [int(model.joint(name).dofadr[0]) for name in ARM_JOINTS]
    site = model.site(TCP_SITE).id
    rows = np.arange(0, len(base.rollout.qpos), 20)
    own, per_kg, jacobian = np.empty((len(rows), 7)), np.empty((len(rows), 7)), np.zeros((3, model.nv))
    for k, row in enumerate(rows):
        data.qpos[:] = base.rollout.qpos[row]
        mujoco.mj_forward(model, data)
        mujoco.mj_jacSite(model, data, jacobian, None, site)
        own[k], per_kg[k] = data.qfrc_bias[dofs], -jacobian[:, dofs].T @ model.opt.gravity
    wanted = rng.uniform(1.15, 1.6)
    for mass in np.arange(1.0, 60.0, 0.25):
        if (np.abs(own + mass * per_kg) / base.limits.tau).max() > wanted:
            return _case(base, "torque", {"torque"}, payload=Payload(float(mass)))
    return None


FAULTS: dict[str, Callable[[Base, np.random.Generator], Case | None]] = {
    "joint_speed": excess_speed,
    "jerk": excess_jerk,
    "self_collision": self_collision,
    "graze_1mm": graze(0.001),
    "graze_10mm": graze(0.010),
    "dropped": dropped,
    "knocked_over": knocked_over,
    "force": excess_force,
    "bad_start": bad_start,
    "keep_out": keep_out,
    "torque": excess_torque,
}
