"""Hands of a run: from a reward spec to a motion that was judged in the twin and then played by the robot."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from control.errors import ConfigError, RefusedError, RetimingError, StackError, StoppedError
from control.motion_files.trajectory_file import write_trajectory
from control.planners.motion_search import plan_motion
from control.planners.result import MotionPlan
from control.planners.several_terms import after as after_plan
from control.retiming.retime import retime
from control.robot.dynamics import RobotModel
from control.robot.kinematics import ArmKinematics
from control.robot.limits import REST_Q, RobotLimits
from control.safety.certificate import Verdict
from control.safety.certification import issue_certificate, limits_hash
from control.tasks.failure import FailureCause
from control.tasks.reward_spec import RewardSpec
from control.trajectory.samples import SAMPLE_TIME, Trajectory
from control.twin_model import TwinModel
from hw_interface.errors import CameraGoneError
from perception.estimates import SceneEstimate
from planning.baselines.rehearsal import Rehearsal
from planning.loop.interfaces import AttemptResult
from replan.run.episode import Episode
from replan.run.film import FILM_RATE, Film
from replan.run.stopwatch import Stopwatch
from sim_check.cells.loading import CellConfig
from sim_check.diagnosis.blocking_bodies import diagnose
from sim_check.models.render import render_twin
from sim_check.twin.payloads import held_payloads
from sim_check.twin.predicted_scene import predicted_scene
from sim_check.twin.twin import build_twin, possible_twins, worlds_to_try
from sim_check.verdict.verdict import judge_trajectory

if TYPE_CHECKING:
    from hw_interface.cell.client import CellClient, ExecutionReport, MotionProgress

MAX_PATHS_JUDGED = 3  # a path that fails its verdict may have a better alternative; more than this is a replan's job


@dataclass(frozen=True)
class _Start:
    """Where a motion begins: arm joints in [rad], shape (7,), pads' distance in [m], and what is in the hand."""

    q: np.ndarray
    gripper_width: float
    held: str | None


@dataclass(frozen=True)
class _JudgedMotion:
    """A motion that passed its verdict.

    Attributes:
        spec: What it achieves.
        twin, twin_after: Where it was judged, and the same as the motion leaves it.
        trajectory, verdict: The samples, and what was found about exactly these.
    """

    spec: RewardSpec
    twin: TwinModel
    twin_after: TwinModel
    trajectory: Trajectory
    verdict: Verdict

    @property
    def ends(self) -> _Start:
        """Where the next motion begins."""
        return _Start(self.trajectory.q[-1], self.twin_after.gripper_width, self.twin_after.held)


class TwinCheckedExecutor:
    """Plans in the twin, judges there, and sends the robot nothing that did not pass.

    Args:
        client: Connection to the robot's side.
        cell: The cell file; never the simulated cell's truth.
        limits: Published limits of the robot's profile.
        seed: Of motion search and of the perturbed twins.
        episode: Record of the run.
        film: Gets a picture of the twin and of the cell while it moves.
        filming: Whether to take pictures while the robot moves.
        say: Progress for people.
        watch: Shares out the run's time.
    """

    def __init__(
        self,
        client: "CellClient",
        cell: CellConfig,
        limits: RobotLimits,
        seed: int,
        episode: Episode,
        film: Film,
        filming: bool,
        say: Callable[[str], None],
        watch: Stopwatch,
    ) -> None:
        self._client = client
        self._cell = cell
        self._limits = limits
        self._safety = cell.safety_limits()
        self._rng = np.random.default_rng(seed)
        self._episode = episode
        self._film = film
        self._filming = filming
        self._say = say
        self._watch = watch
        self._gripper = cell.robot.gripper_model
        self._robot = RobotModel.panda(gripper=self._gripper)
        self._kinematics = ArmKinematics.from_urdf(gripper=self._gripper)
        self._held: str | None = None
        self._last_filmed = -1
        self.steps = 0  # simulated steps spent so far
        self.trajectories_sent = 0

    def palm_position(self) -> np.ndarray:
        """Tool centre point as measured now, in the world in [m], shape (3,)."""
        return self._palm_at(np.array(self._client.state().q))

    @property
    def rest_palm_position(self) -> np.ndarray:
        """Tool centre point in the rest configuration, in the world in [m], shape (3,)."""
        return self._palm_at(np.array(REST_Q))

    def _palm_at(self, q: np.ndarray) -> np.ndarray:
        return (self._cell.robot.world_T_base @ self._robot.tcp_pose(q))[:3, 3]

    def attempt(self, spec: RewardSpec, scene: SceneEstimate) -> AttemptResult:
        """Try one subtask.

        Args:
            spec: What to achieve.
            scene: What was seen last.

        Returns:
            Whether the motion was played to its end, or why not; the loop looks again and judges the result.

        Raises:
            RobotGoneError, StoppedError, KeyboardInterrupt: Not failures of a subtask but ends of the run; a robot
                that stopped by itself waits for a person, so that ends the run as well.
        """
        with self._watch.part("search"):
            found = self._find(spec, scene, self._start())
            return self._failed(found) if isinstance(found, FailureCause) else self._play(found)

    def rehearse(
        self, spec: RewardSpec, scene: SceneEstimate, after: Rehearsal | None = None
    ) -> Rehearsal | FailureCause:
        """Find and judge a motion as `attempt` does, and send the robot nothing.

        Args:
            spec: What to achieve.
            scene: What was seen, or what a rehearsal says will be.
            after: The rehearsal that this one follows; None starts where the robot is.
        """
        with self._watch.part("search"):
            found = self._find(spec, scene, self._start() if after is None else after.motion.ends)
        if isinstance(found, FailureCause):
            self._episode.log("rehearsed", spec=spec, cause=found)
            return found
        self._episode.log("rehearsed", spec=spec, cause=None)
        return Rehearsal(predicted_scene(scene, found.twin, found.twin_after), found)

    def play(self, rehearsal: Rehearsal) -> AttemptResult:
        """Play exactly the motion that was rehearsed; the driver refuses it when the arm stands elsewhere.

        Raises:
            RobotGoneError, StoppedError, KeyboardInterrupt: As for `attempt`.
        """
        return self._play(rehearsal.motion)

    def _start(self) -> "_Start":
        state = self._client.state()
        return _Start(np.array(state.q_d), state.gripper_width, self._held if state.grasped else None)

    def _find(self, spec: RewardSpec, scene: SceneEstimate, start: "_Start") -> "_JudgedMotion | FailureCause":
        """A motion that passed its verdict, or why there is none."""
        try:
            twin = build_twin(self._cell, scene, start.q, start.gripper_width, start.held)
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
            limits=self._limits,
        )
        if isinstance(plan, FailureCause):
            with self._watch.part("diagnosis"):
                cause = diagnose(twin, spec, plan, self._safety, self._rng, self._kinematics)
            self.steps += int(cause.evidence.get("steps", 0))
            return cause
        self.steps += plan.stats.steps
        self._say(f"motion: {plan.description} ({plan.stats.steps} steps, {plan.stats.seconds:.1f} s)")
        self._episode.log("motion", description=plan.description, cost=plan.cost, stats=plan.stats)
        judged = self._judge_first_that_passes(plan, twin, spec)
        if isinstance(judged, FailureCause):
            return judged
        return _JudgedMotion(spec, twin, after_plan(twin, plan), *judged)

    def explain(self, spec: RewardSpec, scene: SceneEstimate) -> FailureCause | None:
        """Why a motion that was played as planned does not show: a lock, or bodies in the way; None for anything else.

        Args:
            spec: What it should have achieved.
            scene: What is seen now.
        """
        with self._watch.part("diagnosis"):
            return self._explain(spec, scene)

    def _explain(self, spec: RewardSpec, scene: SceneEstimate) -> FailureCause | None:
        state = self._client.state()
        held = self._held if state.grasped else None
        try:
            twin = build_twin(self._cell, scene, np.array(state.q_d), state.gripper_width, held)
        except StackError:
            return None  # the next attempt says so
        cause = diagnose(twin, spec, None, self._safety, self._rng, self._kinematics)
        self.steps += int(cause.evidence.get("steps", 0))
        if cause.kind not in ("locked", "blocked_by"):
            return None
        self._episode.log("explained", cause=cause)
        return cause

    def _judge_first_that_passes(
        self, plan: MotionPlan, twin: TwinModel, spec: RewardSpec
    ) -> tuple[Trajectory, Verdict] | FailureCause:
        cause: FailureCause | None = None
        for path in (plan.path, *plan.alternatives)[:MAX_PATHS_JUDGED]:
            try:
                with self._watch.part("retiming"):
                    trajectory = retime(path, self._robot, self._limits, self._safety, payloads=held_payloads(twin))
            except RetimingError as error:
                self._episode.log("retiming_failed", reason=str(error))
                cause = FailureCause("no_candidate", spec.primary.subject, f"the path cannot be timed: {error}")
                continue
            with self._watch.part("verdict"):
                verdict = judge_trajectory(
                    trajectory, twin, spec, self._safety, self._limits, self._rng, robot=self._robot
                )
            self.steps += verdict.steps
            self._episode.log("verdict", verdict=verdict, duration=trajectory.duration)
            share = f"{verdict.successes}/{verdict.trials} perturbed twins"
            if verdict.passed:
                self._say(f"verdict: safe, {share}, {trajectory.duration:.1f} s long")
                return trajectory, verdict
            failed = verdict.failed_checks
            why = (
                "; ".join(f"{c.name} {c.worst:.3g} {c.unit} (limit {c.limit:.3g})" for c in failed[:3])
                or f"it succeeded in only {share}"
            )
            self._say(f"verdict: refused, {why}")
            cause = FailureCause(
                "unsafe",
                spec.primary.subject,
                f"the motion was refused in the twin: {why}",
                # Joint checks name joints there; only objects are anything to reason about.
                bodies=tuple(b for b in failed[0].bodies if twin.get(b)) if failed else (),
                check=failed[0].name if failed else "success_rate",
            )
        assert cause is not None  # a plan has at least one path
        return cause

    def _play(self, motion: "_JudgedMotion") -> AttemptResult:
        spec, trajectory, verdict = motion.spec, motion.trajectory, motion.verdict
        self._film.stills.append(("the twin, from what was seen", render_twin(motion.twin)))
        state = self._client.state()
        certificate = issue_certificate(
            trajectory,
            verdict,
            profile=self._limits.profile,
            firmware=self._limits.firmware,
            limits_hash=limits_hash(self._limits, self._safety, self._gripper),
            scene_stamp=motion.twin.scene_stamp,
            now=state.stamp,
        )
        self._episode.log("certificate", certificate=certificate)
        self._episode.log("trajectory", samples=len(trajectory.q), segments=trajectory.segments)
        write_trajectory(self._episode.numbered("trajectory", "npz"), trajectory)
        speed = f" at speed {state.speed_wanted:g}" if state.speed_wanted < 1.0 else ""
        self._say(f"robot: moving for {trajectory.duration / state.speed_wanted:.1f} s{speed}")
        self.trajectories_sent += 1
        try:
            with self._watch.part("moving"):
                report = self._client.execute(trajectory, certificate, on_progress=self._on_progress)
        except RefusedError as error:
            self._episode.log("refused", code=error.code, reason=str(error))
            return self._failed(FailureCause("refused_by_robot", spec.primary.subject, str(error), check=error.code))
        self._record(report)
        # A motion may end with something in the hand (a lift); the last thing held is what the gripper still feels.
        held = next((s.held for s in reversed(trajectory.segments) if s.held), None)
        self._held = held if report.final_state.grasped else None
        if report.reason == "missed_grasp":
            told = [e for e in trajectory.gripper if e.command.kind == "grasp"]
            held_before = sum(e.time < report.played * SAMPLE_TIME for e in told) - 1
            evidence = {"grasps_that_held": max(0, held_before)}
            return self._failed(
                FailureCause("lost_grasp", spec.primary.subject, report.detail, check=report.reason, evidence=evidence)
            )
        if not report.completed:
            kind = "lost_grasp" if report.reason == "lost_grasp" else "tracking_error"
            cause = FailureCause(kind, spec.primary.subject, report.detail, check=report.reason)
            self._episode.log("failure", cause=cause)
            raise StoppedError(
                f"the robot stopped by itself ({report.reason}): {report.detail}; look at the cell, "
                "then acknowledge with `replan robot acknowledge` or `replan run ... --acknowledge`"
            )
        return AttemptResult(ok=True, cause=None)

    def _record(self, report: "ExecutionReport") -> None:
        path = self._episode.numbered("measured", "npz")
        np.savez_compressed(
            path,
            times=report.times,
            q_d=report.q_d,
            q=report.q,
            tau=report.tau,
            gripper_width=report.gripper_width,
            speed=report.speed,
        )
        self._episode.log(
            "executed",
            completed=report.completed,
            reason=report.reason,
            detail=report.detail,
            played=report.played,
            samples=report.samples,
            max_tracking_error=report.max_tracking_error,
            measured=path.name,
        )

    def _on_progress(self, progress: "MotionProgress") -> None:
        """Film at FILM_RATE of the motion's own time, whatever its speed and the pace of a simulated cell."""
        if not self._filming:
            return
        seconds = progress.played * SAMPLE_TIME
        wanted = int(seconds * FILM_RATE)
        if wanted != self._last_filmed:
            self._last_filmed = wanted
            try:
                (frame,) = self._client.frames(self._client.cameras()[:1])
            except (CameraGoneError, ConfigError, RefusedError) as error:
                # A film is no reason to stop the arm; whether cameras work is found out when it looks again.
                self._filming = False
                self._say(f"the rest is not filmed: {error}")
                return
            self._film.frames.append((f"camera '{frame.camera}', {seconds:4.1f} s", np.array(frame.colour)))

    def _failed(self, cause: FailureCause) -> AttemptResult:
        self._episode.log("failure", cause=cause)
        return AttemptResult(ok=False, cause=cause)
