"""Publishing small messages many times a second from a loop that must never wait.

A thread publishes what the loop puts into a queue. What cannot be sent is dropped, never waited for: waiting for one
reader that stands still would hold up every answer of this process for seconds, that to a stop among them.
"""

import contextlib
import queue
import threading

import zenoh

MOST_WAITING = 2000  # messages: two seconds at 1 kHz; a reader that stands still is given up after its lease
END_TIMEOUT = 1.0  # [s] for what waits when the stream is closed


class Stream:
    """A publisher whose `put` returns at once.

    Args:
        session: The session.
        key: Where to publish.
        priority: Above that of pictures, which have megabytes.

    Attributes:
        dropped: How many messages were dropped, oldest first, because too many waited.
    """

    def __init__(
        self, session: zenoh.Session, key: str, priority: zenoh.Priority = zenoh.Priority.INTERACTIVE_HIGH
    ) -> None:
        self._publisher = session.declare_publisher(
            key, congestion_control=zenoh.CongestionControl.DROP, priority=priority, express=False
        )
        self._waiting: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self.dropped = 0
        self._thread = threading.Thread(target=self._publish, name=f"stream of {key}", daemon=True)
        self._thread.start()

    def put(self, data: bytes) -> None:
        """Have a message published; those of one thread keep their order."""
        if self._waiting.qsize() >= MOST_WAITING:
            with contextlib.suppress(queue.Empty):
                self._waiting.get_nowait()
                self.dropped += 1
        self._waiting.put(data)

    def close(self) -> None:
        """Publish what waits, as far as that is possible in a second; the session stays."""
        self._waiting.put(None)
        self._thread.join(END_TIMEOUT)

    def _publish(self) -> None:
        while (data := self._waiting.get()) is not None:
            try:
                self._publisher.put(data)
            except zenoh.ZError:
                return  # the session is closed
