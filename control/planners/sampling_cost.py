"""What sampled motions pay along the way: shaped distances of the reward terms, and a few side effects.

    cost of a sample = mean over the horizon of  sum_i w_i (sqrt(|r_i|^2 + p^2) - p)

the smooth L2 norm of MuJoCo MPC (Howell et al., 2022, appendix "norms"), with residuals r_i that never are flat where
the goal's predicate is:

    primary term, w 1        its own residual (`TermDefinition.residual_along`; docs/reward-terms.md)
    other terms, w 0.1       likewise
    hold, w 1                the palm from the middle of what is handled, or of its handle
    fingers, w 0.1           1 where fingers are not closed although the palm is there, or closed although it is not
    joint speed, w 0.005     the commanded speed in [rad/s]: MuJoCo MPC's control cost
    workspace, w 5           the palm outside the safety table's workspace
    side effects, w 1        displacement of objects and handles that the spec does not name

These are all: contact forces and clearances cost nothing here, as in the plain method; the verdict judges them.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from control.path_planning.collision_filter import free_joint_address
from control.robot.kinematics import ArmKinematics
from control.robot.rotations import rotation_exp
from control.safety.limits import SafetyLimits
from control.tasks.posed_object import PosedObject
from control.tasks.reward_spec import PALM, RewardSpec
from control.tasks.subtasks import Subtask, posed_objects
from control.twin_model import ARM_BODIES, ARM_JOINTS, TwinJoint, TwinModel


@dataclass(frozen=True)
class CostWeights:
    """Weights per [m] unless said otherwise.

    Attributes:
        primary, secondary: Of the reward terms.
        hold: Of the palm's distance from what is handled.
        fingers: Of fingers that are closed at the wrong place or open at the right one, per sample.
        speed: Of the commanded joint speed, per [rad/s].
        workspace: Of leaving the workspace.
        side_effects: Of displacing what the spec does not name.
        smoothing: p of the smooth L2 norm in [m]; MuJoCo MPC's tasks and RePlan use 0.01.
        near: Distance in [m] of the palm from the middle of what is handled, within which fingers should be closed.
    """

    primary: float = 1.0
    secondary: float = 0.1
    hold: float = 1.0
    fingers: float = 0.1
    speed: float = 0.005
    workspace: float = 5.0
    side_effects: float = 1.0
    smoothing: float = 0.01
    near: float = 0.015


class RunningCost:
    """The cost of many simulated motions at once, from recorded configurations alone.

    Args:
        twin: Where they were simulated.
        spec: What is wanted.
        task: The spec made concrete.
        safety: For the workspace.
        arm: Kinematics of the arm.
        rest_palm: Tool centre point in the rest configuration in the world in [m], shape (3,).
        weights: Of all parts.
    """

    def __init__(
        self,
        twin: TwinModel,
        spec: RewardSpec,
        task: Subtask,
        safety: SafetyLimits,
        arm: ArmKinematics,
        rest_palm: np.ndarray,
        weights: CostWeights,
    ) -> None:
        self._twin, self._spec, self._task, self._safety, self._arm = twin, spec, task, safety, arm
        self._rest_palm, self.weights = rest_palm, weights
        data = twin.start()
        self._start = posed_objects(twin, data)
        self._q_columns = [int(twin.model.joint(n).qposadr[0]) for n in ARM_JOINTS]
        base = data.body(ARM_BODIES[0])
        self._base_turn, self._base_at = base.xmat.reshape(3, 3).copy(), base.xpos.copy()
        self._free = {o.name: free_joint_address(twin.model, o.name) for o in twin.objects}
        self._handles = {j.name: _HandlePath.of(twin, data, j) for j in twin.joints}
        # A term about the palm and what is handled says what `hold` says.
        self._others = [t for t in spec.terms if not t.primary and {t.subject, t.target} != {PALM, task.subject}]

    def of(self, qpos: np.ndarray, speed: np.ndarray, closed: np.ndarray) -> np.ndarray:
        """Cost of each motion, shape (n,); infinite where the simulation broke down.

        Args:
            qpos: Configurations of the twin's model, shape (n, t, nq).
            speed: Commanded joint speeds in [rad/s], shape (n, t, 7).
            closed: Whether the fingers are told to be closed, shape (n, t).
        """
        w = self.weights
        palm = self._palm(qpos)
        motions = _Motions(
            qpos, palm, self._rest_palm, self._twin.support_height, self._start, self._free, self._handles
        )
        primary = self._spec.primary
        total = w.primary * self._smooth(primary.definition.residual_along(primary, motions))
        for term in self._others:
            total += w.secondary * self._smooth(term.definition.residual_along(term, motions))
        if self._task.subject is not None:
            away = palm - self._middle(self._task.subject, motions)
            total += w.hold * self._smooth(away)
            there = np.einsum("ntk,ntk->nt", away, away) < w.near**2
            total += w.fingers * (there != closed)
        total += w.speed * self._smooth(speed)
        low, high = np.asarray(self._safety.workspace_low), np.asarray(self._safety.workspace_high)
        total += w.workspace * self._smooth(np.maximum(low - palm, 0.0) + np.maximum(palm - high, 0.0))
        total += w.side_effects * self._side_effects(qpos)
        cost = total.mean(axis=1)
        return np.where(np.isfinite(cost), cost, np.inf)

    def _smooth(self, residual: np.ndarray) -> np.ndarray:
        """Smooth L2 norm over the last axis: (n, t, k) → (n, t)."""
        p = self.weights.smoothing
        return np.sqrt(np.einsum("ntk,ntk->nt", residual, residual) + p * p) - p

    def _palm(self, qpos: np.ndarray) -> np.ndarray:
        q = qpos[..., self._q_columns]
        at, _ = self._arm.forward(q.reshape(-1, 7))
        return (at @ self._base_turn.T + self._base_at).reshape(*q.shape[:2], 3)

    def _middle(self, name: str, motions: "_Motions") -> np.ndarray:
        """Where to take hold of an object or joint, in the world in [m], shape (n, t, 3)."""
        if name in self._handles:
            return self._handles[name].at(motions.qpos)
        centre, turn = motions.place(name)
        thing = self._twin.get(name)
        if thing is None or thing.handle is None:
            return centre
        return centre + turn @ thing.handle.centre

    def _side_effects(self, qpos: np.ndarray) -> np.ndarray:
        total = np.zeros(qpos.shape[:2])
        for name, address in self._free.items():
            if address is not None and name not in self._spec.names:
                total += self._smooth(qpos[..., address : address + 3] - self._start[name].position)
        for name, path in self._handles.items():
            if name not in self._spec.names:
                total += self._smooth(path.at(qpos) - path.centre)
        return total


@dataclass(frozen=True)
class _Motions:
    """What terms may ask of the motions that are costed (`control.tasks.terms.views.SampledMotions`).

    Attributes:
        qpos: Configurations of the twin's model, shape (n, t, nq).
        palm: Tool centre points in the world in [m], shape (n, t, 3).
        rest_palm: Tool centre point in the rest configuration in [m], shape (3,).
        support_height: Height of the table top in [m].
        start: The twin's objects before the motions, by name.
        free: Where each object's pose stands in qpos, None for a fixed one, by name.
        handles: Where each joint's handle is, by name.
    """

    qpos: NDArray[np.float64]
    palm: NDArray[np.float64]
    rest_palm: NDArray[np.float64]
    support_height: float
    start: Mapping[str, PosedObject]
    free: Mapping[str, int | None]
    handles: Mapping[str, "_HandlePath"]

    def place(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Centres (n, t, 3) in [m] and rotations (n, t, 3, 3) of an object; one of each where it is fixed."""
        address = self.free[name]
        if address is None:
            pose = self.start[name].pose
            return pose[None, None, :3, 3], pose[None, None, :3, :3]
        return self.qpos[..., address : address + 3], _rotations(self.qpos[..., address + 3 : address + 7])

    def handle_way(self, joint: str, fraction: float) -> np.ndarray:
        """Way in [m] that a joint's handle has still to go to a fraction of its range, shape (n, t)."""
        return self.handles[joint].left(self.qpos, fraction)


@dataclass(frozen=True)
class _HandlePath:
    """Where a joint's handle is at any joint position.

    Attributes:
        joint: The joint.
        column: Of its position in qpos.
        start: Joint position at the start in [rad] or [m].
        axis, anchor, centre: Joint axis, a point on it and the handle's middle at the start, in the world in [m],
            shape (3,).
    """

    joint: TwinJoint
    column: int
    start: float
    axis: NDArray[np.float64]
    anchor: NDArray[np.float64]
    centre: NDArray[np.float64]

    @classmethod
    def of(cls, twin: TwinModel, data: mujoco.MjData, joint: TwinJoint) -> "_HandlePath":
        number, body = twin.model.joint(joint.name).id, data.body(joint.body)
        centre = body.xpos + body.xmat.reshape(3, 3) @ joint.handle.centre
        column = int(twin.model.jnt_qposadr[number])
        axis, anchor = data.xaxis[number].copy(), data.xanchor[number].copy()
        return cls(joint, column, float(data.qpos[column]), axis, anchor, centre)

    def at(self, qpos: np.ndarray) -> np.ndarray:
        """Middle of the handle in the world in [m], (n, t, nq) → (n, t, 3)."""
        way = (qpos[..., self.column] - self.start)[..., None]
        if self.joint.kind == "slide":
            return self.centre + way * self.axis
        return self.anchor + rotation_exp(way * self.axis) @ (self.centre - self.anchor)

    def left(self, qpos: np.ndarray, fraction: float) -> np.ndarray:
        """Way in [m] that the handle has still to go to a fraction, (n, t, nq) → (n, t)."""
        lever = 1.0
        if self.joint.kind == "hinge":
            lever = float(np.linalg.norm(np.cross(self.axis, self.centre - self.anchor)))
        return lever * np.abs(qpos[..., self.column] - self.joint.position(fraction))


def _rotations(quat: np.ndarray) -> np.ndarray:
    """Rotation matrices of unit quaternions (w, x, y, z): (..., 4) → (..., 3, 3)."""
    w, x, y, z = np.moveaxis(quat, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
