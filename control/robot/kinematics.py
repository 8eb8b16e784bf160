"""Kinematics of the arm for many configurations at once: forward, Jacobian, inverse, along a Cartesian path.

A motion search asks for tens of thousands of inverse solutions. From a hundred rows on, a damped step costs 2 to 4 us a
row for all together, and about 20 us row by row with Pinocchio (`benchmarks.motion.kinematics`). The constants come
from the URDF through Pinocchio, once, in `ArmKinematics.from_urdf`.

Conventions: positions in [m], angles in [rad], world = robot base frame (panda_link0), "tool" = the site between the
pads (panda_hand_tcp). A rotation error e satisfies R_target = exp([e]) R, in world axes.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from control.errors import ConfigError
from control.robot.description import TCP_FRAME, arm_model
from control.robot.gripper import PANDA_HAND, GripperModel
from control.robot.limits import REST_Q
from control.robot.rotations import rotation_log

# Where an iteration starts from, as changes of REST_Q (joint index from 0 → value in [rad]): turned shoulder, both
# wrist flips, elbow out to either side, hand turned forwards. They reach different branches of the solution set.
SEED_CHANGES: tuple[dict[int, float], ...] = (
    {},
    {4: 2.4, 5: 2.0, 6: -1.5},
    {4: -2.4, 5: 2.0, 6: -1.5},
    {0: 0.6, 2: -0.6, 5: 2.2},
    {0: -0.6, 2: 0.6, 5: 2.2},
    {5: 2.8},
    {4: 1.2, 5: 2.2, 6: 0.0},
    {4: -1.2, 5: 2.2, 6: 1.6},
    {0: 0.8, 2: -1.2, 4: 0.8, 5: 2.2, 6: 0.4},
    {0: -0.8, 2: 1.2, 4: -0.8, 5: 2.2, 6: 1.2},
)


@dataclass(frozen=True)
class IkSolutions:
    """Solutions of many poses, flat: row i solves pose `pose[i]`.

    Attributes:
        pose: Index of the pose that a row solves, ascending, shape (m,).
        q: Joint positions in [rad], shape (m, 7).
        margin: Distance to the nearest joint limit in [rad], shape (m,).
        position_error: In [m], shape (m,).
        rotation_error: In [rad], shape (m,).
    """

    pose: NDArray[np.int64]
    q: NDArray[np.float64]
    margin: NDArray[np.float64]
    position_error: NDArray[np.float64]
    rotation_error: NDArray[np.float64]


@dataclass(frozen=True)
class ArmKinematics:
    """Geometry of a seven-joint arm whose joints all turn about their own z axis.

    Attributes:
        offsets: Position of each joint in the frame of the one before, in [m], shape (7, 3).
        turns: Rotation of each joint's frame at q = 0 in the frame of the one before, shape (7, 3, 3).
        tool_offset: Position of the tool in the last joint's frame in [m], shape (3,).
        tool_turn: Rotation of the tool in the last joint's frame, shape (3, 3).
        q_min, q_max: Joint limits in [rad], shape (7,).
    """

    offsets: NDArray[np.float64]
    turns: NDArray[np.float64]
    tool_offset: NDArray[np.float64]
    tool_turn: NDArray[np.float64]
    q_min: NDArray[np.float64]
    q_max: NDArray[np.float64]

    @classmethod
    def from_urdf(cls, path: Path | None = None, gripper: GripperModel = PANDA_HAND) -> "ArmKinematics":
        """Read the arm from a URDF.

        Args:
            path: URDF file; the Panda's of example-robot-data by default.
            gripper: Whose tool centre point; one that is not in the URDF is mounted on the default file only.

        Raises:
            ConfigError: The file does not start with seven joints about z or has no frame `panda_hand_tcp`.
        """
        import pinocchio as pin  # type: ignore[import-not-found]

        from control.robot.description_files import panda_urdf

        file = path or panda_urdf()
        if gripper.mounting is not None and path is not None:
            raise ConfigError(f"'{gripper.name}' can be mounted on the Panda's own URDF only, not on {file.name}")
        model = pin.buildModelFromUrdf(str(file)) if gripper.mounting is None else arm_model(gripper, gripper.opening)
        kinds = [model.joints[i].shortname() for i in range(1, min(8, model.njoints))]
        if kinds != ["JointModelRZ"] * 7 or not model.existFrame(TCP_FRAME):
            raise ConfigError(
                f"{file.name} must start with seven revolute joints about z and have a frame '{TCP_FRAME}'; "
                f"its first joints are {kinds}"
            )
        frame = model.frames[model.getFrameId(TCP_FRAME)]
        if frame.parentJoint != 7:
            raise ConfigError(f"'{TCP_FRAME}' of {file.name} must be fixed to joint 7, not {frame.parentJoint}")
        placements = [model.jointPlacements[i] for i in range(1, 8)]
        return cls(
            offsets=np.array([p.translation for p in placements]),
            turns=np.array([p.rotation for p in placements]),
            tool_offset=np.array(frame.placement.translation),
            tool_turn=np.array(frame.placement.rotation),
            q_min=np.array(model.lowerPositionLimit[:7]),
            q_max=np.array(model.upperPositionLimit[:7]),
        )

    def forward(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Tool poses.

        Args:
            q: Joint positions in [rad], shape (n, 7).

        Returns:
            Positions in [m], shape (n, 3), and rotations, shape (n, 3, 3), in the base frame.
        """
        position, rotation, _, _ = self._chain(q)
        return position, rotation

    def jacobian(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Tool poses and geometric Jacobians, J = [z_i x (p - o_i); z_i].

        Args:
            q: Joint positions in [rad], shape (n, 7).

        Returns:
            Positions, shape (n, 3), rotations, shape (n, 3, 3), and Jacobians, shape (n, 6, 7): linear velocity of the
            tool in [m/s] over angular velocity in [rad/s], in base axes, per [rad/s] of each joint.
        """
        position, rotation, axes, origins = self._chain(q)
        jacobian = np.empty((len(position), 6, 7))
        for i in range(7):
            axis, arm = axes[i], position - origins[i]
            jacobian[:, 0, i] = axis[:, 1] * arm[:, 2] - axis[:, 2] * arm[:, 1]
            jacobian[:, 1, i] = axis[:, 2] * arm[:, 0] - axis[:, 0] * arm[:, 2]
            jacobian[:, 2, i] = axis[:, 0] * arm[:, 1] - axis[:, 1] * arm[:, 0]
            jacobian[:, 3:, i] = axis
        return position, rotation, jacobian

    def margin(self, q: np.ndarray) -> np.ndarray:
        """Distance to the nearest joint limit in [rad], negative beyond it: shape (n, 7) → (n,)."""
        return np.minimum(q - self.q_min, self.q_max - q).min(axis=-1)

    def poses(self, q: np.ndarray) -> np.ndarray:
        """Tool poses as transforms base_T_tool: shape (n, 7) in [rad] → (n, 4, 4), translations in [m]."""
        poses = np.tile(np.eye(4), (len(q), 1, 1))
        poses[:, :3, 3], poses[:, :3, :3] = self.forward(q)
        return poses

    def errors(self, q: np.ndarray, targets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance in [m] and angle in [rad] between the tool and targets base_T_tool, (n, 4, 4); shapes (n,)."""
        error = _pose_error(*self.forward(q), targets)
        return np.linalg.norm(error[:, :3], axis=1), np.linalg.norm(error[:, 3:], axis=1)

    def solve_ik(
        self,
        targets: np.ndarray,
        seeds: np.ndarray | None = None,
        *,
        per_pose: int = 3,
        iterations: int = 40,
        min_margin: float = 0.03,
        position_tolerance: float = 1e-4,
        rotation_tolerance: float = 1e-3,
        distinct: float = 0.35,
    ) -> IkSolutions:
        """Several different configurations for each of many tool poses.

        Every pose is iterated from every seed: three quarters of the iterations with a weak pull towards REST_Q in
        the null space, the rest without. Solutions of a pose are listed in the order of the seeds that found them.

        Args:
            targets: Tool poses base_T_tool, shape (n, 4, 4), translations in [m].
            seeds: Start configurations in [rad], shape (s, 7) for all poses alike or (s, n, 7) for each its own;
                `default_seeds()` by default.
            per_pose: Most solutions to return for one pose.
            iterations: Most iterations from one seed.
            min_margin: Least distance to every joint limit in [rad].
            position_tolerance: Largest position error of a solution in [m].
            rotation_tolerance: Largest rotation error of a solution in [rad].
            distinct: Two solutions of a pose differ by at least this in some joint, in [rad].

        Raises:
            ValueError: The arrays' shapes do not fit together.
        """
        targets = np.asarray(targets, float)
        seeds = default_seeds() if seeds is None else np.asarray(seeds, float)
        count, starts = len(targets), len(seeds)
        if targets.shape != (count, 4, 4) or seeds.shape not in ((starts, 7), (starts, count, 7)):
            raise ValueError(
                f"need targets (n, 4, 4) and seeds (s, 7) or (s, n, 7); got {targets.shape} and {seeds.shape}"
            )
        q = np.broadcast_to(seeds[:, None] if seeds.ndim == 2 else seeds, (starts, count, 7)).reshape(-1, 7)
        goals = np.tile(targets, (starts, 1, 1))
        pulled = 3 * iterations // 4
        q = self.iterate_ik(q, goals, pulled, pull=0.003)
        q = self.iterate_ik(q, goals, iterations - pulled, done=(position_tolerance / 2, rotation_tolerance / 2))
        off, turned = self.errors(q, goals)
        margin = self.margin(q)
        good = (off <= position_tolerance) & (turned <= rotation_tolerance) & (margin >= min_margin)
        rows: list[int] = []
        for pose in range(count):
            kept: list[int] = []
            for row in range(pose, len(q), count):
                if len(kept) == per_pose:
                    break
                if good[row] and all(np.abs(q[row] - q[other]).max() > distinct for other in kept):
                    kept.append(row)
            rows += kept
        chosen = np.array(rows, dtype=int)
        return IkSolutions(chosen % max(count, 1), q[chosen], margin[chosen], off[chosen], turned[chosen])

    def follow(
        self,
        q: np.ndarray,
        targets: np.ndarray,
        *,
        iterations: int = 8,
        position_tolerance: float = 1e-3,
        rotation_tolerance: float = 1e-2,
        max_step: float = 0.5,
        min_margin: float = 0.02,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Continue from configurations along Cartesian paths, each waypoint starting from the one before.

        Args:
            q: Configurations before the first waypoint in [rad], shape (n, 7).
            targets: Waypoints base_T_tool, shape (n, k, 4, 4), translations in [m].
            iterations: Most iterations for one waypoint.
            position_tolerance: Largest position error at a waypoint in [m].
            rotation_tolerance: Largest rotation error at a waypoint in [rad].
            max_step: A joint that changes more between waypoints has jumped to another branch, in [rad].
            min_margin: Least distance to every joint limit in [rad].

        Returns:
            Joint paths in [rad], shape (n, k, 7), and whether every waypoint of a path was met, shape (n,). Rows of a
            path that was not met are best efforts.

        Raises:
            ValueError: The arrays' shapes do not fit together.
        """
        n, k = targets.shape[:2]
        if q.shape != (n, 7) or targets.shape != (n, k, 4, 4):
            raise ValueError(f"need q (n, 7) and targets (n, k, 4, 4); got {q.shape} and {targets.shape}")
        paths = np.empty((n, k, 7))
        ok = np.ones(n, dtype=bool)
        done = (position_tolerance / 4, rotation_tolerance / 4)
        for i in range(k):
            moved = self.iterate_ik(q, targets[:, i], iterations, done=done, margin=min_margin)
            off, turned = self.errors(moved, targets[:, i])
            jump = np.abs(moved - q).max(axis=1, initial=0.0)
            ok &= (off <= position_tolerance) & (turned <= rotation_tolerance) & (jump <= max_step)
            paths[:, i] = q = moved
        return paths, ok

    def iterate_ik(
        self,
        q: np.ndarray,
        targets: np.ndarray,
        iterations: int,
        *,
        pull: float = 0.0,
        done: tuple[float, float] = (0.0, 0.0),
        margin: float = 0.02,
    ) -> np.ndarray:
        """Damped least squares, every row towards its own pose.

            dq = n + J^T (J J^T + l^2 I)^-1 (e - J n),  n = pull (REST_Q - q),  l = 0.02 min(1, |e| / 0.2) + 0.001

        The error e is cut to 0.15 m and 0.6 rad per axis and the step to 0.25 rad per joint, so that far targets do
        not throw the arm about; damping fades near the target, where convergence becomes quadratic. Joints stay
        within their limits by clipping.

        Args:
            q: Start configurations in [rad], shape (n, 7).
            targets: Poses base_T_tool, shape (n, 4, 4), translations in [m].
            iterations: Number of steps.
            pull: Strength of the pull towards REST_Q in the null space, per step.
            done: Rows whose position error in [m] and rotation error in [rad] are below stop early.
            margin: Distance kept to the joint limits in [rad].

        Returns:
            Configurations in [rad], shape (n, 7).
        """
        low, high = self.q_min + margin, self.q_max - margin
        q = np.clip(q, low, high)
        rest = np.array(REST_Q)
        active = np.arange(len(q))
        for _ in range(iterations):
            now = q[active]
            position, rotation, jacobian = self.jacobian(now)
            error = _pose_error(position, rotation, targets[active])
            off, turned = np.linalg.norm(error[:, :3], axis=1), np.linalg.norm(error[:, 3:], axis=1)
            far = (off > done[0]) | (turned > done[1])
            if not far.all():
                active, now, jacobian, error = active[far], now[far], jacobian[far], error[far]
                if not len(active):
                    break
            damping = 0.02 * np.minimum(1.0, np.linalg.norm(error, axis=1) / 0.2) + 0.001
            error[:, :3] = np.clip(error[:, :3], -0.15, 0.15)
            error[:, 3:] = np.clip(error[:, 3:], -0.6, 0.6)
            null = pull * (rest - now)
            normal = jacobian @ jacobian.transpose(0, 2, 1)
            normal[:, range(6), range(6)] += damping[:, None] ** 2
            wanted = error[:, :, None] - jacobian @ null[:, :, None]
            step = null + (jacobian.transpose(0, 2, 1) @ np.linalg.solve(normal, wanted))[:, :, 0]
            q[active] = np.clip(now + np.clip(step, -0.25, 0.25), low, high)
        return q

    def _chain(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[np.ndarray], list[np.ndarray]]:
        """Tool position and rotation, and every joint's axis and origin."""
        n = len(q)
        cosine, sine = np.cos(q)[:, :, None], np.sin(q)[:, :, None]
        position = np.zeros((n, 3))
        rotation = np.broadcast_to(np.eye(3), (n, 3, 3))
        axes, origins = [], []
        for i in range(7):
            # One product over all rows: (3n, 3) @ (3, 3) is far quicker than n small products.
            rows = rotation.reshape(-1, 3)
            position = position + (rows @ self.offsets[i]).reshape(n, 3)
            turned = (rows @ self.turns[i]).reshape(n, 3, 3)
            x, y = turned[:, :, 0], turned[:, :, 1]
            rotation = np.empty((n, 3, 3))
            rotation[:, :, 0] = cosine[:, i] * x + sine[:, i] * y
            rotation[:, :, 1] = cosine[:, i] * y - sine[:, i] * x
            rotation[:, :, 2] = turned[:, :, 2]
            axes.append(rotation[:, :, 2])
            origins.append(position)
        rows = rotation.reshape(-1, 3)
        return (
            position + (rows @ self.tool_offset).reshape(n, 3),
            (rows @ self.tool_turn).reshape(n, 3, 3),
            axes,
            origins,
        )


def default_seeds() -> np.ndarray:
    """Start configurations that lead to different branches of solutions, the first is REST_Q; shape (10, 7)."""
    seeds = np.tile(np.array(REST_Q), (len(SEED_CHANGES), 1))
    for seed, changes in zip(seeds, SEED_CHANGES, strict=True):
        for joint, value in changes.items():
            seed[joint] = value
    return seeds


def _pose_error(position: np.ndarray, rotation: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Translation in [m] over rotation vector in [rad], in base axes, that leads to the targets; shape (n, 6)."""
    turn = rotation_log(targets[:, :3, :3] @ rotation.transpose(0, 2, 1))
    return np.concatenate([targets[:, :3, 3] - position, turn], axis=1)
