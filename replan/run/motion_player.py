"""Playing a motion that was judged: its certificate, the robot, what was measured, and pictures while it moves."""

from typing import TYPE_CHECKING

import numpy as np

from control.errors import ConfigError, RefusedError, StoppedError
from control.motion_files.trajectory_file import write_trajectory
from control.safety.certification import issue_certificate, limits_hash
from control.tasks.failure import FailureCause
from control.trajectory.samples import SAMPLE_TIME
from hw_interface.errors import CameraGoneError
from planning.loop.interfaces import AttemptResult
from replan.run.episode import Episode
from replan.run.film import FILM_RATE
from replan.run.motion_finder import JudgedMotion, MotionStart
from replan.run.session import RunSession
from sim_check.models.render import render_twin

if TYPE_CHECKING:
    from hw_interface.cell.client import ExecutionReport, MotionProgress


STALLED = ("operator_gone", "frozen")  # why a motion ends when a process stood still for too long


class MotionPlayer:
    """Sends the robot nothing that did not pass.

    Args:
        session: The run; its film gets a picture of the twin, and of the cell while it moves.
        filming: Whether to take pictures while the robot moves.
        go_on_after_stall: Acknowledge, without a person, that a process that stood still ended a motion of a simulated
            cell. Never done for a real robot.

    Attributes:
        trajectories_sent: How many so far.
    """

    def __init__(self, session: RunSession, filming: bool, go_on_after_stall: bool = False) -> None:
        self._session = session
        self._filming = filming
        self._goes_on = go_on_after_stall and session.client.info.simulated
        self._safety = session.cell.safety_limits()
        self._gripper = session.cell.robot.gripper_model
        self._held: str | None = None
        self._last_filmed = -1
        self.trajectories_sent = 0

    def start(self) -> MotionStart:
        """Where the robot stands now, and what it holds."""
        state = self._session.client.state()
        return MotionStart(np.array(state.q_d), state.gripper_width, self._held if state.grasped else None)

    def play(self, motion: JudgedMotion) -> AttemptResult:
        """Certify a motion for exactly where the robot is, send it, and record what was measured.

        Raises:
            RobotGoneError, StoppedError, KeyboardInterrupt: The run cannot go on.
        """
        trajectory, verdict = motion.trajectory, motion.verdict
        self._session.film.stills.append(("the twin, from what was seen", render_twin(motion.twin)))
        state = self._session.client.state()
        certificate = issue_certificate(
            trajectory,
            verdict,
            profile=self._session.limits.profile,
            firmware=self._session.limits.firmware,
            limits_hash=limits_hash(self._session.limits, self._safety, self._gripper),
            scene_stamp=motion.twin.scene_stamp,
            now=state.stamp,
        )
        self._session.episode.log("certificate", certificate=certificate)
        self._session.episode.log("trajectory", samples=len(trajectory.q), segments=trajectory.segments)
        write_trajectory(self._session.episode.numbered("trajectory", "npz"), trajectory)
        speed = f" at speed {state.speed_wanted:g}" if state.speed_wanted < 1.0 else ""
        self._session.say(f"robot: moving for {trajectory.duration / state.speed_wanted:.1f} s{speed}")
        self.trajectories_sent += 1
        try:
            with self._session.watch.part("moving"):
                report = self._session.client.execute(trajectory, certificate, on_progress=self._on_progress)
        except RefusedError as error:
            self._session.episode.log("refused", code=error.code, reason=str(error))
            cause = FailureCause("refused_by_robot", motion.subject, str(error), check=error.code)
            return failed(self._session.episode, cause)
        self._record(report)
        # A motion may end with something in the hand (a lift); the last thing held is what the gripper still feels.
        held = next((s.held for s in reversed(trajectory.segments) if s.held), None)
        self._held = held if report.final_state.grasped else None
        if report.reason == "missed_grasp":
            told = [e for e in trajectory.gripper if e.command.kind == "grasp"]
            held_before = sum(e.time < report.played * SAMPLE_TIME for e in told) - 1
            evidence = {"grasps_that_held": max(0, held_before)}
            cause = FailureCause("lost_grasp", motion.subject, report.detail, check=report.reason, evidence=evidence)
            return failed(self._session.episode, cause)
        if report.reason in STALLED and self._goes_on:
            self._session.say(f"robot: at rest on its path, since {report.detail}; acknowledged, looking again")
            self._session.client.acknowledge()
            cause = FailureCause("refused_by_robot", motion.subject, report.detail, check=report.reason)
            return failed(self._session.episode, cause)
        if not report.completed:
            kind = "lost_grasp" if report.reason == "lost_grasp" else "tracking_error"
            cause = FailureCause(kind, motion.subject, report.detail, check=report.reason)
            self._session.episode.log("failure", cause=cause)
            raise StoppedError(
                f"the robot stopped by itself ({report.reason}): {report.detail}; look at the cell, "
                "then acknowledge with `replan robot acknowledge` or `replan run ... --acknowledge`"
            )
        return AttemptResult(ok=True, cause=None)

    def _record(self, report: "ExecutionReport") -> None:
        path = self._session.episode.numbered("measured", "npz")
        np.savez_compressed(
            path,
            times=report.times,
            q_d=report.q_d,
            q=report.q,
            tau=report.tau,
            gripper_width=report.gripper_width,
            speed=report.speed,
        )
        self._session.episode.log(
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
                (frame,) = self._session.client.frames(self._session.client.cameras()[:1])
            except (CameraGoneError, ConfigError, RefusedError) as error:
                # A film is no reason to stop the arm; whether cameras work is found out when it looks again.
                self._filming = False
                self._session.say(f"the rest is not filmed: {error}")
                return
            self._session.film.frames.append((f"camera '{frame.camera}', {seconds:4.1f} s", np.array(frame.colour)))


def failed(episode: Episode, cause: FailureCause) -> AttemptResult:
    """An attempt that failed, noted in the record."""
    episode.log("failure", cause=cause)
    return AttemptResult(ok=False, cause=cause)
