"""Speaking to a control box just enough to know what is wrong with it: plain sockets, a timeout everywhere.

libfranka waits for ever for a box that takes a connection and does not answer; this does not. Nothing is moved, no
setting is changed, and the connection is closed again.
"""

import socket
import struct
import time
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Literal

import numpy as np

from hw_interface.fci_simulator.layout import (
    ERROR_NAMES,
    GRIPPER_HEADER,
    GRIPPER_PORT,
    GRIPPER_VERSION,
    HEADER,
    PORT,
    STATE,
    VERSION,
    ConnectStatus,
    Mode,
)

LOOK_TIME = 0.5  # [s] of listening to states

Trouble = Literal["no_host", "unreachable", "refused", "closed", "silent", "foreign", "version", "no_states"]


@dataclass(frozen=True)
class Answer:
    """How far one service let us come.

    Attributes:
        trouble: Where it ended, or None:
            no_host      the name has no address
            unreachable  no answer from the network
            refused      the machine is there, nothing listens at the port
            closed       the connection was taken and closed without an answer
            silent       the connection was taken, and nothing came
            foreign      something came that is no answer of this protocol
            version      the other side speaks another version
            no_states    connected, but no datagram with a state arrives
        detail: What the system said, or what came.
        version: Protocol version of the other side, or None if it did not tell.
    """

    trouble: Trouble | None
    detail: str = ""
    version: int | None = None


@dataclass(frozen=True)
class RobotAnswer(Answer):
    """What a robot's states say beside.

    Attributes:
        mode: What the robot does; None without a state.
        errors: Names of the present errors.
        states_per_second: That arrived.
    """

    mode: Mode | None = None
    errors: tuple[str, ...] = ()
    states_per_second: float = 0.0


def ask_robot(address: str, timeout: float = 2.0) -> RobotAnswer:
    """Connect to a robot, look at its states for half a second, leave.

    Args:
        address: Host name or address of the control box.
        timeout: Longest wait in [s] at each step.
    """
    with ExitStack() as open_sockets:
        answer, states = _connect(address, PORT, HEADER, "<BH", VERSION, timeout, open_sockets)
        if answer.trouble is not None or states is None:
            return RobotAnswer(answer.trouble, answer.detail, answer.version)
        begun, count, last = time.monotonic(), 0, b""
        try:
            while count == 0 or time.monotonic() - begun < LOOK_TIME:
                last = states.recv(8192)
                count += 1
        except OSError as error:
            if not last:
                return RobotAnswer("no_states", str(error), answer.version)
        rate = count / (time.monotonic() - begun)
        if len(last) != STATE.itemsize:
            return RobotAnswer("foreign", f"states of {len(last)} bytes instead of {STATE.itemsize}", answer.version)
        state = np.frombuffer(last, STATE)[0]
        errors = tuple(ERROR_NAMES[k] for k in np.flatnonzero(state["errors"]))
        return RobotAnswer(None, "", answer.version, Mode(int(state["robot_mode"])), errors, rate)


def ask_gripper(address: str, timeout: float = 2.0) -> Answer:
    """Connect to a robot's gripper and leave."""
    with ExitStack() as open_sockets:
        answer, _ = _connect(address, GRIPPER_PORT, GRIPPER_HEADER, "<HH", GRIPPER_VERSION, timeout, open_sockets)
        return answer


def listens(address: str, port: int, timeout: float = 2.0) -> bool:
    """Whether anything takes connections there."""
    try:
        socket.create_connection((address, port), timeout).close()
    except OSError:
        return False
    return True


def _connect(
    address: str,
    port: int,
    header: struct.Struct,
    status_and_version: str,
    version: int,
    timeout: float,
    open_sockets: ExitStack,
) -> tuple[Answer, socket.socket | None]:
    """The handshake; returns the socket that states come to while `open_sockets` is open."""
    try:
        socket.getaddrinfo(address, port, socket.AF_INET, socket.SOCK_STREAM)
    except OSError as error:
        return Answer("no_host", error.strerror or str(error)), None
    try:
        connection = open_sockets.enter_context(socket.create_connection((address, port), timeout))
    except ConnectionRefusedError as error:
        return Answer("refused", str(error)), None
    except OSError as error:
        return Answer("unreachable", error.strerror or str(error)), None
    states = open_sockets.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    states.bind((connection.getsockname()[0], 0))
    states.settimeout(timeout)
    connection.settimeout(timeout)
    rest = struct.Struct(status_and_version)
    wanted, received = header.size + rest.size, b""
    try:
        connection.sendall(header.pack(0, 0, header.size + 4) + struct.pack("<HH", version, states.getsockname()[1]))
        until = time.monotonic() + timeout
        while len(received) < wanted:
            connection.settimeout(max(0.01, until - time.monotonic()))
            piece = connection.recv(wanted - len(received))
            if not piece:
                return Answer("closed"), None
            received += piece
    except TimeoutError:
        return Answer("silent" if not received else "foreign", f"{len(received)} bytes"), None
    except OSError as error:
        return Answer("closed", error.strerror or str(error)), None
    command, command_id, size = header.unpack_from(received)
    status, spoken = rest.unpack_from(received, header.size)
    if (command, command_id, size) != (0, 0, wanted) or status not in list(ConnectStatus):
        return Answer("foreign", received.hex()), None
    if status != ConnectStatus.SUCCESS or spoken != version:
        return Answer("version", "", spoken), None
    return Answer(None, "", spoken), states
