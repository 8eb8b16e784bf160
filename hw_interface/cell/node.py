"""The robot process's side of the wire: one loop that owns the driver and answers requests between its ticks.

Zenoh calls back on threads of its own; they only put queries into a queue. Everything that touches the robot, its
world or its cameras happens on the thread that calls `serve`, so no lock is needed and physics never advances while a
picture is taken. Answers leave on a thread of their own: an asker that takes nothing holds up no robot.
"""

import queue
import time
from collections.abc import Callable

import zenoh

from control.errors import ConfigError, RefusedError
from hw_interface.cell.audit import Audit
from hw_interface.cell.audit_log import AuditLog
from hw_interface.cell.operator_lease import BEAT_LEASE, PATIENCE, OperatorLease
from hw_interface.cell.robot_state_machine import RobotStateMachine
from hw_interface.link.requests import Outbox, read_request, refusal_of
from hw_interface.link.security import LinkSecurity
from hw_interface.link.streams import declare_stream
from hw_interface.link.transport import (
    ACKNOWLEDGE_KEY,
    ALIVE_KEY,
    CLOCK_KEY,
    EXECUTING_KEY,
    FRAME_KEY,
    FRAME_TRUTH_KEY,
    INFO_KEY,
    RESULT_KEY,
    SPEED_KEY,
    STATE_KEY,
    STOP_KEY,
    TRAJECTORY_KEY,
    TRUTH_KEY,
    open_robot_session,
)
from hw_interface.messages.cameras import ClockReading, ClockRequest
from hw_interface.messages.frames import FrameMessage
from hw_interface.messages.motions import TrajectoryRequest
from hw_interface.messages.robot import (
    AcknowledgeRequest,
    CellInfo,
    FrameRequest,
    InfoRequest,
    ResultRequest,
    SpeedRequest,
    StateRequest,
    StopRequest,
)
from hw_interface.messages.truth import FrameTruthMessage, FrameTruthRequest, TruthMessage, TruthRequest
from hw_interface.messages.wire import encode
from perception.frames import RgbdFrame
from perception.ground_truth import CellTruth, FrameTruth

STATE_RATE = 70.0  # states a second; comfortably above 50
MOST_STATES = 1000.0  # a second


class RobotNode:
    """Offers one driver and its cameras at an endpoint.

    Args:
        driver: The driver; ticked by the caller.
        cameras: Names of the cameras.
        take_frame: Takes a picture now; called on the thread that calls `serve`.
        endpoint: Where to listen; with `connect`, of the router to join.
        security, connect: As in `hw_interface.link.transport.open_robot_session`.
        truth: For simulated cells that are scored: what truly stands there; None leaves the key out.
        frame_truth: Likewise: what truly is in a camera's picture now; None leaves the key out.
        audit: Where to write down what is asked for and done; nothing moves when it cannot be written.
        state_rate: States a second to publish, 1 to 1000, as far as `serve` is called as often.
        simulated: Whether nothing real moves, and robot time stands still whenever this process does. Such a robot
            waits for an operator who is silent, where a real one comes to rest. Never true for a real robot.

    Attributes:
        endpoint: Where clients find it.
        state_period: Time between two states in [s].
        simulated: As given.

    Raises:
        ConfigError: The port is in use, the endpoint is not valid, or the router has a robot already.
        RobotGoneError: There is no router to join.
    """

    def __init__(
        self,
        driver: RobotStateMachine,
        cameras: tuple[str, ...],
        take_frame: Callable[[str], RgbdFrame],
        endpoint: str,
        truth: Callable[[], CellTruth] | None = None,
        frame_truth: Callable[[str], FrameTruth] | None = None,
        security: LinkSecurity | None = None,
        connect: bool = False,
        audit: AuditLog | None = None,
        state_rate: float = STATE_RATE,
        simulated: bool = False,
    ) -> None:
        if not 1.0 <= state_rate <= MOST_STATES:
            raise ConfigError(f"{state_rate:g} states a second are not valid; give 1 to {MOST_STATES:g}")
        self.state_period = 1.0 / state_rate
        self.simulated = simulated
        self._driver = driver
        self._audit = Audit(driver, audit)
        self._cameras = cameras
        self._take_frame = take_frame
        self._truth = truth
        self._frame_truth = frame_truth
        self._inbox: queue.SimpleQueue[tuple[Callable[[zenoh.Query], None], zenoh.Query]] = queue.SimpleQueue()
        self._next_state = 0.0
        self._session, self.endpoint = open_robot_session(endpoint, security, connect)
        self._outbox = Outbox(self._session)
        self._lease = OperatorLease(self._session)
        self._state_publisher = declare_stream(self._session, STATE_KEY)
        self._answers = [
            self._offer(key, handler)
            for key, handler in {
                INFO_KEY: self._answer_info,
                STATE_KEY: self._answer_state,
                CLOCK_KEY: self._answer_clock,
                # One key a camera: the keys of other cameras are answered by the processes that have them.
                **{f"{FRAME_KEY}/{camera}": self._answer_frame for camera in cameras},
                TRAJECTORY_KEY: self._answer_trajectory,
                STOP_KEY: self._answer_stop,
                SPEED_KEY: self._answer_speed,
                ACKNOWLEDGE_KEY: self._answer_acknowledge,
                RESULT_KEY: self._answer_result,
                **({TRUTH_KEY: self._answer_truth} if truth is not None else {}),
                **({f"{FRAME_TRUTH_KEY}/*": self._answer_frame_truth} if frame_truth is not None else {}),
            }.items()
        ]
        # Last, so that whoever sees the token finds every key answered.
        self._alive = self._session.liveliness().declare_token(ALIVE_KEY)

    def _offer(self, key: str, handler: Callable[[zenoh.Query], None]) -> zenoh.Queryable:
        return self._session.declare_queryable(key, lambda query: self._inbox.put((handler, query)))

    def serve(self, wait: float = 0.0) -> float:
        """Answer everything that was asked, waiting up to `wait` seconds for the first request; publish the state.

        Returns:
            Wall time in [s] spent on answers (not on waiting).
        """
        spent = 0.0
        while True:
            try:
                handler, query = self._inbox.get(timeout=wait) if wait > 0.0 else self._inbox.get_nowait()
            except queue.Empty:
                break
            wait, begun = 0.0, time.monotonic()
            try:
                handler(query)
            except Exception as error:  # a fault of ours in one answer must not end the process that holds the arm
                self._outbox.reply(query, refusal_of(error))
            spent += time.monotonic() - begun
            self.publish_state()
        patience = PATIENCE if self.simulated else BEAT_LEASE
        if self._driver.moving and (gone := self._lease.lost(patience)):
            self._driver.reflex("operator_gone", f"{gone}; look at the cell, then acknowledge")
        self._audit.watch()
        self.publish_state()
        return spent

    @property
    def waiting(self) -> bool:
        """Whether robot time has to stand still: a simulated motion whose operator is silent at present."""
        return self.simulated and self._driver.mode == "moving" and self._lease.silence() > BEAT_LEASE

    def publish_state(self) -> None:
        """Publish the state if it is time to."""
        now = time.monotonic()
        if now >= self._next_state:
            # On a grid, so that the rate holds on average; after a pause it begins anew.
            self._next_state = max(self._next_state + self.state_period, now)
            self._state_publisher.put(encode(self._driver.state()))

    def close(self) -> None:
        """Send what is still to be answered, then leave the wire; clients see it at once."""
        self._outbox.close()
        self._session.close()

    def _answer_info(self, query: zenoh.Query) -> None:
        read_request(query, InfoRequest)
        info = CellInfo(
            epoch=self._driver.epoch,
            cell=self._driver.cell,
            profile=self._driver.gate.profile,
            firmware=self._driver.gate.firmware,
            limits_hash=self._driver.gate.limits_hash,
            cameras=self._cameras,
            max_scene_age=self._driver.gate.max_scene_age,
            scored=self._truth is not None,
            simulated=self.simulated,
        )
        self._outbox.reply(query, info)

    def _answer_state(self, query: zenoh.Query) -> None:
        read_request(query, StateRequest)
        self._outbox.reply(query, self._driver.state())

    def _answer_clock(self, query: zenoh.Query) -> None:
        read_request(query, ClockRequest)
        self._outbox.reply(query, ClockReading(stamp=self._driver.state().stamp))

    def _answer_frame(self, query: zenoh.Query) -> None:
        read_request(query, FrameRequest)
        self._outbox.reply(query, FrameMessage.of(self._take_frame(self._camera(query, FRAME_KEY))))

    def _answer_trajectory(self, query: zenoh.Query) -> None:
        request = read_request(query, TrajectoryRequest)
        if request.epoch != self._driver.epoch:
            raise RefusedError(
                "wrong_epoch",
                f"the motion is meant for run '{request.epoch}' of a robot process; this is run "
                f"'{self._driver.epoch}': connect again and look at the scene anew",
            )
        certificate = request.certificate_or_none()
        # The motion begins with the loop's next tick, after the answer: waiting for the disk once is enough.
        with self._audit.asking("trajectory", force=False, serial=certificate and certificate.serial) as note:
            if not self._driver.moving:  # a motion under way says itself that the robot is busy
                note["operator"] = self._lease.take(request.operator)
            accepted = self._driver.submit(request.trajectory(), certificate, request.speed)
        payload = query.payload
        assert payload is not None
        self._outbox.reply(query, accepted)
        self._outbox.publish(EXECUTING_KEY, payload)

    def _answer_stop(self, query: zenoh.Query) -> None:
        request = read_request(query, StopRequest)
        self._driver.stop()  # first of all, and whether or not it can be written down
        self._audit.note("stop", reason=request.reason)
        self._outbox.reply(query, self._driver.state())

    def _answer_speed(self, query: zenoh.Query) -> None:
        speed = read_request(query, SpeedRequest).speed
        with self._audit.asking("speed", speed=speed):
            self._driver.set_speed(speed)
        self._outbox.reply(query, self._driver.state())

    def _answer_acknowledge(self, query: zenoh.Query) -> None:
        read_request(query, AcknowledgeRequest)
        with self._audit.asking("acknowledge"):
            self._driver.acknowledge()
        self._outbox.reply(query, self._driver.state())

    def _answer_result(self, query: zenoh.Query) -> None:
        self._outbox.reply(query, self._driver.result(read_request(query, ResultRequest).serial))

    def _answer_truth(self, query: zenoh.Query) -> None:
        read_request(query, TruthRequest)
        assert self._truth is not None
        self._outbox.reply(query, TruthMessage.of(self._truth(), time.time()))

    def _answer_frame_truth(self, query: zenoh.Query) -> None:
        read_request(query, FrameTruthRequest)
        assert self._frame_truth is not None
        self._outbox.reply(query, FrameTruthMessage.of(self._frame_truth(self._camera(query, FRAME_TRUTH_KEY))))

    def _camera(self, query: zenoh.Query, key: str) -> str:
        """Name of the camera behind a key.

        Raises:
            RefusedError: unknown_camera.
        """
        camera = str(query.key_expr).removeprefix(f"{key}/")
        if camera not in self._cameras:
            raise RefusedError("unknown_camera", f"no camera '{camera}' in this cell; it has {list(self._cameras)}")
        return camera
