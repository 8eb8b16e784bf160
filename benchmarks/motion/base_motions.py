"""Planned motions of the built-in cells with their states in the twin: what faults are injected into."""

from dataclasses import dataclass, replace

import mujoco
import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.motion.motion_scenes import MOTIONS, OPEN_WIDTH, draw_estimate
from control.errors import RetimingError
from control.planners.motion_search import plan_motion
from control.planners.result import MotionPlan
from control.retiming.retime import retime
from control.robot.dynamics import Payload, RobotModel
from control.robot.kinematics import ArmKinematics
from control.robot.limits import REST_Q, RobotLimits, panda_limits
from control.safety.limits import SafetyLimits
from control.simulation.rollouts import Rollout
from control.tasks.reward_spec import RewardSpec
from control.trajectory.samples import SAMPLE_TIME, JointPath, Trajectory
from control.twin_model import TwinModel
from perception.estimates import ObjectEstimate, SceneEstimate
from sim_check.cells.loading import CellConfig, load_cell
from sim_check.twin.payloads import held_payloads
from sim_check.twin.twin import build_twin, possible_twins, worlds_to_try
from sim_check.verdict.replay import replay


@dataclass(frozen=True)
class Base:
    """One planned motion.

    Attributes:
        name: Of the motion and its seed.
        cell: Where.
        seen: What stands around.
        twin: Of what was seen.
        spec: What the motion achieves.
        safety: The cell's safety table.
        limits: Of the robot.
        trajectory: Retimed.
        others: Alternative paths of the same plan.
        rollout: States of the twin while the trajectory is played, every 2 ms.
        robot, arm: Models of the robot.
    """

    name: str
    cell: CellConfig
    seen: SceneEstimate
    twin: TwinModel
    spec: RewardSpec
    safety: SafetyLimits
    limits: RobotLimits
    trajectory: Trajectory
    others: tuple[JointPath, ...]
    rollout: Rollout
    robot: RobotModel
    arm: ArmKinematics

    def with_things(self, *things: ObjectEstimate) -> TwinModel:
        """The twin with further things around.

        Raises:
            StackError: They cannot stand there.
        """
        return build_twin(
            self.cell, replace(self.seen, objects=(*self.seen.objects, *things)), self.twin.q, self.twin.gripper_width
        )

    def states_in(self, twin: TwinModel, rows: np.ndarray) -> np.ndarray:
        """Rows of the rollout as configurations of a twin that has further things, those at rest, shape (n, nq)."""
        out = np.tile(twin.qpos, (len(rows), 1))
        for j in range(self.twin.model.njnt):
            joint = self.twin.model.joint(j)
            width = 7 if joint.type[0] == mujoco.mjtJoint.mjJNT_FREE else 1
            at, own = int(twin.model.joint(joint.name).qposadr[0]), int(joint.qposadr[0])
            out[:, at : at + width] = self.rollout.qpos[rows, own : own + width]
        return out


@dataclass(frozen=True)
class Case:
    """A motion to be judged.

    Attributes:
        kind: Fault or kind of good motion.
        trajectory, twin, spec, safety, payload: What is judged, where and by what.
        checks: Which of them are meant for this fault.
        culprit: The body that such a check has to name; None where any will do.
    """

    kind: str
    trajectory: Trajectory
    twin: TwinModel
    spec: RewardSpec
    safety: SafetyLimits
    payload: Payload | None = None
    checks: frozenset[str] = frozenset()
    culprit: str | None = None


def plan_base(motion: str, seed: int) -> Base | str:
    """Plan one motion as a run does, or tell why there is none."""
    task = MOTIONS[motion]
    cell, spec = load_cell(task.cell), task.spec(seed)
    seen, _ = draw_estimate(task, seed)
    twin = build_twin(cell, seen, np.array(REST_Q), OPEN_WIDTH)
    safety, limits, rng = cell.safety_limits(), panda_limits(), np.random.default_rng(seed)
    robot, arm = RobotModel.panda(), ArmKinematics.from_urdf()
    variants = possible_twins(twin, rng, worlds_to_try(twin))
    plan = plan_motion(twin, spec, safety, rng, kinematics=arm, nthread=1, variants=variants)
    if not isinstance(plan, MotionPlan):
        return f"{plan.kind}: {plan.message}"
    try:
        trajectory = retime(plan.path, robot, limits, safety, payloads=held_payloads(twin))
    except RetimingError as error:
        return f"not retimed: {error}"
    (rollout,), _ = replay(trajectory, [twin], safety.settle_time, nthread=1)
    return Base(
        f"{motion} {seed}",
        cell,
        seen,
        twin,
        spec,
        safety,
        limits,
        trajectory,
        plan.alternatives,
        rollout,
        robot,
        arm,
    )


def rescaled(trajectory: Trajectory, index: int, factor: float) -> Trajectory:
    """The same trajectory with one of its segments played faster or slower.

    Segments start and end at rest, so that a factor on time keeps it continuous: speeds grow with it, accelerations
    with its square, jerks with its cube.

    Args:
        trajectory: With segments.
        index: Of the segment.
        factor: On its speed.
    """
    segment = trajectory.segments[index]
    first, last = max(segment.start - 1, 0), segment.stop - 1  # the samples at rest on either side
    count = max(2, round((last - first) / factor) + 1)
    spline = CubicSpline(np.arange(first, last + 1) * SAMPLE_TIME, trajectory.q[first : last + 1], bc_type="clamped")
    q = spline(np.linspace(first, last, count) * SAMPLE_TIME)
    # Central differences, at rest at the ends: the derivatives that belong to these very samples.
    qd, qdd = np.zeros_like(q), np.zeros_like(q)
    qd[1:-1] = (q[2:] - q[:-2]) / (2 * SAMPLE_TIME)
    qdd[1:-1] = (q[2:] - 2 * q[1:-1] + q[:-2]) / SAMPLE_TIME**2
    return spliced(trajectory, first, last, q, qd, qdd)


def spliced(
    trajectory: Trajectory, first: int, last: int, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray
) -> Trajectory:
    """A trajectory with its samples first..last (inclusive) replaced; what comes later is later or earlier by as much.

    Args:
        trajectory: Which.
        first, last: Rows that are replaced, within one segment.
        q, qd, qdd: Samples in their place, shape (n, 7); they belong to that segment.
    """
    longer = len(q) - (last - first + 1)

    def join(old: np.ndarray, new: np.ndarray) -> np.ndarray:
        return np.concatenate([old[:first], new, old[last + 1 :]])

    def moved(row: int) -> int:
        return row + longer if row > last else row

    return Trajectory(
        join(trajectory.q, q),
        join(trajectory.qd, qd),
        join(trajectory.qdd, qdd),
        tuple(
            replace(e, time=e.time + longer * SAMPLE_TIME) if round(e.time / SAMPLE_TIME) >= last else e
            for e in trajectory.gripper
        ),
        tuple(replace(s, start=moved(s.start), stop=moved(s.stop)) for s in trajectory.segments),
        trajectory.joint_names,
    )
