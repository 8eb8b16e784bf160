"""What keeps a joint from moving in the twin: it is pushed by a weak servo while the robot touches nothing.

    torque = clip(f + c v + k (v - qd), +-cap),  k = 0.3 M / dt,  cap = f + c v + 3 Nm (hinge) or + 12 N (slide)

with the joint's dry friction f and damping c, and the speed v that is asked for.

A joint is free when it gets as far as in a reference run, in which no movable thing has contacts, and pushes nothing
aside on its way. Moving a little is not free: a barred door still turns by 20 degrees. Bodies are suspected by the
generalised force with which their contacts resisted, and confirmed in runs without their contacts, one at a time.
"""

import copy
from dataclasses import dataclass

import mujoco
import numpy as np

from control.path_planning.collision_filter import body_name
from control.simulation.motion_recording import contact_names
from control.twin_model import ARM_BODIES, FINGER_BODIES, HAND_BODY, TwinJoint, TwinModel
from sim_check.twin.collision_masks import without_contacts

SPEED_HINGE, SPEED_SLIDE = 0.4, 0.1  # [rad/s], [m/s]
CAP_HINGE, CAP_SLIDE = 3.0, 12.0  # [Nm], [N] beyond dry friction
RAMP = 0.3  # [s] in which the push builds up
PATIENCE = 1.5  # times the way's own time that a push lasts
FREE = 0.9  # share of the reference's way that counts as free
ASIDE = 0.02  # [m] by which a movable thing may be pushed aside
FORCE_STRIDE = 5  # steps between looks at contact forces


@dataclass(frozen=True)
class Push:
    """How a joint went when it was pushed.

    Attributes:
        progress: Share of the way to the goal, about 0..1.
        resisted: Mean generalised force in [Nm] or [N] against the push, by body, largest first.
        aside: Movable things that were moved by more than `ASIDE`.
    """

    progress: float
    resisted: dict[str, float]
    aside: tuple[str, ...]


@dataclass(frozen=True)
class JointBlame:
    """Who is to blame.

    Attributes:
        bodies: Things without which the joint is free; none when the joint is free as it is.
        free: Whether the joint moves all the way in the twin and pushes nothing aside.
        push: As things stand.
        reference: Without contacts of any movable thing.
        without: For each thing that lost its contacts, the share of the way without it.
    """

    bodies: tuple[str, ...]
    free: bool
    push: Push
    reference: Push
    without: dict[str, float]


def blame(twin: TwinModel, joint: TwinJoint, fraction: float) -> JointBlame:
    """Find the bodies that keep a joint from a fraction.

    Args:
        twin: Where it does not move.
        joint: Which one.
        fraction: Where it should go, 0 closed .. 1 open.
    """
    movable = [o.name for o in twin.objects if o.movable and o.name != twin.held]
    push = push_joint(twin, joint, fraction)
    reference = push_joint(without_contacts(twin, tuple(movable)), joint, fraction) if movable else push
    if _free(push, reference):
        return JointBlame((), True, push, reference, {})
    suspects = sorted(movable, key=lambda name: -push.resisted.get(name, 0.0))
    without: dict[str, float] = {}
    for name in suspects:
        alone = push_joint(without_contacts(twin, (name,)), joint, fraction)
        without[name] = alone.progress
        if _free(alone, reference):
            return JointBlame((name,), False, push, reference, without)
    gone: list[str] = []
    for name in suspects:
        gone.append(name)
        if len(gone) > 1 and _free(push_joint(without_contacts(twin, tuple(gone)), joint, fraction), reference):
            return JointBlame(tuple(gone), False, push, reference, without)
    fixed = {o.name for o in twin.objects if not o.movable and o.name != joint.owner}
    standing = [name for name in push.resisted if name in fixed or twin.joint(name) is not None]
    return JointBlame(tuple(standing[:1]), False, push, reference, without)


def push_joint(twin: TwinModel, joint: TwinJoint, fraction: float) -> Push:
    """Push a joint towards a fraction and watch; the robot touches nothing meanwhile."""
    model = _without_robot(twin.model)
    data = twin.start()
    number = model.joint(joint.name).id
    address, dof, body = model.jnt_qposadr[number], int(model.jnt_dofadr[number]), model.body(joint.body).id
    hinge = joint.kind == "hinge"
    start = float(data.qpos[address])
    way = joint.position(fraction) - start
    sign = float(np.sign(way)) or 1.0
    speed, spare = (SPEED_HINGE, CAP_HINGE) if hinge else (SPEED_SLIDE, CAP_SLIDE)
    dt = float(model.opt.timestep)
    gain = 0.3 * float(model.dof_M0[dof]) / dt
    ahead = float(model.dof_frictionloss[dof]) + float(model.dof_damping[dof]) * speed
    cap = ahead + spare
    names = contact_names(model, frozenset(o.name for o in twin.objects) | {j.body for j in twin.joints})
    places = {o.name: data.body(o.name).xpos.copy() for o in twin.objects if o.movable}
    resisted: dict[str, float] = {}
    looks = 0
    for step in range(int(PATIENCE * (abs(way) / speed + RAMP) / dt)):
        if (data.qpos[address] - start) * sign >= abs(way):
            break
        push = sign * ahead + gain * (sign * speed - data.qvel[dof])
        data.qfrc_applied[dof] = np.clip(push, -cap, cap) * min(1.0, step * dt / RAMP)
        mujoco.mj_step(model, data)
        if step % FORCE_STRIDE == 0:
            looks += 1
            for name, force in _resistance(model, data, number, body, sign, hinge, names).items():
                resisted[name] = resisted.get(name, 0.0) + force
    aside = tuple(n for n, p in places.items() if np.linalg.norm(data.body(n).xpos - p) > ASIDE)
    mean = {n: f / max(1, looks) for n, f in sorted(resisted.items(), key=lambda item: -item[1])}
    progress = (float(data.qpos[address]) - start) * sign / max(abs(way), 1e-9)
    return Push(progress, mean, aside)


def _free(push: Push, reference: Push) -> bool:
    return push.progress >= FREE * min(1.0, reference.progress) and not push.aside and reference.progress >= FREE


def _resistance(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    joint: int,
    body: int,
    sign: float,
    hinge: bool,
    names: list[str],
) -> dict[str, float]:
    """Generalised force in [Nm] or [N] of contacts against the push, by the other body's name.

    Hinge: axis . ((p - anchor) x F); slide: axis . F.
    """
    out: dict[str, float] = {}
    wrench = np.zeros(6)
    for i in range(data.ncon):
        contact = data.contact[i]
        first, second = (int(model.geom_bodyid[g]) for g in contact.geom)
        if (first == body) == (second == body) or contact.efc_address < 0:
            continue
        mujoco.mj_contactForce(model, data, i, wrench)
        # In the contact's frame, on the second body.
        force = contact.frame.reshape(3, 3).T @ wrench[:3] * (1.0 if second == body else -1.0)
        lever = np.cross(contact.pos - data.xanchor[joint], force) if hinge else force
        against = -sign * float(data.xaxis[joint] @ lever)
        if against > 0:
            other = names[int(contact.geom[0 if second == body else 1])]
            out[other] = out.get(other, 0.0) + against
    return out


def _without_robot(model: mujoco.MjModel) -> mujoco.MjModel:
    """A copy in which no part of the robot touches anything."""
    out = copy.copy(model)
    robot = {*ARM_BODIES, HAND_BODY, *FINGER_BODIES}
    for geom in range(out.ngeom):
        if body_name(out, int(out.geom_bodyid[geom])) in robot:
            out.geom_contype[geom] = 0
            out.geom_conaffinity[geom] = 0
    return out
