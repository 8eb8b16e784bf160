"""A camera process: one source, its clock and its place, offered until it is told to end or the source fails."""

import contextlib
import time
from collections.abc import Callable
from dataclasses import replace

import zenoh

from control.errors import RefusedError, RobotGoneError
from hw_interface.cameras.capture import DEFAULT_MAX_AGE, Capture, OnRequest
from hw_interface.cameras.mounting import NO_ARM_POSE, CameraMounting
from hw_interface.cameras.node import CameraNode
from hw_interface.cameras.offers import this_owner
from hw_interface.cameras.source import CameraFailedError, CameraSource
from hw_interface.link.clock_offset import RobotClock
from hw_interface.link.requests import ask
from hw_interface.link.transport import CLOCK_KEY
from hw_interface.messages.cameras import CameraHealth, ClockReading, ClockRequest
from perception.frames import RgbdFrame

BEAT = 0.1  # [s]
CLOCK_TIMEOUT = 0.5  # [s] for one question
POSE_PATIENCE = 3.0  # [s] in which further pictures are taken while it is not known where the arm was
FAREWELL = 10.0  # [s] that a process whose source has failed goes on telling those who ask why


class CameraService:
    """Offers one camera on a session that is connected to the robot process or a router.

    Args:
        session: The session; whoever opened it closes it.
        camera: Name of the camera.
        source: Its pictures; this class closes it.
        mounting: Where it is; None where the source says it.
        max_age: How old a picture may be when it is handed out, in [s].
        on_request: Read the source when it is asked only, each picture once.

    Raises:
        ConfigError: Another process offers this camera.
    """

    def __init__(
        self,
        session: zenoh.Session,
        camera: str,
        source: CameraSource,
        mounting: CameraMounting | None,
        max_age: float = DEFAULT_MAX_AGE,
        on_request: bool = False,
    ) -> None:
        self._session = session
        self._camera = camera
        self._description = source.description
        self._mounting = mounting
        self._max_age = max_age
        self._owner = this_owner()
        self.clock = RobotClock(self._ask_time)
        try:
            self._node = CameraNode(session, (camera,), self.take, self._owner, lambda _: self.health())
        except BaseException:
            source.close()
            raise
        self._capture = OnRequest(source, camera) if on_request else Capture(source, camera, max_age)

    @property
    def failure(self) -> CameraFailedError | None:
        """Why there are no more pictures; None while there are."""
        return self._capture.failure

    def run(self, ended: Callable[[], bool], farewell: float = FAREWELL) -> None:
        """Serve until `ended` says so, or the source has failed and `farewell` seconds were left to tell why."""
        until = None
        while not ended():
            if self._capture.failure is not None and until is None:
                until = time.monotonic() + farewell
            if until is not None and time.monotonic() > until:
                return
            self._node.serve(BEAT)
            self._keep_clock()

    def take(self, camera: str) -> RgbdFrame:
        """A picture taken now, stamped on the robot's clock, with the camera's pose at that moment.

        A picture of a moment at which the robot's process stood still has no pose; further ones are taken for up to
        `POSE_PATIENCE`, so that a machine with other work on it makes a look slow and does not end it.

        Raises:
            RefusedError: stale_frame, camera_failed, clock_unsure or no_arm_pose.
            RobotGoneError: The robot process does not tell the time.
        """
        until = time.monotonic() + POSE_PATIENCE
        while True:
            frame = self._capture.taken_now().frame
            stamp = self.clock.to_robot(frame.stamp)
            try:
                pose = frame.world_T_camera if self._mounting is None else self._mounting.pose(stamp)
            except RefusedError as error:
                if error.code != NO_ARM_POSE or time.monotonic() > until:
                    raise
            else:
                return replace(frame, stamp=stamp, world_T_camera=pose, camera=camera)

    def health(self) -> CameraHealth:
        """How the camera does."""
        capture = self._capture
        return CameraHealth(
            camera=self._camera,
            owner=self._owner,
            source=self._description,
            stamp=time.time(),
            frames=capture.frames,
            dropped=capture.dropped,
            rate=capture.rate(),
            age=capture.age(),
            max_age=self._max_age,
            clock_offset=self.clock.offset,
            clock_uncertainty=self.clock.uncertainty,
            clock_jumps=self.clock.jumps,
            trouble=None if capture.failure is None else str(capture.failure),
        )

    def close(self) -> None:
        """Stop offering the camera and close the source."""
        self._node.close()
        self._capture.close()

    def _ask_time(self) -> float:
        return ask(self._session, CLOCK_KEY, ClockRequest(), ClockReading, CLOCK_TIMEOUT).stamp

    def _keep_clock(self) -> None:
        """Measure the clock in good time, so that a request need not wait for it."""
        with contextlib.suppress(RobotGoneError):  # behind a router the robot may come later
            self.clock.keep()
