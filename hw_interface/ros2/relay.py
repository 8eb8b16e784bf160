"""From the cell's keys to ROS 2: states, accepted motions and pictures, each turned over as it comes.

Zenoh calls back on threads of its own and a thread of its own asks for pictures; both only fill a queue, which one
thread empties. What it cannot keep up with is dropped, states first: the robot never waits for it.
"""

import queue
import threading
import time
from collections.abc import Callable, Sequence
from typing import Protocol

import zenoh

from control.errors import StackError
from hw_interface.cell.client import CellClient
from hw_interface.errors import MessageError
from hw_interface.link.streams import StateReader
from hw_interface.link.transport import EXECUTING_KEY
from hw_interface.messages.motions import TrajectoryRequest
from hw_interface.messages.robot import RobotState
from hw_interface.messages.wire import decode
from hw_interface.ros2.encoding import Ros2Message
from hw_interface.ros2.view import Ros2View
from perception.errors import PerceptionError
from perception.frames import RgbdFrame

FIXED_PERIOD = 1.0  # [s]; bridges that began later learn the fixed transforms in time
SILENT_AFTER = 1.0  # [s] without a state
WAITING = 200  # items in the queue; three seconds of states
BEAT = 0.1  # [s]


class Sink(Protocol):
    """Where messages go."""

    def put(self, message: Ros2Message) -> None:
        """Take a message."""
        ...


class Relay:
    """Turns over what one cell says; use `run`, or `start` and `close` from a program that does something else.

    Args:
        session: Client session of the cell.
        view: Turns what comes into messages.
        sinks: Where they go.
    """

    def __init__(self, session: zenoh.Session, view: Ros2View, sinks: Sequence[Sink]) -> None:
        self._view = view
        self._sinks = sinks
        self._inbox: queue.Queue[RobotState | TrajectoryRequest | RgbdFrame | Ros2Message] = queue.Queue(WAITING)
        self._heard = time.monotonic()
        self._stamp = time.time()  # of the latest state
        self._next_fixed = 0.0
        self._next_silence = 0.0
        self.dropped = 0
        self._reader = StateReader(session, self._on_state)
        self._subscriber = session.declare_subscriber(EXECUTING_KEY, self._on_trajectory)

    def run(self, ended: Callable[[], bool]) -> None:
        """Turn messages over until `ended` says so."""
        while not ended():
            self.step(BEAT)

    def step(self, wait: float) -> None:
        """Turn over what has come, waiting up to `wait` seconds for the first of it."""
        now = time.monotonic()
        if now >= self._next_fixed:
            self._next_fixed = now + FIXED_PERIOD
            self._send(self._view.fixed(self._stamp))
        silent = now - self._heard
        if silent > SILENT_AFTER and now >= self._next_silence:
            self._next_silence = now + SILENT_AFTER
            self._send(self._view.silence(time.time(), silent))
        try:
            item = self._inbox.get(timeout=wait)
        except queue.Empty:
            return
        if isinstance(item, RobotState):
            self._heard, self._stamp = time.monotonic(), item.stamp
            messages = self._view.state(item)
        elif isinstance(item, TrajectoryRequest):
            messages = [self._view.trajectory(item.trajectory(), self._stamp)]
        elif isinstance(item, RgbdFrame):
            messages = self._view.frame(item)
        else:
            messages = [item]
        for message in messages:
            self._send(message)

    def show(self, frame: RgbdFrame) -> None:
        """Turn a frame over; from any thread."""
        self._take(frame)

    def tell(self, message: Ros2Message) -> None:
        """Pass a message on in its turn; from any thread."""
        self._take(message)

    def close(self) -> None:
        """Turn over what has come and stop listening; the session stays."""
        self._reader.close()
        self._subscriber.undeclare()
        while not self._inbox.empty():
            self.step(0.0)

    def _send(self, message: Ros2Message) -> None:
        for sink in self._sinks:
            sink.put(message)

    def _on_state(self, state: RobotState) -> None:
        if self._inbox.qsize() < WAITING // 2:  # the other half is for what comes once
            self._take(state)
        else:
            self.dropped += 1

    def _on_trajectory(self, sample: zenoh.Sample) -> None:
        try:
            request = decode(sample.payload.to_bytes(), TrajectoryRequest)
            request.trajectory()
        except MessageError:
            return
        self._take(request)

    def _take(self, item: RobotState | TrajectoryRequest | RgbdFrame | Ros2Message) -> None:
        try:
            self._inbox.put_nowait(item)
        except queue.Full:
            self.dropped += 1


def watch_cameras(
    client: CellClient, relay: Relay, rate: float, ended: threading.Event, say: Callable[[str], None]
) -> None:
    """Ask for every camera's pictures until `ended`; what goes wrong with one is said once, until it works again.

    Args:
        client: Connection to the cell, used by this thread only.
        relay: Gets the frames.
        rate: Frames a second of each camera.
        ended: Ends it.
        say: Gets what goes wrong.
    """
    wrong: dict[str, str] = {}
    due = time.monotonic()
    while not ended.is_set():
        try:
            cameras = client.cameras()
        except StackError as error:
            cameras = ()
            _tell_once("cameras", str(error), wrong, say)
        for camera in cameras:
            try:
                relay.show(client.frames([camera])[0])
                wrong.pop(camera, None)
            except (StackError, PerceptionError) as error:
                _tell_once(camera, str(error), wrong, say)
        due = max(due + 1.0 / rate, time.monotonic())
        ended.wait(max(0.0, due - time.monotonic()))


def _tell_once(what: str, text: str, told: dict[str, str], say: Callable[[str], None]) -> None:
    if what not in told:
        told[what] = text
        say(f"{what}: {text}")
