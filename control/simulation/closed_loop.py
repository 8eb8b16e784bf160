"""A motion executed in the twin as it is planned: where everything is after each period, and whether the goal is met.

The motion counts as done when the primary term is met and still is after a short rest, in which the hand opens where
the object has to be let go: met in one sample, in passing, is not enough.
"""

import mujoco
import numpy as np

from control.robot.limits import REST_Q, panda_limits
from control.simulation.batches import Observer, SimulatedBatch, simulate
from control.simulation.executed_motion import MotionPiece, contact_at, geom_names
from control.simulation.rollouts import Commands, commands_for, controls_for, roll_out
from control.tasks.predicates import judge_term
from control.tasks.reward_spec import RewardSpec
from control.tasks.subtasks import Subtask, palm_at, posed_objects
from control.tasks.terms.views import TermJudgement
from control.trajectory.samples import JointPath
from control.twin_model import FINGER_JOINTS, TCP_SITE, TwinModel

SETTLE = 0.3  # [s] at rest after which a term has to be met still


class ClosedLoop:
    """The motion as executed so far, and the twin's state at its end."""

    def __init__(
        self, twin: TwinModel, spec: RewardSpec, task: Subtask, nthread: int, observe: Observer | None
    ) -> None:
        self.twin, self.task, self.nthread, self.observe = twin, task, nthread, observe
        self.limits = panda_limits()
        self.dt = float(twin.model.opt.timestep)
        self.data = twin.start()
        self.rest_palm = palm_at(twin, REST_Q)
        self._term, self._names = spec.primary, geom_names(twin)
        self._at_start = posed_objects(twin, self.data)
        self._finger = int(twin.model.joint(FINGER_JOINTS[0]).qposadr[0])
        self.qpos = self.data.qpos.copy()
        self.qvel = np.zeros(twin.model.nv)
        self.warmstart = np.zeros(twin.model.nv)
        self.command, self.speed = np.array(twin.q, float), np.zeros(7)  # [rad], [rad/s]
        self.closed = twin.held is not None or twin.gripper_width < twin.gripper.opening / 4
        self.opening = twin.gripper.opening if self.closed else twin.gripper_width
        self.finger_target = 0.0 if twin.held else twin.gripper_width / 2
        self.pieces: list[MotionPiece] = []
        self.steps, self.time = 0, 0.0
        self.finished = False
        self.at_start = self.nearest = self.judge()
        self.nearest_at = 0.0

    @property
    def finger(self) -> float:
        """Where one finger is, half the distance between the pads in [m]."""
        return float(self.qpos[self._finger])

    def judge(self, data: mujoco.MjData | None = None) -> TermJudgement:
        """The primary term as things are now, or in other data with up-to-date kinematics."""
        state = self.data if data is None else data
        palm = state.site(TCP_SITE).xpos
        objects, fractions = posed_objects(self.twin, state), self.twin.joint_fractions(state.qpos)
        return judge_term(
            self._term, objects, palm, self.rest_palm, self._at_start, self.twin.support_height, fractions
        )

    def run(self, commands: Commands, closed: np.ndarray) -> None:
        """Execute some steps; `closed` says whether the fingers are told to be closed, shape (n,)."""
        controls = controls_for(self.twin.model, commands)[None]
        record = self.simulate(controls, ("qpos", "qvel", "qacc_warmstart"))
        self.qpos, self.qvel = record["qpos"][0, -1].copy(), record["qvel"][0, -1].copy()
        self.warmstart = record["qacc_warmstart"][0, -1].copy()
        self.command, self.speed = commands.arm[-1].copy(), commands.arm_speed[-1].copy()
        self.closed, self.finger_target = bool(closed[-1]), float(commands.finger[-1])
        self.time += len(closed) * self.dt
        self.data.qpos[:], self.data.qvel[:], self.data.ctrl[:] = self.qpos, self.qvel, controls[0, -1]
        mujoco.mj_forward(self.twin.model, self.data)
        width = 2 * record["qpos"][0, :, self._finger]
        self.pieces.append(MotionPiece(commands.arm, closed, width, contact_at(self.twin, self.data, self._names)))
        judged = self.judge()
        if judged.residual < self.nearest.residual:
            self.nearest, self.nearest_at = judged, self.time

    def finger_targets(self, closed: np.ndarray, counts: np.ndarray) -> np.ndarray:
        """Targets of the fingers, which move at their finite speed: half the distance between the pads in [m].

        Closed fingers press with the servo's whole force; opening ones set out from where they are.

        Args:
            closed: Whether to close, one column per stretch, shape (n, k).
            counts: Steps of each stretch, shape (k,).

        Returns:
            Shape (n, sum of counts).
        """
        at = np.full(len(closed), self.finger_target)
        out = []
        for shut, count in zip(closed.T, counts, strict=True):
            at = np.where(shut, at, np.maximum(at, min(self.finger, self.opening / 2)))
            way = np.arange(1, count + 1) * self.twin.gripper.planned_speed * self.dt
            closing = np.maximum(at[:, None] - way, 0.0)
            opening = np.minimum(at[:, None] + way, self.opening / 2)
            out.append(np.where(shut[:, None], closing, opening))
            at = out[-1][:, -1]
        return np.concatenate(out, axis=1)

    def simulate(self, controls: np.ndarray, record: tuple[str, ...]) -> dict[str, np.ndarray]:
        """Simulate motions, all from where this one is now; controls (n, steps, nu)."""
        n = len(controls)
        batch = SimulatedBatch(
            (self.twin.model,) * n,
            np.tile(self.qpos, (n, 1)),
            np.tile(self.qvel, (n, 1)),
            np.tile(self.warmstart, (n, 1)),
            controls,
            self.nthread,
        )
        self.steps += batch.steps
        return simulate(batch, record, self.observe)

    def done(self) -> bool:
        """Whether the primary term is met, and still is after the hand has let go where it must and all is at rest."""
        if not self.judge().met:
            return False
        opens = self.task.releases and self.closed and self.task.subject is not None
        closed = self.closed and not opens
        way = self.opening / 2 / self.twin.gripper.planned_speed if opens else 0.0
        count = round((SETTLE + way) / self.dt)
        fingers = self.finger_targets(np.full((1, 1), closed), np.full(1, count))[0]
        still = Commands(np.tile(self.command, (count, 1)), np.zeros((count, 7)), fingers, ())
        self.run(still, np.full(count, closed))
        self.finished = self.judge().met
        return self.finished

    def met_by(self, path: JointPath) -> bool:
        """Whether the path, played from the twin's start with stops between its segments, meets the term."""
        commands = commands_for(path.segments, self.twin, self.limits)
        rollouts, steps = roll_out([self.twin], [commands], self.nthread, observe=self.observe)
        self.steps += steps
        data = mujoco.MjData(self.twin.model)
        data.qpos[:] = rollouts[0].qpos[-1]
        mujoco.mj_kinematics(self.twin.model, data)
        return not rollouts[0].exploded and self.judge(data).met
