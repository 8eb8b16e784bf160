"""One TCP service with at most one client, and the datagrams that go with it."""

import os
import select
import selectors
import socket
import struct
from collections.abc import Callable, Mapping
from typing import Any

from control.errors import MachineError
from hw_interface.fci_simulator.layout import ConnectStatus

SEND_TIMEOUT = 1.0  # [s]; a client that does not read its answers for so long is dropped
DATAGRAMS_AT_ONCE = 64


class MalformedRequest(Exception):
    """Bytes that are no request of this protocol; the connection that they came over is closed."""


class Service:
    """A listening port, its client, and the socket for datagrams.

    Args:
        address, port: Where to listen.
        selector: Sockets are registered here with a callable as data.
        header: Layout of a request's first bytes: command, its id, size of the whole.
        request: Called with command, id and body of every whole request but a connect.
        lengths: Bytes after the header, by command; a command that is not in it does not exist.
        name: For log lines.
        say: Called with one line for every event.

    Attributes:
        version: Protocol version that is answered to a connect request.
        silent: Whether to take connections and bytes without ever answering.
        on_leave: Called when a client has gone.

    Raises:
        MachineError: The port is taken or the address is not one of this machine.
    """

    def __init__(
        self,
        address: str,
        port: int,
        selector: selectors.BaseSelector,
        header: struct.Struct,
        request: Callable[[int, int, bytes], None],
        lengths: Mapping[Any, int],
        version: int,
        name: str,
        say: Callable[[str], None],
    ) -> None:
        self._address, self._port, self._selector = address, port, selector
        self._header, self._request, self._lengths = header, request, lengths
        self._own_version = self.version = version
        self._name, self._say = name, say
        self.silent = False
        self.on_leave: Callable[[], None] = lambda: None
        self._listener: socket.socket | None = None
        self._client: socket.socket | None = None
        self._host = ""
        self._peer: tuple[str, int] | None = None
        self._buffer = b""
        self._mute: list[socket.socket] = []  # connections taken while silent
        self.datagrams = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self.datagrams.bind((address, 0))
            self.datagrams.setblocking(False)
            self.listen()
        except BaseException:
            self.datagrams.close()
            raise

    @property
    def connected(self) -> bool:
        """Whether a client is there that states are sent to."""
        return self._peer is not None

    def listen(self) -> None:
        """Take connections (again)."""
        if self._listener is not None:
            return
        try:
            self._listener = socket.create_server((self._address, self._port), backlog=4)
        except OSError as error:
            raise MachineError(
                f"cannot listen at {self._address}:{self._port}: {os.strerror(error.errno or 0)}; another simulated "
                "control box may be running there: end it, or choose another address (--address 127.0.0.2)"
            ) from error
        self._listener.setblocking(False)
        self._selector.register(self._listener, selectors.EVENT_READ, self._accept)

    def refuse(self) -> None:
        """Stop listening and drop the client, so that connecting is refused."""
        if self._listener is not None:
            self._selector.unregister(self._listener)
            self._listener.close()
            self._listener = None
        self.drop("the service is off")

    def close(self) -> None:
        """Leave the network."""
        self.refuse()
        for connection in self._mute:
            connection.close()
        self.datagrams.close()

    def silence(self, silent: bool) -> None:
        """Take connections and bytes without ever answering, or answer again (those that come then)."""
        self.silent = silent
        if not silent:
            for connection in self._mute:
                connection.close()
            self._mute.clear()

    def drop(self, why: str) -> None:
        """Close the client's connection."""
        if self._client is None:
            return
        self._say(f"{self._name}: connection closed: {why}")
        self._selector.unregister(self._client)
        self._client.close()
        self._client, self._peer, self._buffer = None, None, b""
        self.on_leave()

    def send(self, answers: list[bytes]) -> None:
        """Send answers in order and empty the list."""
        try:
            while answers and self._client is not None:
                self._client.sendall(answers.pop(0))
        except OSError as error:
            self.drop(str(error))
        answers.clear()

    def send_state(self, state: bytes) -> None:
        """Send a datagram to the client, if there is one; it may get lost."""
        if self._peer is not None:
            try:
                self.datagrams.sendto(state, self._peer)
            except OSError as error:
                self._say(f"{self._name}: state not sent: {error}")

    def received(self, size: int) -> list[bytes]:
        """Datagrams of the client of the right size that have come since the last call, oldest first."""
        found: list[bytes] = []
        while len(found) < DATAGRAMS_AT_ONCE:
            try:
                data, sender = self.datagrams.recvfrom(4096)
            except OSError:  # nothing more, or an earlier state that nobody took
                break
            if len(data) == size and self._peer is not None and sender[0] == self._peer[0]:
                found.append(data)
        return found

    def _accept(self) -> None:
        assert self._listener is not None
        try:
            connection, peer = self._listener.accept()
        except OSError:
            return
        if self.silent:
            self._mute.append(connection)
            return
        # Of a client that has left already, what it sent last is still to be read.
        while self._client is not None and select.select([self._client], [], [], 0.0)[0]:
            self._read()
        if self._client is not None:
            self._say(f"{self._name}: refused {peer[0]}: one client at a time")
            connection.close()
            return
        self._say(f"{self._name}: client {peer[0]}:{peer[1]}")
        connection.settimeout(SEND_TIMEOUT)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._client, self._host = connection, str(peer[0])
        self._selector.register(connection, selectors.EVENT_READ, self._read)

    def _read(self) -> None:
        assert self._client is not None
        try:
            data = self._client.recv(65536)
        except OSError as error:
            self.drop(str(error))
            return
        if not data:
            self.drop("the client has left")
            return
        if self.silent:
            return
        self._buffer += data
        try:
            while self._client is not None and self._take_request():
                pass
        except MalformedRequest as error:
            self.drop(str(error))

    def _take_request(self) -> bool:
        """Carry out the first request of the buffer; returns whether there was a whole one."""
        if len(self._buffer) < self._header.size:
            return False
        command, command_id, size = self._header.unpack_from(self._buffer)
        if command not in self._lengths:
            raise MalformedRequest(f"unknown command {command}")
        expected = self._header.size + self._lengths[command]
        if size != expected:
            raise MalformedRequest(f"command {command} announces {size} bytes, it has {expected}")
        if len(self._buffer) < size:
            return False
        body, self._buffer = self._buffer[self._header.size : size], self._buffer[size:]
        if command == 0:
            self._connect(command_id, body)
        elif self._peer is None:
            raise MalformedRequest(f"command {command} before a connect")
        else:
            self._request(command, command_id, body)
        return True

    def _connect(self, command_id: int, body: bytes) -> None:
        """Answer a connect: status (as wide as this service's statuses are), version of this side."""
        version, port = struct.unpack("<HH", body)
        assert self._client is not None
        fits = version == self.version
        status = ConnectStatus.SUCCESS if fits else ConnectStatus.INCOMPATIBLE_LIBRARY
        wide = struct.Struct("<HH" if self._header.size == 10 else "<BH")
        size = self._header.size + wide.size
        self.send([self._header.pack(0, command_id, size) + wide.pack(status, self.version)])
        if fits and self._client is not None:
            self._peer = (self._host, port)
        elif not fits:
            self._say(f"{self._name}: refused a library of version {version}, this is {self.version}")
