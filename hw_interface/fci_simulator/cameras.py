"""Cameras of the simulated box's world, offered to a robot process or router that may come up later.

The driver connects to the box, so the box is there before the robot process is. A thread waits for that process and
connects to it; pictures are taken by the loop that owns the world.
"""

import queue
import threading
import time
from collections.abc import Callable

import zenoh

from control.errors import RobotGoneError, StackError
from hw_interface.cameras.node import CameraNode
from hw_interface.link.requests import answer, read_request, refusing
from hw_interface.link.security import LinkSecurity
from hw_interface.link.transport import ALIVE_KEY, TRUTH_KEY, open_client_session, parse_endpoint
from hw_interface.messages.truth import TruthMessage, TruthRequest
from perception.frames import RgbdFrame
from perception.ground_truth import CellTruth

RETRY = 0.5  # [s] between two tries to connect
CONNECT_TIMEOUT = 1.0  # [s]


class LateCameras:
    """Offers cameras as soon as there is somebody to offer them to.

    Args:
        endpoint: Of the robot process or router.
        cameras: Names.
        take_frame: Takes a picture; called on the thread that calls `serve`.
        say: Called with one line when cameras are offered, or cannot be.
        truth: For scorers only: what truly stands there, on the key that a scored simulated cell has; None for nothing.
        security: Certificates, for a "tls/" endpoint on another machine.

    Raises:
        ConfigError: The endpoint is not valid.
    """

    def __init__(
        self,
        endpoint: str,
        cameras: tuple[str, ...],
        take_frame: Callable[[str], RgbdFrame],
        say: Callable[[str], None],
        truth: Callable[[], CellTruth] | None = None,
        security: LinkSecurity | None = None,
    ) -> None:
        parse_endpoint(endpoint, security is not None)
        self._security = security
        self._endpoint, self._cameras, self._take_frame, self._say = endpoint, cameras, take_frame, say
        self._truth = truth
        self._node: CameraNode | None = None
        self._scorers: queue.SimpleQueue[zenoh.Query] = queue.SimpleQueue()
        self._ended = threading.Event()
        self._lost = threading.Event()
        self._thread = threading.Thread(target=self._keep_offering, daemon=True)
        self._thread.start()

    def serve(self) -> None:
        """Answer what was asked; does not wait."""
        node = self._node
        if node is not None:
            node.serve(0.0)
        while self._truth is not None and not self._scorers.empty():
            query = self._scorers.get()
            with query, refusing(query):
                read_request(query, TruthRequest)
                answer(query, TruthMessage.of(self._truth(), time.time()))

    def close(self) -> None:
        """Stop offering."""
        self._ended.set()
        self._lost.set()
        self._thread.join()

    def _keep_offering(self) -> None:
        said = ""
        while not self._ended.is_set():
            try:
                session = open_client_session(self._endpoint, CONNECT_TIMEOUT, self._security)
            except RobotGoneError:
                self._ended.wait(RETRY)
                continue
            try:
                self._offer(session)
            except StackError as error:
                if str(error) != said:
                    said = str(error)
                    self._say(f"cameras not offered: {said}")
                self._ended.wait(RETRY)
            finally:
                session.close()

    def _offer(self, session: zenoh.Session) -> None:
        """Offer until the robot process goes or this ends; a router without a robot counts as there."""
        self._lost.clear()
        if self._ended.is_set():  # it was for this that it was set
            return
        watch = session.liveliness().declare_subscriber(ALIVE_KEY, self._robot_changed)
        node = CameraNode(session, self._cameras, self._take_frame)
        scoring = None if self._truth is None else session.declare_queryable(TRUTH_KEY, self._scorers.put)
        self._node = node
        self._say(f"cameras offered at {self._endpoint}: {', '.join(self._cameras)}")
        try:
            self._lost.wait()
        finally:
            self._node = None
            if self._ended.is_set():
                node.close()
                if scoring is not None:
                    scoring.undeclare()
            watch.undeclare()

    def _robot_changed(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.DELETE:
            self._lost.set()
