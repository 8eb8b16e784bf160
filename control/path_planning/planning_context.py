"""What the generators of candidates share: the twin, inverse kinematics in its world, the filter, free ways."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np
from numpy.typing import NDArray

from control.errors import ConfigError
from control.path_planning.collision_filter import NEAR_MARGIN, CollisionFilter, ObjectAt, Phase, body_name
from control.path_planning.rrt_connect import free_path, rrt_connect
from control.robot.kinematics import ArmKinematics, default_seeds
from control.robot.limits import REST_Q, RobotLimits
from control.safety.limits import SafetyLimits
from control.tasks.posed_object import PosedObject
from control.tasks.reward_spec import PALM, RewardSpec, RewardTerm
from control.tasks.subtasks import Subtask, palm_at, posed_objects
from control.twin_model import ARM_BODIES, FINGER_BODIES, HAND_BODY, TABLE_BODY, TwinModel

CARTESIAN_STEP = 0.02  # [m] between waypoints of straight moves of the hand
IK_POSITION, IK_ROTATION = 5e-4, 5e-3  # [m], [rad]: a tenth of what perception knows
TOOL_TOLERANCE = 1e-4  # [m] between the twin's tool and that of the kinematics
LIMIT_MARGIN = 0.05  # [rad] kept from joint limits, more than the judge asks for


@dataclass
class PlanningContext:
    """One search's surroundings; counts say where candidates were lost.

    Attributes:
        twin, subtask, safety, limits, arm, rng: As given to the search.
        spec: All terms, where there are others about the subject beside the primary one.
        objects: The twin's objects at the start.
        supports: Names of what the subject stands on at the start.
        filter: Knows which configurations are free.
        vias: Waypoints for free paths.
        rest_palm: Tool centre point in the rest configuration in [m], shape (3,).
        counts: Candidates by stage.
        driven_to: Fraction of its range to which the subject, a joint, can be driven where the goal is out of reach;
            None where no shorter way was found or looked for.
    """

    twin: TwinModel
    subtask: Subtask
    safety: SafetyLimits
    limits: RobotLimits
    arm: ArmKinematics
    rng: np.random.Generator
    spec: RewardSpec | None = None
    objects: dict[str, PosedObject] = field(init=False)
    supports: tuple[str, ...] = field(init=False)
    filter: CollisionFilter = field(init=False)
    vias: list[np.ndarray] = field(init=False)
    rest_palm: NDArray[np.float64] = field(init=False)
    counts: Counter[str] = field(default_factory=Counter)
    driven_to: float | None = None
    _base_T_world: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        data = self.twin.start()
        self.objects = posed_objects(self.twin, data)
        handled = self._handled
        self.supports = tuple(sorted(resting_on(self.twin.model, data, handled))) if handled else ()
        self.filter = CollisionFilter(self.twin, self.safety, handled, self._allowed)
        self.vias = _vias(self.limits, self.rng)
        self.rest_palm = palm_at(self.twin, REST_Q)
        base = data.body(ARM_BODIES[0])
        rotation = base.xmat.reshape(3, 3)
        self._base_T_world = np.eye(4)
        self._base_T_world[:3, :3] = rotation.T
        self._base_T_world[:3, 3] = -rotation.T @ base.xpos
        self._require_same_tool()

    def _require_same_tool(self) -> None:
        """Kinematics of another gripper would send this one's fingers somewhere else."""
        base_T_tcp = self._base_T_world @ self.filter.tcp_pose(self.start_q)
        position = self.arm.forward(self.start_q[None])[0][0]
        apart = float(np.linalg.norm(position - base_T_tcp[:3, 3]))
        if apart > TOOL_TOLERANCE:
            raise ConfigError(
                f"the arm's kinematics put the tool {apart * 1e3:.1f} mm from where the twin's gripper "
                f"'{self.twin.gripper.name}' has it; make them with ArmKinematics.from_urdf(gripper=twin.gripper)"
            )

    @property
    def _handled(self) -> str | None:
        return self.subtask.subject or self.twin.held

    @property
    def _allowed(self) -> set[str]:
        """What the handled object may touch."""
        return {*self.supports, TABLE_BODY, *([self.subtask.target] if self.subtask.target else [])}

    @property
    def base_position(self) -> np.ndarray:
        """Where the robot stands, in the world in [m], shape (3,)."""
        return -self._base_T_world[:3, :3].T @ self._base_T_world[:3, 3]

    def near_filter(self) -> CollisionFilter:
        """A filter for the last stretch to a grasp, with `NEAR_MARGIN`; who is too close is counted with `filter`."""
        out = CollisionFilter(self.twin, self.safety, self._handled, self._allowed, margin=NEAR_MARGIN)
        out.rejected_by = self.filter.rejected_by
        return out

    @property
    def start_q(self) -> np.ndarray:
        """Arm at the start in [rad], shape (7,)."""
        return np.asarray(self.twin.q, float)

    def solve(self, targets: np.ndarray, per_pose: int = 2) -> tuple[np.ndarray, np.ndarray]:
        """Several configurations for each pose of the tool.

        Args:
            targets: Poses in the world, shape (n, 4, 4).
            per_pose: Most configurations of one pose.

        Returns:
            Index of the pose that each row solves, shape (m,), and joints in [rad], shape (m, 7).
        """
        if not len(targets):
            return np.zeros(0, int), np.zeros((0, 7))
        seeds = np.vstack([self.start_q[None], default_seeds()[:6]])
        found = self.arm.solve_ik(
            self._base_T_world @ targets,
            seeds,
            per_pose=per_pose,
            iterations=24,
            min_margin=LIMIT_MARGIN,
            position_tolerance=IK_POSITION,
            rotation_tolerance=IK_ROTATION,
        )
        return found.pose, found.q

    def solve_from(self, targets: np.ndarray, seeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """One configuration for each pose, each from its own seed; like `solve` with seeds (n, 7)."""
        base = self._base_T_world @ targets
        q = self.arm.iterate_ik(seeds, base, 24, done=(IK_POSITION / 2, IK_ROTATION / 2), margin=LIMIT_MARGIN)
        off, turned = self.arm.errors(q, base)
        rows = np.flatnonzero((off <= IK_POSITION) & (turned <= IK_ROTATION))
        return rows, q[rows]

    def follow(
        self, q: np.ndarray, targets: Sequence[np.ndarray], rough: bool = False
    ) -> tuple[list[np.ndarray], np.ndarray]:
        """Continue from configurations along Cartesian paths of different lengths.

        Args:
            q: Configurations before the first waypoint in [rad], shape (n, 7).
            targets: Poses in the world, n arrays of shape (k_i, 4, 4).
            rough: Whether waypoints are far apart: more iterations, and joints may go further between them.

        Returns:
            Joint paths, n arrays of shape (k_i, 7), and whether each was met without a jump, shape (n,).
        """
        if not len(q):
            return [], np.zeros(0, bool)
        longest = max(len(t) for t in targets)
        padded = np.stack([np.concatenate([t, np.repeat(t[-1:], longest - len(t), axis=0)]) for t in targets])
        iterations, step = (15, 1.2) if rough else (5, 0.5)
        goals = self._base_T_world @ padded
        paths, ok = self.arm.follow(q, goals, iterations=iterations, max_step=step, min_margin=LIMIT_MARGIN)
        return [path[: len(t)] for path, t in zip(paths, targets, strict=True)], ok

    def way(
        self,
        start: np.ndarray,
        end: np.ndarray,
        phase: Phase,
        width: float,
        object_at: ObjectAt,
        planner: bool = False,
    ) -> np.ndarray | None:
        """A free path, shape (n, 7): straight or through a waypoint; with `planner`, RRT-connect as a last resort."""

        def clear(q: np.ndarray) -> bool:
            return self.filter.clear(q, phase, width, object_at)

        self.counts["transits"] += 1
        path = free_path(start, end, clear, self.vias)
        if path is None and planner:
            self.counts["transits_planned"] += 1
            path = rrt_connect(start, end, clear, self.limits, self.rng)
        if path is None:
            self.counts["transits_blocked"] += 1
        return path


def other_terms(context: PlanningContext) -> list[RewardTerm]:
    """Terms about the subject beside the primary one, those about the palm left out."""
    terms = () if context.spec is None else context.spec.terms
    subject = context.subtask.subject
    return [
        t for t in terms if not t.primary and subject in (t.subject, t.carries) and PALM not in (t.subject, t.target)
    ]


def resting_on(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> set[str]:
    """Names of the bodies that touch a free body, the robot's apart; what is part of furniture rests on nothing."""
    body = model.body(name).id
    if model.body_dofnum[body] != 6:
        return set()
    out: set[str] = set()
    for a, b in model.geom_bodyid[data.contact.geom[: data.ncon]]:
        if body in (a, b):
            out.add(body_name(model, int(b if a == body else a)))
    return out - {*ARM_BODIES, HAND_BODY, *FINGER_BODIES}


def straight_targets(start: np.ndarray, move: np.ndarray) -> np.ndarray:
    """Poses (n, 4, 4) along a straight move of a pose by `move` [m], without the start."""
    count = max(2, int(np.ceil(np.linalg.norm(move) / CARTESIAN_STEP)))
    out = np.repeat(start[None], count, axis=0)
    out[:, :3, 3] += np.linspace(0, 1, count + 1)[1:, None] * move
    return out


def path_length(path: np.ndarray) -> float:
    """Sum over a path (n, 7) of the largest joint motion between waypoints in [rad]."""
    return float(np.abs(np.diff(path, axis=0)).max(axis=1).sum()) if len(path) > 1 else 0.0


def _vias(limits: RobotLimits, rng: np.random.Generator) -> list[np.ndarray]:
    """Waypoints for free paths: rest, rest drawn back, rest turned to either side, and two at random."""
    rest = np.array(REST_Q)
    back, left, right = rest.copy(), rest.copy(), rest.copy()
    back[[1, 3]] = -1.2, -2.5
    left[0], right[0] = 0.7, -0.7
    wild = [np.clip(rest + rng.normal(0, 0.4, 7), limits.q_min + 0.05, limits.q_max - 0.05) for _ in range(2)]
    return [rest, back, left, right, *wild]
