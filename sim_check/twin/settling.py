"""Letting things come to rest, and finding out that they cannot."""

import mujoco
import numpy as np

from control.errors import StackError

STILL = 2e-3  # speed in [m/s] and angular speed in [rad/s] / 10 below which a thing is at rest
DEEPEST = 2.5e-3  # penetration in [m] that soft contacts of things at rest may have
OVERLAP = 3e-4  # overlap in [m] that contacts may close by themselves


def free_bodies(model: mujoco.MjModel) -> dict[str, int]:
    """Name and address of the first degree of freedom of every free body."""
    joints = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    return {model.body(int(model.jnt_bodyid[j])).name: int(model.jnt_dofadr[j]) for j in joints}


def settle(model: mujoco.MjModel, data: mujoco.MjData, longest: float = 1.5, calm: float = 0.15) -> float:
    """Step until every free body is at rest; the controls in `data` hold the robot. Ends with all speeds at zero.

    For the first `calm` seconds speeds are cut to a fifth every 20 ms, so that what overlaps is pressed apart instead
    of being thrown.

    Args:
        model, data: Model and state; `data` is changed.
        longest: Longest simulated time in [s].
        calm: Length of the damped part in [s].

    Returns:
        Simulated time in [s].

    Raises:
        StackError: Something still moves after `longest`, or two things stay inside each other; names them.
    """
    bodies = free_bodies(model)
    cut = max(1, round(0.02 / model.opt.timestep))
    still = 0
    start = data.time
    for step in range(round(longest / model.opt.timestep)):
        mujoco.mj_step(model, data)
        if data.time - start < calm and step % cut == cut - 1:
            data.qvel[:] *= 0.2
        if step % cut == cut - 1:
            still = still + 1 if not _moving(data, bodies) else 0
            if (still >= 3 and data.time - start >= calm) or data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number:
                break
    moving = _moving(data, bodies)
    if moving:
        other = touching(model, data, moving[0])
        raise StackError(
            f"'{moving[0]}' does not come to rest{f' against {other}' if other else ''} within {longest} s; "
            "its estimated pose or size is likely wrong: look again from another side"
        )
    data.qvel[:] = 0.0
    mujoco.mj_forward(model, data)
    deep = deepest_overlap(model, data)
    if deep is not None and deep[2] > DEEPEST:
        raise StackError(
            f"'{deep[0]}' and '{deep[1]}' are {deep[2] * 1e3:.0f} mm inside each other and cannot be moved apart; "
            "their estimated poses or sizes are likely wrong: look again from another side"
        )
    return data.time - start


def deepest_overlap(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[str, str, float] | None:
    """(body, body, depth in [m]) of the deepest contact that involves a free body, or None."""
    bodies = free_bodies(model)
    worst = None
    for contact in data.contact[: data.ncon]:
        names = [model.body(int(model.geom_bodyid[g])).name for g in contact.geom]
        if (names[0] in bodies or names[1] in bodies) and (worst is None or -contact.dist > worst[2]):
            worst = (names[0], names[1], float(-contact.dist))
    return worst


def _moving(data: mujoco.MjData, bodies: dict[str, int]) -> list[str]:
    """Free bodies that move, fastest first."""
    speed = {
        name: max(np.linalg.norm(data.qvel[at : at + 3]), np.linalg.norm(data.qvel[at + 3 : at + 6]) / 10)
        for name, at in bodies.items()
    }
    return sorted((n for n, v in speed.items() if not v < STILL), key=lambda n: -speed[n])


def touching(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> str:
    """Names of what touches a body, for a message; empty when nothing does."""
    body = model.body(name).id
    partners = set()
    for contact in data.contact[: data.ncon]:
        pair = [int(model.geom_bodyid[g]) for g in contact.geom]
        if body in pair:
            partners.add(model.body(pair[0] if pair[1] == body else pair[1]).name)
    return ", ".join(f"'{n}'" for n in sorted(partners))


def move_apart(
    model: mujoco.MjModel, data: mujoco.MjData, fixed: frozenset[str] = frozenset(), rounds: int = 60
) -> None:
    """Move free bodies out of each other, of the robot and of the table, without dynamics; changes `data`.

    Each round moves the free body of every overlapping pair along the contact's normal by the depth (half of it each,
    when both are free). Pairs that stay deep are left for `settle` to judge.

    Args:
        model, data: Model and state.
        fixed: Free bodies that are not moved (what the hand holds, between pads that squeeze it).
        rounds: Most rounds.
    """
    address = {
        int(model.jnt_bodyid[j]): int(model.jnt_qposadr[j])
        for j in np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
        if model.body(int(model.jnt_bodyid[j])).name not in fixed
    }
    for _ in range(rounds):
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        shifts: dict[int, np.ndarray] = {}
        for contact in data.contact[: data.ncon]:
            depth = -float(contact.dist)
            if depth < OVERLAP:
                continue
            first, second = (int(model.geom_bodyid[g]) for g in contact.geom)
            both = first in address and second in address
            # The normal points from the first geom to the second.
            for body, sign in ((first, -1.0), (second, 1.0)):
                if body in address:
                    shift = sign * contact.frame[:3] * depth * (0.5 if both else 1.0)
                    known = shifts.get(body)
                    if known is None or np.linalg.norm(shift) > np.linalg.norm(known):
                        shifts[body] = shift
        if not shifts:
            break
        for body, shift in shifts.items():
            data.qpos[address[body] : address[body] + 3] += shift
    mujoco.mj_forward(model, data)
