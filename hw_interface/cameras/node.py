"""A camera process's side of the wire: answers `cell/frame/<camera>` on the thread that owns the cameras.

Zenoh calls back on threads of its own; they only put queries into a queue. Pictures are taken on the thread that calls
`serve`.
"""

import queue
import time
from collections.abc import Callable

import zenoh

from control.errors import ConfigError, RobotGoneError
from hw_interface.cameras.offers import all_cameras, camera_token, offered_cameras, this_owner
from hw_interface.link.requests import answer, ask, read_request, refusing
from hw_interface.link.transport import CAMERA_HEALTH_KEY, FRAME_KEY, INFO_KEY
from hw_interface.messages.cameras import CameraHealth, HealthRequest
from hw_interface.messages.frames import FrameMessage
from hw_interface.messages.robot import CellInfo, FrameRequest, InfoRequest
from hw_interface.messages.wire import encode
from perception.frames import RgbdFrame

TOKEN_TIMEOUT = 2.0  # [s] for the answer to who else is there
HEALTH_PERIOD = 1.0  # [s]


class CameraNode:
    """Offers cameras on a session that is connected to the robot process or to a router.

    Args:
        session: The session; whoever opened it closes it, after `close`.
        cameras: Names of the cameras.
        take_frame: Camera -> a picture taken now, stamped on the robot's clock; called on the thread that calls
            `serve`. A RefusedError that it raises reaches the one who asked as it is.
        owner: Who has the cameras, as part of a key; by default this process.
        health: Camera -> how it does; None does not say.

    Attributes:
        owner: Who has the cameras.

    Raises:
        ConfigError: Another process offers one of these cameras.
    """

    def __init__(
        self,
        session: zenoh.Session,
        cameras: tuple[str, ...],
        take_frame: Callable[[str], RgbdFrame],
        owner: str | None = None,
        health: Callable[[str], CameraHealth] | None = None,
    ) -> None:
        self.owner = owner = owner or this_owner()
        if len(set(cameras)) < len(cameras) or not cameras:
            raise ConfigError(f"camera names {list(cameras)} are not valid; give at least one, each once")
        _check_free(session, cameras, owner)
        self._take_frame = take_frame
        self._health = health
        self._session = session
        self._cameras = cameras
        self._next_health = 0.0
        self._inbox: queue.SimpleQueue[tuple[Callable[[zenoh.Query, str], None], zenoh.Query, str]] = (
            queue.SimpleQueue()
        )
        self._queryables = [self._offer(FRAME_KEY, camera, self._answer_frame) for camera in cameras]
        if health is not None:
            self._queryables += [self._offer(CAMERA_HEALTH_KEY, camera, self._answer_health) for camera in cameras]
        # Last, so that whoever sees a token finds its camera answered.
        self._tokens = [session.liveliness().declare_token(camera_token(camera, owner)) for camera in cameras]

    def _offer(self, key: str, camera: str, handler: Callable[[zenoh.Query, str], None]) -> zenoh.Queryable:
        return self._session.declare_queryable(
            f"{key}/{camera}", lambda query: self._inbox.put((handler, query, camera))
        )

    def serve(self, wait: float = 0.0) -> int:
        """Answer everything that was asked, waiting up to `wait` seconds for the first request; publish the health.

        Returns:
            How many requests were answered.
        """
        answered = 0
        deadline = time.monotonic() + wait
        while True:
            try:
                handler, query, camera = self._inbox.get(timeout=max(0.0, deadline - time.monotonic()))
            except queue.Empty:
                self._publish_health()
                return answered
            deadline = 0.0
            with query, refusing(query):
                handler(query, camera)
            answered += 1

    def close(self) -> None:
        """Stop offering the cameras; clients see it at once."""
        for offer in (*self._tokens, *self._queryables):
            offer.undeclare()

    def _answer_frame(self, query: zenoh.Query, camera: str) -> None:
        read_request(query, FrameRequest)
        answer(query, FrameMessage.of(self._take_frame(camera)))

    def _answer_health(self, query: zenoh.Query, camera: str) -> None:
        read_request(query, HealthRequest)
        assert self._health is not None
        answer(query, self._health(camera))

    def _publish_health(self) -> None:
        now = time.monotonic()
        if self._health is None or now < self._next_health:
            return
        self._next_health = now + HEALTH_PERIOD
        for camera in self._cameras:
            self._session.put(f"{CAMERA_HEALTH_KEY}/{camera}", encode(self._health(camera)))


def _check_free(session: zenoh.Session, cameras: tuple[str, ...], owner: str) -> None:
    """Refuse cameras that others offer.

    Raises:
        ConfigError: One is taken; names both processes.
    """
    offered = offered_cameras(session, TOKEN_TIMEOUT)
    try:
        own = ask(session, INFO_KEY, InfoRequest(), CellInfo, TOKEN_TIMEOUT).cameras
    except RobotGoneError:
        own = ()  # behind a router, cameras may start before the robot
    claimed = {camera: [*offered.get(camera, []), owner] for camera in cameras}
    all_cameras(own, "this endpoint", claimed)
