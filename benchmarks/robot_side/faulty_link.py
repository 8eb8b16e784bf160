"""A link between machines that misbehaves on purpose: a TCP proxy that delays, stalls, parts, cuts and flips bits.

A TCP proxy keeps what TCP promises (order, nothing lost or doubled), as a real link does below it: lost packets show as
stalls, a pulled cable as silence that ends when it is plugged in again. What TCP cannot promise is that bits are right:
its sum has 16 bits and is made anew by every device that forwards a stream. Messages that come twice are the sender's
doing, not the link's; tests send them twice.
"""

import contextlib
import queue
import socket
import threading
import time
from dataclasses import dataclass

import numpy as np

_CHUNK = 65536  # [bytes] that are forwarded at a time
_POLL = 0.01  # [s] between two looks at whether a parted link is whole again


@dataclass(frozen=True)
class Faults:
    """What a link does to each chunk of bytes that passes it; each direction on its own.

    Attributes:
        delay: How late everything comes in [s].
        stall: How much later a chunk that stalls comes, with all that is behind it, in [s]; for a lost packet about
            0.2 s, the least time after which Linux sends again (TCP_RTO_MIN).
        stalls: Share of chunks that stall.
        flips: Share of chunks of which one bit is flipped, on the way to the server only.
    """

    delay: float = 0.0
    stall: float = 0.2
    stalls: float = 0.0
    flips: float = 0.0


class FaultyLink:
    """A proxy in front of a server on this machine. Make it, connect to `endpoint`, close it.

    Args:
        target: Endpoint of the server, "tcp/127.0.0.1:PORT" or "tls/127.0.0.1:PORT".
        seed: Of everything that is random.
        faults: What it does; may be changed at any time by setting `faults`.

    Attributes:
        endpoint: Where to connect instead.
        connections: How many were made through it.
        flipped: How many bits were flipped.
    """

    def __init__(self, target: str, seed: int, faults: Faults | None = None) -> None:
        protocol, _, address = target.partition("/")
        host, _, port = address.rpartition(":")
        self._target = (host, int(port))
        self._rng = np.random.default_rng(seed)
        self._lock = threading.Lock()
        self._ways: list[socket.socket] = []
        self._whole = threading.Event()
        self._whole.set()
        self._closed = False
        self._server = socket.create_server(("127.0.0.1", 0))
        self.faults = faults or Faults()
        self.connections, self.flipped = 0, 0
        self.endpoint = f"{protocol}/127.0.0.1:{self._server.getsockname()[1]}"
        threading.Thread(target=self._accept, daemon=True).start()

    def __enter__(self) -> "FaultyLink":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Cut everything and take no more connections."""
        self._closed = True
        self._server.close()
        self._whole.set()
        self.cut()

    def part(self) -> None:
        """From now on nothing passes, in neither direction, and nobody is told."""
        self._whole.clear()

    def heal(self) -> None:
        """Let pass again, first what was held back."""
        self._whole.set()

    def cut(self) -> None:
        """End all connections; new ones are taken."""
        with self._lock:
            ways, self._ways = self._ways, []
        for way in ways:
            with contextlib.suppress(OSError):
                way.shutdown(socket.SHUT_RDWR)
            way.close()

    def _accept(self) -> None:
        while not self._closed:
            try:
                client, _ = self._server.accept()
            except OSError:
                if self._closed:
                    return
                continue
            try:
                server = socket.create_connection(self._target)
            except OSError:
                client.close()  # the server is not there
                continue
            self.connections += 1
            for way in (client, server):
                way.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            with self._lock:
                self._ways += [client, server]
            for source, sink, to_server in ((client, server, True), (server, client, False)):
                chunks: queue.SimpleQueue[tuple[float, bytes]] = queue.SimpleQueue()
                threading.Thread(target=self._take, args=(source, chunks, to_server), daemon=True).start()
                threading.Thread(target=self._give, args=(sink, chunks), daemon=True).start()

    def _take(self, source: socket.socket, chunks: "queue.SimpleQueue[tuple[float, bytes]]", to_server: bool) -> None:
        due = 0.0
        while True:
            try:
                data = source.recv(_CHUNK)
            except OSError:
                data = b""
            faults = self.faults
            with self._lock:
                stalls, flips = self._rng.random(2) < (faults.stalls, faults.flips if to_server else 0.0)
                if flips and data:
                    data = _flipped(data, int(self._rng.integers(8 * len(data))))
                    self.flipped += 1
            # Never before what came earlier: TCP keeps the order.
            due = max(due, time.monotonic() + faults.delay + (faults.stall if stalls else 0.0))
            chunks.put((due, data))
            if not data:
                return

    def _give(self, sink: socket.socket, chunks: "queue.SimpleQueue[tuple[float, bytes]]") -> None:
        while True:
            due, data = chunks.get()
            time.sleep(max(0.0, due - time.monotonic()))
            while not self._whole.wait(_POLL) and not self._closed:
                pass
            try:
                if not data:
                    sink.shutdown(socket.SHUT_RDWR)
                    return
                sink.sendall(data)
            except OSError:
                return  # the other side is gone; what is left reaches nobody


def _flipped(data: bytes, bit: int) -> bytes:
    changed = bytearray(data)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)
