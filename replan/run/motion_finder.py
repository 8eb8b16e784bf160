"""Finding a motion: planned in the twin of what was seen, timed, judged there, and passed or not."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from control.errors import RetimingError, StackError
from control.planners.looking import LookPlan, WristCamera, plan_look
from control.planners.motion_search import plan_motion
from control.planners.result import MotionPlan, MotionStats
from control.planners.several_terms import after as after_plan
from control.retiming.retime import retime
from control.robot.dynamics import RobotModel
from control.robot.kinematics import ArmKinematics
from control.safety.certificate import Verdict
from control.safety.swept_volume import SweptUnseen
from control.tasks.failure import FailureCause
from control.tasks.reward_spec import RewardSpec
from control.trajectory.samples import JointPath, Trajectory
from control.twin_model import TwinModel
from perception.estimates import SceneEstimate
from replan.run.session import RunSession
from sim_check.diagnosis.blocking_bodies import diagnose
from sim_check.twin.payloads import held_payloads
from sim_check.twin.twin import build_twin, possible_twins, worlds_to_try
from sim_check.verdict.verdict import judge_in_detail

MAX_PATHS_JUDGED = 3  # a path that fails its verdict may have a better alternative; more than this is a replan's job

TOLD = 0.01  # share of the way that nobody saw from which on people are told


@dataclass(frozen=True)
class MotionStart:
    """Where a motion begins: arm joints in [rad], shape (7,), pads' distance in [m], and what is in the hand."""

    q: np.ndarray
    gripper_width: float
    held: str | None


@dataclass(frozen=True)
class JudgedMotion:
    """A motion that passed its verdict.

    Attributes:
        spec: What it achieves; None for a motion that only brings a camera somewhere.
        twin, twin_after: Where it was judged, and the same as the motion leaves it.
        trajectory, verdict: The samples, and what was found about exactly these.
    """

    spec: RewardSpec | None
    twin: TwinModel
    twin_after: TwinModel
    trajectory: Trajectory
    verdict: Verdict

    @property
    def subject(self) -> str:
        """What it is about, for causes of failures."""
        return "look" if self.spec is None else self.spec.primary.subject

    @property
    def ends(self) -> MotionStart:
        """Where the next motion begins."""
        return MotionStart(self.trajectory.q[-1], self.twin_after.gripper_width, self.twin_after.held)


@dataclass(frozen=True)
class BlindWay:
    """What nobody has seen of a way that was judged, and the twin that it was judged in."""

    twin: TwinModel
    unseen: SweptUnseen


class MotionFinder:
    """Plans in the twin and judges there.

    Args:
        session: The run.
        seed: Of motion search and of the perturbed twins.
        robot: Rigid-body model of the arm with its gripper.

    Attributes:
        steps: Simulated steps spent so far.
        blind: Of the way that was judged last; None where none was, or no camera has looked.
    """

    def __init__(self, session: RunSession, seed: int, robot: RobotModel) -> None:
        self._session = session
        self._safety = session.cell.safety_limits()
        self._rng = np.random.default_rng(seed)
        self._robot = robot
        self._kinematics = ArmKinematics.from_urdf(gripper=session.cell.robot.gripper_model)
        self.steps = 0
        self.blind: BlindWay | None = None

    def twin_of(self, scene: SceneEstimate, start: MotionStart) -> TwinModel:
        """The twin of a scene with the robot where it is.

        Raises:
            StackError: What was seen cannot stand like that.
        """
        return build_twin(self._session.cell, scene, start.q, start.gripper_width, start.held)

    def find(self, spec: RewardSpec, scene: SceneEstimate, start: MotionStart) -> JudgedMotion | FailureCause:
        """A motion that passed its verdict, or why there is none.

        Args:
            spec: What to achieve.
            scene: What was seen, or what a rehearsal says will be.
            start: Where the robot begins.
        """
        self.blind = None
        try:
            twin = self.twin_of(scene, start)
        except StackError as error:
            # What was seen cannot stand like that: a reason to look again, not to end the run.
            return FailureCause("not_seen", spec.primary.subject, f"no twin of what was seen: {error}")
        variants = possible_twins(twin, self._rng, worlds_to_try(twin))
        plan = plan_motion(
            twin,
            spec,
            self._safety,
            self._rng,
            kinematics=self._kinematics,
            variants=variants,
            limits=self._session.limits,
        )
        if isinstance(plan, FailureCause):
            with self._session.watch.part("diagnosis"):
                cause = diagnose(twin, spec, plan, self._safety, self._rng, self._kinematics)
            self.steps += int(cause.evidence.get("steps", 0))
            return cause
        self.steps += plan.stats.steps
        self._session.say(f"motion: {plan.description} ({plan.stats.steps} steps, {plan.stats.seconds:.1f} s)")
        self._session.episode.log("motion", description=plan.description, cost=plan.cost, stats=plan.stats)
        judged = self._judge_first_that_passes((plan.path, *plan.alternatives), twin, spec)
        if isinstance(judged, FailureCause):
            return judged
        return JudgedMotion(spec, twin, after_plan(twin, plan), *judged)

    def find_look(
        self, twin: TwinModel, points: np.ndarray, camera: WristCamera, closer: bool = False
    ) -> JudgedMotion | FailureCause:
        """A motion that brings the wrist camera to where it sees a region and that passed its verdict, or why not.

        Args:
            twin: Of what was seen.
            points: Of the region in the world in [m], shape (n, 3).
            camera: On the hand.
            closer: Whether a nearer view is better.
        """
        plans = plan_look(twin, points, camera, self._safety, self._session.limits, self._rng, self._kinematics, closer)
        if not plans:
            return FailureCause(
                "no_candidate", "look", "no free way leads the wrist camera to where it would see there"
            )
        self._session.say(f"motion: {plans[0].text}")
        judged = self._judge_first_that_passes([plan.path for plan in plans], twin, None)
        if isinstance(judged, FailureCause):
            return judged
        return JudgedMotion(None, twin, after_plan(twin, _as_motion(plans[0])), *judged)

    def _judge_first_that_passes(
        self, paths: Sequence[JointPath], twin: TwinModel, spec: RewardSpec | None
    ) -> tuple[Trajectory, Verdict] | FailureCause:
        cause: FailureCause | None = None
        subject = "look" if spec is None else spec.primary.subject
        handled = frozenset({twin.held} if spec is None and twin.held else ())
        for path in paths[:MAX_PATHS_JUDGED]:
            try:
                with self._session.watch.part("retiming"):
                    trajectory = retime(
                        path, self._robot, self._session.limits, self._safety, payloads=held_payloads(twin)
                    )
            except RetimingError as error:
                self._session.episode.log("retiming_failed", reason=str(error))
                cause = FailureCause("no_candidate", subject, f"the path cannot be timed: {error}")
                continue
            with self._session.watch.part("verdict"):
                judged = judge_in_detail(
                    trajectory,
                    twin,
                    self._safety,
                    self._session.limits,
                    self._rng,
                    spec=spec,
                    handled=handled,
                    robot=self._robot,
                )
            verdict, unseen = judged.verdict, judged.unseen
            if unseen is not None and twin.seen is not None:
                self.blind = BlindWay(twin, unseen)
            self.steps += verdict.steps
            self._session.episode.log(
                "verdict", verdict=verdict, duration=trajectory.duration, unseen=unseen and unseen.record
            )
            share = f"{verdict.successes}/{verdict.trials} perturbed twins"
            if verdict.passed:
                blind = f"; {unseen.hidden:.0%} of the way was not seen" if unseen and unseen.hidden >= TOLD else ""
                self._session.say(f"verdict: safe, {share}, {trajectory.duration:.1f} s long{blind}")
                return trajectory, verdict
            failed = verdict.failed_checks
            why = (
                "; ".join(f"{c.name} {c.worst:.3g} {c.unit} (limit {c.limit:.3g})" for c in failed[:3])
                or f"it succeeded in only {share}"
            )
            self._session.say(f"verdict: refused, {why}")
            cause = FailureCause(
                "unsafe",
                subject,
                f"the motion was refused in the twin: {why}",
                # Joint checks name joints there; only objects are anything to reason about.
                bodies=tuple(b for b in failed[0].bodies if twin.get(b)) if failed else (),
                check=failed[0].name if failed else "success_rate",
            )
        assert cause is not None  # a plan has at least one path
        return cause

    def explain(self, spec: RewardSpec, scene: SceneEstimate, start: MotionStart) -> FailureCause | None:
        """Why a motion that was played as planned does not show: a lock, or bodies in the way; None for anything else.

        Args:
            spec: What it should have achieved.
            scene: What is seen now.
            start: Where the robot is.
        """
        try:
            twin = self.twin_of(scene, start)
        except StackError:
            return None  # the next attempt says so
        cause = diagnose(twin, spec, None, self._safety, self._rng, self._kinematics)
        self.steps += int(cause.evidence.get("steps", 0))
        if cause.kind not in ("locked", "blocked_by"):
            return None
        self._session.episode.log("explained", cause=cause)
        return cause


def _as_motion(plan: LookPlan) -> MotionPlan:
    return MotionPlan(plan.path, plan.text, 0.0, MotionStats(0, 0.0, {}))
