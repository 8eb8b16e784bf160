"""A client's view of a cell: state, pictures, and the one way to make the robot move."""

import contextlib
import math
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from types import TracebackType

import numpy as np
import zenoh
from numpy.typing import NDArray

from control.errors import RefusedError, RobotGoneError, StoppedError
from control.safety.certificate import Certificate
from control.trajectory.samples import Trajectory
from hw_interface.cameras.offers import all_cameras, offered_cameras
from hw_interface.cell.gate import valid_speed
from hw_interface.cell.operator_lease import Operator
from hw_interface.cell.process import SimProcess, start_sim_process
from hw_interface.errors import CameraGoneError
from hw_interface.link.requests import ask
from hw_interface.link.security import LinkSecurity
from hw_interface.link.streams import StateReader
from hw_interface.link.transport import (
    ACKNOWLEDGE_KEY,
    ALIVE_KEY,
    CAMERA_HEALTH_KEY,
    DEFAULT_ENDPOINT,
    FRAME_KEY,
    FRAME_TRUTH_KEY,
    INFO_KEY,
    RESULT_KEY,
    SPEED_KEY,
    STATE_KEY,
    STOP_KEY,
    TRAJECTORY_KEY,
    TRUTH_KEY,
    open_client_session,
)
from hw_interface.messages.cameras import CameraHealth, HealthRequest
from hw_interface.messages.frames import FrameMessage
from hw_interface.messages.motions import MotionResult, TrajectoryRequest
from hw_interface.messages.robot import (
    Accepted,
    AcknowledgeRequest,
    CellInfo,
    FrameRequest,
    InfoRequest,
    ResultRequest,
    RobotState,
    SpeedRequest,
    StateRequest,
    StopRequest,
)
from hw_interface.messages.truth import FrameTruthMessage, FrameTruthRequest, TruthMessage, TruthRequest
from hw_interface.messages.wire import M, Message
from hw_interface.own_time import LOOK, OwnTime
from perception.frames import RgbdFrame
from perception.ground_truth import CellTruth, FrameTruth

__all__ = ["CellClient", "ExecutionReport", "MotionProgress", "SimProcess", "start_sim_process"]

FRAME_TIMEOUT = 30.0  # [s]; software rendering on a busy machine
# [s]; a camera process answers, if with a refusal, within its own much shorter limit. The rest is for stalls.
CAMERA_TIMEOUT = 7.5
# [s] on the robot's clock, after the wire; camera processes themselves allow far less. A simulated cell stands still
# with its process, so its picture shows what is there now, however long a stalling machine had it under way.
MAX_FRAME_AGE, MAX_SIMULATED_FRAME_AGE = 2.0, 30.0
# [s] of this process's own time without a state while the link lives. A real robot's process is frozen or hangs then,
# and its arm rests; one that stalls for less says afterwards what became of the motion. A simulated cell may be taking
# a picture.
SILENCE, SIMULATED_SILENCE = 3.0, 30.0
REST_TIMEOUT = 10.0  # [s] that an arm told to stop may take to rest


@dataclass(frozen=True)
class MotionProgress:
    """How far a motion is: samples played, samples in all, and the state that says so."""

    played: int
    samples: int
    state: RobotState


@dataclass(frozen=True)
class ExecutionReport:
    """What became of a motion, as measured by the robot.

    Attributes:
        completed: Every sample was played and nothing went wrong.
        reason: "completed", or the code of the trouble: tracking_error, lost_grasp, missed_grasp, gripper_late,
            contact, frozen, internal_error. After a missed_grasp alone the robot is ready.
        detail: The trouble in words, empty when completed.
        played, samples: Samples of the trajectory that were played, and how many it has; at any speed.
        max_tracking_error: Largest difference per joint between commanded and measured position in [rad].
        times: Robot time of each row below in [s], shape (n,); about 100 rows a second.
        q_d, q: Commanded and measured joint positions in [rad], shape (n, 7).
        tau: Measured joint torques in [Nm], shape (n, 7).
        gripper_width: Measured distance between the pads in [m], shape (n,).
        speed: Share of the certified speed that was commanded, shape (n,).
        final_state: State after the motion.
    """

    completed: bool
    reason: str
    detail: str
    played: int
    samples: int
    max_tracking_error: float
    times: NDArray[np.float64]
    q_d: NDArray[np.float64]
    q: NDArray[np.float64]
    tau: NDArray[np.float64]
    gripper_width: NDArray[np.float64]
    speed: NDArray[np.float64]
    final_state: RobotState


class CellClient:
    """Connection to one cell. Make it with `connect`; use it as a context manager or call `close`.

    Attributes:
        endpoint: Where the cell is.
        info: What it offers.
        on_frame: Called with each picture that was asked for and came, for records; None for nobody.
    """

    def __init__(
        self,
        session: zenoh.Session,
        endpoint: str,
        info: CellInfo,
        timeout: float,
        security: LinkSecurity | None = None,
    ) -> None:
        self._session = session
        self.security = security
        self._timeout = timeout
        self._news = threading.Condition()
        self._latest: RobotState | None = None
        self._latest_at = time.monotonic()
        self._count = 0
        self._alive = True
        self._operator: Operator | None = None  # from the first motion on
        self.endpoint = endpoint
        self.info = info
        self.on_frame: Callable[[RgbdFrame], None] | None = None
        self._seen: dict[str, list[str]] = {}  # every camera process that was ever there, by camera
        self._reader = StateReader(session, self._on_state)
        self._watch = session.liveliness().declare_subscriber(ALIVE_KEY, self._on_alive, history=True)

    @classmethod
    def connect(
        cls, endpoint: str = DEFAULT_ENDPOINT, timeout: float = 5.0, security: LinkSecurity | None = None
    ) -> "CellClient":
        """Connect to the cell at an endpoint.

        Args:
            timeout: Longest wait for the connection, and later for each answer, in [s].
            security: Certificates, for a "tls/" endpoint on another machine. What their role has no right to raises
                RefusedError (no_right) in any call.

        Raises:
            ConfigError: The endpoint is not valid.
            RobotGoneError: Nobody answers there, or certificates are not accepted.
            MessageError: The cell speaks another protocol version.
        """
        session = open_client_session(endpoint, timeout, security)
        try:
            role = security and security.role
            info = ask(session, INFO_KEY, InfoRequest(), CellInfo, timeout, role)
            return cls(session, endpoint, info, timeout, security)
        except BaseException:
            session.close()
            raise

    def __enter__(self) -> "CellClient":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave; a motion that this client sent is brought to rest on its path."""
        if self._operator is not None:
            self._operator.close()
        self._session.close()

    def cameras(self) -> tuple[str, ...]:
        """Names of the cell's cameras now: the robot process's own, then those of camera processes by name.

        Raises:
            ConfigError: Two processes offer the same camera.
        """
        offered = offered_cameras(self._session, self._timeout)
        self._seen |= offered
        return all_cameras(self.info.cameras, self.endpoint, offered)

    def state(self) -> RobotState:
        """State measured now.

        Raises:
            RobotGoneError: No answer, or the robot process was restarted since this client connected.
        """
        return self._same_epoch(self._ask(STATE_KEY, StateRequest(), RobotState, self._timeout))

    def frames(self, cameras: Iterable[str] | None = None, max_age: float | None = None) -> list[RgbdFrame]:
        """Pictures taken now, one per camera.

        Args:
            cameras: Names; by default all of the cell's cameras that this client has ever found there.
            max_age: How old a picture may be when it comes, on the robot's clock in [s]; by default 2 s, and 30 s where
                a simulated cell takes it.

        Raises:
            ConfigError: Two processes offer the same camera.
            RefusedError: no_camera (the cell has none), unknown_camera, stale_frame (the picture is too old), or what a
                camera process refuses with: stale_frame, camera_failed, clock_unsure, no_arm_pose.
            CameraGoneError: A camera process is gone, or does not answer.
            RobotGoneError: No answer from the robot process.
        """
        there = self.cameras()
        names = tuple(dict.fromkeys((*there, *self._seen))) if cameras is None else tuple(cameras)
        if not names:
            raise RefusedError("no_camera", "this cell has no camera: start its camera processes (replan camera)")
        missing = [name for name in names if name not in there]
        if missing and missing[0] in self._seen:
            raise CameraGoneError(
                f"camera '{missing[0]}' is gone: its process {self._seen[missing[0]][0]} has ended or is frozen; see "
                "to it, start it again (replan camera) and look again"
            )
        if missing:
            raise RefusedError("unknown_camera", f"no camera '{missing[0]}' in this cell; it has {list(there)}")
        return [self._frame(name, max_age) for name in names]

    def _frame(self, name: str, max_age: float | None) -> RgbdFrame:
        own = name in self.info.cameras
        if max_age is None:
            max_age = MAX_SIMULATED_FRAME_AGE if own and self.info.simulated else MAX_FRAME_AGE
        timeout = FRAME_TIMEOUT if own else CAMERA_TIMEOUT
        try:
            frame = self._ask(f"{FRAME_KEY}/{name}", FrameRequest(), FrameMessage, timeout).frame()
        except RobotGoneError as error:
            if own:
                raise
            raise CameraGoneError(
                f"the process that has camera '{name}' ({self._seen[name][0]}) does not answer; it has ended or is "
                "frozen: see to it, start it again (replan camera) and look again"
            ) from error
        age = self._robot_time() - frame.stamp
        if age > max_age:
            raise RefusedError(
                "stale_frame",
                f"the picture of camera '{name}' is {age:.2f} s old; at most {max_age:g} s are allowed; see whether "
                "its process keeps up and its clock is right (replan doctor)",
            )
        if self.on_frame is not None:
            self.on_frame(frame)
        return frame

    def _robot_time(self) -> float:
        """Time on the robot process's clock in [s]; late by what a message takes, never early."""
        with self._news:
            latest, at = self._latest, self._latest_at
        if latest is None:
            return self.state().stamp
        return latest.stamp + time.monotonic() - at

    def camera_health(self) -> list[CameraHealth]:
        """How the camera processes that are there say that they do.

        Raises:
            CameraGoneError: One does not answer.
        """
        offered = offered_cameras(self._session, self._timeout)
        self._seen |= offered
        found = []
        for name in offered:
            try:
                found.append(self._ask(f"{CAMERA_HEALTH_KEY}/{name}", HealthRequest(), CameraHealth, CAMERA_TIMEOUT))
            except RobotGoneError as error:
                raise CameraGoneError(f"the process that has camera '{name}' does not answer") from error
        return found

    def stop(self, reason: str = "") -> RobotState:
        """Ask the arm to come to rest on its path and stay until acknowledged; returns at once.

        Raises:
            RobotGoneError: No answer.
        """
        return self._ask(STOP_KEY, StopRequest(reason=reason), RobotState, self._timeout)

    def set_speed(self, speed: float) -> RobotState:
        """Have motions played at a share of their certified speed: the present one from now on, and those after it.

        Args:
            speed: Above 0 and at most 1. The robot changes to it within its limits; `RobotState.speed` shows how far.

        Raises:
            RefusedError: bad_speed, too_slow, busy (the arm is being stopped), no_ramp or breaks_limit; the speed
                stays as it was.
            RobotGoneError: No answer.
        """
        return self._ask(SPEED_KEY, SpeedRequest(speed=_sendable(speed)), RobotState, self._timeout)

    def acknowledge(self) -> RobotState:
        """Make a stopped robot ready again.

        Raises:
            RefusedError: busy: the arm still moves.
            RobotGoneError: No answer.
        """
        return self._ask(ACKNOWLEDGE_KEY, AcknowledgeRequest(), RobotState, self._timeout)

    def truth(self) -> CellTruth:
        """Everything that truly stands in the cell now. For scorers only.

        Raises:
            RobotGoneError: The cell does not offer it (it was not started for scoring), or no answer.
        """
        return self._ask(TRUTH_KEY, TruthRequest(), TruthMessage, self._timeout).truth()

    def frame_truth(self, camera: str) -> FrameTruth:
        """What truly is in a camera's picture now, with masks. For scorers only.

        Raises:
            RefusedError: unknown_camera.
            RobotGoneError: The cell does not offer it (it was not started for scoring), or no answer.
        """
        key = f"{FRAME_TRUTH_KEY}/{camera}"
        return self._ask(key, FrameTruthRequest(), FrameTruthMessage, FRAME_TIMEOUT).truth()

    def execute(
        self,
        trajectory: Trajectory,
        certificate: Certificate | None,
        on_progress: Callable[[MotionProgress], None] | None = None,
        speed: float | None = None,
    ) -> ExecutionReport:
        """Have a trajectory played and wait until the arm rests again.

        Ctrl-C stops the arm on its path, waits until it rests, then raises KeyboardInterrupt as usual; so does
        whatever `on_progress` raises.

        Args:
            on_progress: Called on this thread a few dozen times a second.
            speed: Share of the certified speed to play this motion and the next ones at, above 0 and at most 1; None
                leaves it as it is set (1 when the robot process starts).

        Returns:
            The report, also when the robot stopped by itself (`completed` is False; acknowledge before moving again).

        Raises:
            RefusedError: The robot does not play it; nothing moved.
            StoppedError: Somebody asked the robot to stop; it rests on its path.
            RobotGoneError: The robot process died, or does not report any more; what the arm does is unknown.
        """
        self._check_alive()
        if self._operator is None:
            self._operator = Operator(self._session)
        share = None if speed is None else _sendable(speed)
        request = TrajectoryRequest.of(trajectory, certificate, self.info.epoch, self._operator.identity, share)
        try:
            return self._execute(request, on_progress)
        except (RefusedError, StoppedError, RobotGoneError):
            raise
        except BaseException:
            # Ctrl-C, or a fault on this side (in `on_progress`, say): nobody watches the arm any more, so it must rest.
            # A dead robot needs no stop, and what was raised matters more than why it is gone.
            with contextlib.suppress(RobotGoneError):
                self.stop("interrupted")
                self._await_rest()
            raise

    def _execute(
        self, request: TrajectoryRequest, on_progress: Callable[[MotionProgress], None] | None
    ) -> ExecutionReport:
        serial = self._ask(TRAJECTORY_KEY, request, Accepted, self._timeout).serial
        seen = 0
        while True:
            state, seen = self._wait_for_state(seen)
            if state.motion_serial != serial:
                continue  # measured before the motion was accepted
            if on_progress is not None:
                on_progress(MotionProgress(state.progress, state.samples, state))
            if state.mode not in ("moving", "stopping"):
                break
        result = self._ask(RESULT_KEY, ResultRequest(serial=serial), MotionResult, self._timeout)
        if result.outcome == "stopped":
            raise StoppedError(
                f"the motion was stopped on request after {result.played} of {result.samples} samples; the arm rests "
                "on its path; acknowledge before moving again"
            )
        return _report(result, self.state())

    def _ask(self, key: str, request: Message, expected: type[M], timeout: float) -> M:
        return ask(self._session, key, request, expected, timeout, self.security and self.security.role)

    def _on_state(self, state: RobotState) -> None:
        with self._news:
            self._latest, self._latest_at, self._count = state, time.monotonic(), self._count + 1
            self._news.notify_all()

    def _on_alive(self, sample: zenoh.Sample) -> None:
        with self._news:
            self._alive = sample.kind == zenoh.SampleKind.PUT
            self._news.notify_all()

    def _check_alive(self) -> None:
        if not self._alive:
            raise RobotGoneError(
                f"the robot process at {self.endpoint} has ended, or the link to it was lost; see to the arm, then "
                "start it again"
            )

    def _wait_for_state(self, seen: int) -> tuple[RobotState, int]:
        """The next published state after number `seen`, and its number."""
        longest = SIMULATED_SILENCE if self.info.simulated else SILENCE
        waited = OwnTime()
        with self._news:
            while self._count == seen or self._latest is None:
                self._check_alive()
                if waited.look() > longest:
                    raise RobotGoneError(
                        f"the robot process at {self.endpoint} has not reported for {waited.counted:.1f} s: it is "
                        "frozen or hangs, or the link to it is cut; see to the arm, then restart it"
                    )
                self._news.wait(LOOK)
            # A last state that came in before the process ended is still news: it says how the motion went.
            return self._same_epoch(self._latest), self._count

    def _await_rest(self) -> None:
        deadline = time.monotonic() + REST_TIMEOUT
        while time.monotonic() < deadline:
            if self.state().mode not in ("moving", "stopping"):
                return
            time.sleep(0.02)

    def _same_epoch(self, state: RobotState) -> RobotState:
        if state.epoch != self.info.epoch:
            raise RobotGoneError(
                f"the robot process at {self.endpoint} was restarted since this client connected; connect again "
                "and look at the scene anew"
            )
        return state


def _sendable(speed: float) -> float:
    """The speed; one that is no number, which no message may carry, is refused as the robot would refuse it."""
    return float(speed) if math.isfinite(speed) else valid_speed(speed)


def _report(result: MotionResult, final_state: RobotState) -> ExecutionReport:
    return ExecutionReport(
        completed=result.outcome == "completed",
        reason=result.trouble.code if result.trouble else result.outcome,
        detail=result.trouble.reason if result.trouble else "",
        played=result.played,
        samples=result.samples,
        max_tracking_error=result.max_tracking_error,
        times=result.times,
        q_d=result.q_d,
        q=result.q,
        tau=result.tau,
        gripper_width=result.gripper_width,
        speed=result.speed,
        final_state=final_state,
    )
