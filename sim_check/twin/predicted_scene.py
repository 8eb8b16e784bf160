"""What a camera would see after a motion, as the twin has it: a scene that nobody has seen yet."""

from dataclasses import replace
from types import MappingProxyType

import mujoco
import numpy as np

from control.twin_model import TwinModel
from perception.estimates import ObjectEstimate, SceneEstimate

STAYED = 0.005  # [m] by which a thing may seem to move without having been moved
STAYED_SHARE = 0.01  # the same for a joint, as a share of its way


def predicted_scene(scene: SceneEstimate, before: TwinModel, after: TwinModel) -> SceneEstimate:
    """The scene with each thing moved as the twin's was, and each joint as far open as the twin's.

    Things that stay keep their estimates. Spreads, scores and stamps stay as well: this is no observation.

    Args:
        scene: What was seen, and `before` was built from.
        before, after: The twin at the motion's start and at its end; both have the same model.
    """
    poses = _poses(before), _poses(after)
    fractions = before.joint_fractions(), after.joint_fractions()
    return replace(scene, objects=tuple(_moved(o, before, poses, fractions) for o in scene.objects))


def _poses(twin: TwinModel) -> dict[str, np.ndarray]:
    """Poses of all things in the world, (4, 4) each."""
    data = mujoco.MjData(twin.model)
    data.qpos[:] = twin.qpos
    mujoco.mj_kinematics(twin.model, data)
    out = {}
    for thing in twin.objects:
        pose = np.eye(4)
        pose[:3, :3] = data.body(thing.name).xmat.reshape(3, 3)
        pose[:3, 3] = data.body(thing.name).xpos
        out[thing.name] = pose
    return out


def _moved(
    o: ObjectEstimate,
    twin: TwinModel,
    poses: tuple[dict[str, np.ndarray], dict[str, np.ndarray]],
    fractions: tuple[dict[str, float], dict[str, float]],
) -> ObjectEstimate:
    was, now = poses[0][o.name], poses[1][o.name]
    if np.linalg.norm(now[:3, 3] - was[:3, 3]) > STAYED:
        o = replace(o, world_T_object=now @ np.linalg.inv(was) @ o.world_T_object)
    own = [j.name for j in twin.joints if j.owner == o.name]
    changed = {j: fractions[1][j] for j in own if abs(fractions[1][j] - fractions[0][j]) > STAYED_SHARE}
    if changed:
        o = replace(o, joint_fractions=MappingProxyType({**o.joint_fractions, **changed}))
    return o
