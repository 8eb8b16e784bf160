"""The administrative channel's socket: lines in, lines of JSON out. For tests; see `faults`."""

import json
import selectors
import socket
from collections.abc import Callable

from control.errors import MachineError, StackError

LONGEST_LINE = 1000


class ControlChannel:
    """Listens on loopback for lines of `faults`.

    Args:
        port: Where; 0 picks a free one.
        carry_out: Called with each line; returns what to answer.

    Attributes:
        port: Where it really listens.

    Raises:
        MachineError: The port is taken.
    """

    def __init__(self, port: int, carry_out: Callable[[str], dict[str, object]]) -> None:
        # A selector of its own: while everything else is frozen, this goes on.
        self._selector, self._carry_out = selectors.DefaultSelector(), carry_out
        try:
            self._listener = socket.create_server(("127.0.0.1", port))
        except OSError as error:
            raise MachineError(f"cannot listen at port {port} for faults: {error.strerror or error}") from error
        self.port = int(self._listener.getsockname()[1])
        self._listener.setblocking(False)
        self._clients: dict[socket.socket, bytes] = {}
        self._selector.register(self._listener, selectors.EVENT_READ, self._accept)

    def close(self) -> None:
        """Leave the network."""
        for client in list(self._clients):
            self._drop(client)
        self._selector.unregister(self._listener)
        self._listener.close()
        self._selector.close()

    def poll(self, wait: float) -> None:
        """Carry out what has come, waiting up to `wait` seconds for something."""
        for key, _ in self._selector.select(wait):
            key.data()

    def _accept(self) -> None:
        client, _ = self._listener.accept()
        client.settimeout(1.0)
        self._clients[client] = b""
        self._selector.register(client, selectors.EVENT_READ, lambda: self._read(client))

    def _drop(self, client: socket.socket) -> None:
        self._selector.unregister(client)
        del self._clients[client]
        client.close()

    def _read(self, client: socket.socket) -> None:
        try:
            data = client.recv(4096)
            if not data or len(self._clients[client]) > LONGEST_LINE:
                self._drop(client)
                return
            *lines, self._clients[client] = (self._clients[client] + data).split(b"\n")
            for line in lines:
                client.sendall(json.dumps(self._answer(line.decode(errors="replace"))).encode() + b"\n")
        except OSError:
            self._drop(client)

    def _answer(self, line: str) -> dict[str, object]:
        try:
            return self._carry_out(line.strip())
        except StackError as error:
            return {"ok": False, "error": str(error)}
