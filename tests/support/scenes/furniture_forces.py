"""Pulling at handles in a simulated world, for tests: forces on the furniture itself, no robot."""

import mujoco
import numpy as np


def pull(world, joint, force, seconds):
    """Pull at a joint's handle in the direction that opens it; returns the joint position then, in [rad] or [m].

    Args:
        world: Its state is stepped.
        joint: Name of a joint with a handle.
        force: In [N].
        seconds: Simulated time.
    """
    part = next(f.part(joint) for f in world.furniture.values() if f.part(joint) is not None)
    model, data = world.model, world.data
    body = model.body(joint).id
    for _ in range(round(seconds / model.opt.timestep)):
        turn = data.xmat[body].reshape(3, 3)
        arm, axis = turn @ part.handle.centre, turn @ part.axis
        along = axis if part.kind == "slide" else np.cross(axis, arm) / np.linalg.norm(np.cross(axis, arm))
        data.qfrc_applied[:] = 0.0
        mujoco.mj_applyFT(model, data, force * along, np.zeros(3), data.xpos[body] + arm, body, data.qfrc_applied)
        mujoco.mj_step(model, data)
    data.qfrc_applied[:] = 0.0
    return float(data.joint(joint).qpos[0])


def wait(world, seconds):
    """Let simulated time pass."""
    for _ in range(round(seconds / world.model.opt.timestep)):
        mujoco.mj_step(world.model, world.data)


def put(world, name, position, mass=None):
    """Put an object somewhere, upright, and perhaps make it as heavy as `mass` [kg]."""
    model, data = world.model, world.data
    at, body = int(model.joint(name).qposadr[0]), model.body(name).id
    if mass is not None:
        model.body_inertia[body] *= mass / model.body_mass[body]
        model.body_mass[body] = mass
        mujoco.mj_setConst(model, mujoco.MjData(model))
    data.qpos[at : at + 3] = position
    data.qpos[at + 3 : at + 7] = [1.0, 0.0, 0.0, 0.0]
    data.qvel[:] = 0.0
    mujoco.mj_forward(model, data)
