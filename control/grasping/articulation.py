"""How a joint of furniture moves what hangs on it: where a tool at its handle has to go."""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from control.grasping.grasps import pose
from control.robot.rotations import rotation_exp
from control.twin_model import TwinJoint, TwinModel


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
    axis: NDArray[np.float64]
    anchor: NDArray[np.float64]
    start: float
    world_T_body: NDArray[np.float64]

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
        return self.carried_all(world_T_tool[None], np.array([position]), np.array([share]))[0, 0]

    def carried_all(self, world_T_tools: np.ndarray, positions: np.ndarray, shares: np.ndarray) -> np.ndarray:
        """The same for tools (n, 4, 4) with their shares (n,) at all positions (k,): poses of shape (n, k, 4, 4)."""
        ways = positions - self.start
        out = np.repeat(world_T_tools[:, None], len(ways), axis=1)
        if not self.hinge:
            out[:, :, :3, 3] += ways[:, None] * self.axis
            return out
        turns = rotation_exp(ways[:, None] * self.axis)
        arms = world_T_tools[:, :3, 3] - self.anchor
        out[:, :, :3, 3] = self.anchor + np.einsum("kij,nj->nki", turns, arms)
        own = rotation_exp((shares[:, None] * ways)[:, :, None] * self.axis)
        out[:, :, :3, :3] = own @ world_T_tools[:, None, :3, :3]
        return out

    def turned(self, direction: np.ndarray, positions: np.ndarray) -> np.ndarray:
        """A direction (3,) of the body at all positions (k,) in [rad] or [m], shape (k, 3)."""
        if not self.hinge:
            return np.repeat(direction[None], len(positions), axis=0)
        return rotation_exp((positions - self.start)[:, None] * self.axis) @ direction

    def direction(self, point: np.ndarray) -> np.ndarray:
        """Unit vector in which a point (3,) of the body sets out as the joint position grows."""
        way = np.cross(self.axis, point - self.anchor) if self.hinge else self.axis
        return way / max(float(np.linalg.norm(way)), 1e-9)

    def lever(self, point: np.ndarray) -> float:
        """How far a point (3,) moves in [m] per [rad] or [m] of the joint."""
        return float(np.linalg.norm(np.cross(self.axis, point - self.anchor))) if self.hinge else 1.0
