"""Cameras of the simulated box's world, offered to a robot process or router that may come up later.

The driver connects to the box, so the box is there before the robot process is. A thread waits for that process and
connects to it; pictures are taken by the loop that owns the world.
"""

import threading
from collections.abc import Callable

import zenoh

from control.errors import RobotGoneError, StackError
from hw_interface.cameras.node import CameraNode
from hw_interface.transport import ALIVE_KEY, open_client_session, parse_endpoint
from perception.frames import RgbdFrame

RETRY = 0.5  # [s] between two tries to connect
CONNECT_TIMEOUT = 1.0  # [s]


class LateCameras:
    """Offers cameras as soon as there is somebody to offer them to.

    Args:
        endpoint: Of the robot process or router.
        cameras: Names.
        take_frame: Takes a picture; called on the thread that calls `serve`.
        say: Called with one line when cameras are offered, or cannot be.

    Raises:
        ConfigError: The endpoint is not valid.
    """

    def __init__(
        self,
        endpoint: str,
        cameras: tuple[str, ...],
        take_frame: Callable[[str], RgbdFrame],
        say: Callable[[str], None],
    ) -> None:
        parse_endpoint(endpoint)
        self._endpoint, self._cameras, self._take_frame, self._say = endpoint, cameras, take_frame, say
        self._node: CameraNode | None = None
        self._ended = threading.Event()
        self._lost = threading.Event()
        self._thread = threading.Thread(target=self._keep_offering, daemon=True)
        self._thread.start()

    def serve(self) -> None:
        """Answer what was asked; does not wait."""
        node = self._node
        if node is not None:
            node.serve(0.0)

    def close(self) -> None:
        """Stop offering."""
        self._ended.set()
        self._lost.set()
        self._thread.join()

    def _keep_offering(self) -> None:
        while not self._ended.is_set():
            try:
                session = open_client_session(self._endpoint, CONNECT_TIMEOUT)
            except RobotGoneError:
                self._ended.wait(RETRY)
                continue
            try:
                self._offer(session)
            except StackError as error:
                self._say(f"cameras not offered: {error}")
                self._ended.wait(RETRY)
            finally:
                session.close()

    def _offer(self, session: zenoh.Session) -> None:
        """Offer until the robot process goes or this ends; a router without a robot counts as there."""
        self._lost.clear()
        watch = session.liveliness().declare_subscriber(ALIVE_KEY, self._robot_changed)
        node = CameraNode(session, self._cameras, self._take_frame)
        self._node = node
        self._say(f"cameras offered at {self._endpoint}: {', '.join(self._cameras)}")
        try:
            self._lost.wait()
        finally:
            self._node = None
            if self._ended.is_set():
                node.close()
            watch.undeclare()

    def _robot_changed(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.DELETE:
            self._lost.set()
