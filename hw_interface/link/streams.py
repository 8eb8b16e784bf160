"""Messages at a high rate, such as states: whoever is slow to read them harms nobody, itself included.

The transport reads a link in order. A reader that calls back for every message, and takes longer over it than the next
one takes to come, would leave the link unread: answers to its own questions would wait behind messages that are of no
use to it any more, and after some seconds the other side would take it to be dead. So messages wait in a ring that
holds the latest ones, filled without Python's lock, and are handled on a thread of the reader's own.
"""

import atexit
import logging
import threading
from collections.abc import Callable

import zenoh

from hw_interface.errors import MessageError
from hw_interface.link.transport import STATE_KEY, STREAM_PRIORITY
from hw_interface.messages.robot import RobotState
from hw_interface.messages.wire import decode

BACKLOG = 1000  # messages that wait for a busy reader: a second's at 1 kHz; then the oldest are dropped
CLOSE_TIMEOUT = 1.0  # [s] for the message that is being handled


def declare_stream(session: zenoh.Session, key: str) -> zenoh.Publisher:
    """Publisher of small messages at a high rate; to publish takes a millisecond at most, however slow readers are.

    Batched, not express: an express message takes a batch for itself, and states are lost on a busy machine.
    """
    return session.declare_publisher(
        key, congestion_control=zenoh.CongestionControl.DROP, priority=STREAM_PRIORITY, express=False
    )


class StateReader:
    """Hears what a robot publishes of its state, from its making until it or the session is closed.

    Args:
        session: On which the states come.
        on_state: Called with each state in order, on a thread of this reader. What is no state is left out, and what
            `on_state` raises is logged; neither ends the reading.
        backlog: States that wait when `on_state` is slow; beyond that the oldest are dropped.
    """

    def __init__(self, session: zenoh.Session, on_state: Callable[[RobotState], None], backlog: int = BACKLOG) -> None:
        self._on_state = on_state
        self._subscriber = session.declare_subscriber(STATE_KEY, zenoh.handlers.RingChannel(backlog))
        self._thread = threading.Thread(target=self._read, name="reader of states", daemon=True)
        self._thread.start()
        # A program may end without closing anything. The thread must be out of the transport's code by then: ending an
        # interpreter under it would abort the process.
        atexit.register(self.close)

    def close(self) -> None:
        """Hear no more; closing it again does nothing."""
        if self._thread.is_alive():  # it ends with the session, too
            self._subscriber.undeclare()
        if self._thread is not threading.current_thread():
            self._thread.join(CLOSE_TIMEOUT)

    def _read(self) -> None:
        for sample in self._subscriber:
            try:
                state = decode(sample.payload.to_bytes(), RobotState)
            except MessageError:
                continue  # somebody else's garbage; the robot's silence would be noticed
            try:
                self._on_state(state)
            except Exception:
                logging.getLogger(__name__).exception("a state could not be handled")
        atexit.unregister(self.close)
