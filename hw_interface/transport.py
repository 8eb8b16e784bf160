"""Zenoh sessions and request/answer helpers. Loopback TCP only by default; nothing is discovered or multicast.

A request is a zenoh query. Its answer is either a message of the expected type, or an error payload that holds a
Refusal. No answer at all means that nobody was there to hear it, which is a failure and never a success.
"""

import ipaddress
import json
import socket
from collections.abc import Iterator
from contextlib import contextmanager

import zenoh

from control.errors import ConfigError, MachineError, RefusedError, RobotGoneError
from hw_interface.errors import MessageError
from hw_interface.messages import Refusal
from hw_interface.wire import M, Message, decode, encode

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
# A frozen process is noticed after its lease; four keep-alives a lease leave room for a busy machine.
LEASE_MS = 600
KEEP_ALIVES_PER_LEASE = 4

ALIVE_KEY = "cell/alive"  # liveliness token of the robot process
INFO_KEY = "cell/info"
STATE_KEY = "cell/state"  # published, and answered to a query with a fresh measurement
FRAME_KEY = "cell/frame"  # followed by /<camera>
CAMERA_KEY = "cell/camera"  # liveliness token of a camera process; followed by /<camera>/<owner>
TRAJECTORY_KEY = "cell/trajectory"
EXECUTING_KEY = "cell/executing"  # published: each trajectory that the robot has accepted
STOP_KEY = "cell/stop"
SPEED_KEY = "cell/speed"
ACKNOWLEDGE_KEY = "cell/acknowledge"
RESULT_KEY = "cell/result"
TRUTH_KEY = "cell/truth"  # exists only in simulated cells started for scoring
FRAME_TRUTH_KEY = "cell/frame_truth"  # likewise; followed by the camera's name


def parse_endpoint(endpoint: str, allow_remote: bool = False) -> tuple[str, int]:
    """Host and port of "tcp/HOST:PORT".

    Raises:
        ConfigError: Another form, or a host that is not this machine while `allow_remote` is False.
    """
    protocol, _, address = endpoint.partition("/")
    host, _, port = address.rpartition(":")
    if protocol != "tcp" or not host or not port.isdecimal() or int(port) > 65535:
        raise ConfigError(
            f"endpoint '{endpoint}' is not valid; write it as {DEFAULT_ENDPOINT} (port 0 picks a free one)"
        )
    try:
        loopback = host == "localhost" or ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        loopback = False
    if not (loopback or allow_remote):
        raise ConfigError(
            f"endpoint '{endpoint}' is not on this machine; messages are neither encrypted nor authenticated, "
            f"so only loopback addresses such as {DEFAULT_ENDPOINT} are allowed"
        )
    return host, int(port)


def _config(mode: str, listen: list[str], connect: list[str], timeout: float) -> zenoh.Config:
    config = zenoh.Config()
    settings = {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "listen/endpoints": listen,
        "listen/exit_on_failure": True,
        "connect/endpoints": connect,
        "connect/timeout_ms": round(timeout * 1000),
        "connect/exit_on_failure": True,
        "transport/link/tx/lease": LEASE_MS,
        "transport/link/tx/keep_alive": KEEP_ALIVES_PER_LEASE,
        "transport/shared_memory/enabled": False,  # segments would outlive a killed process
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def open_robot_session(endpoint: str = DEFAULT_ENDPOINT) -> tuple[zenoh.Session, str]:
    """Session of a robot process that listens at the endpoint, and the endpoint with the port it really has.

    Raises:
        ConfigError: The endpoint is not valid or its port is in use.
    """
    host, port = parse_endpoint(endpoint)
    if port == 0:
        with socket.create_server((host, 0)) as probe:  # the transport cannot tell which port it was given
            port = probe.getsockname()[1]
        endpoint = f"tcp/{host}:{port}"
    try:
        return zenoh.open(_config("peer", [endpoint], [], 1.0)), endpoint
    except zenoh.ZError as error:
        if "in use" in str(error):
            raise MachineError(
                f"port {port} is in use; another cell may be running: end it, or choose another port "
                f"(--endpoint tcp/{host}:PORT, port 0 picks a free one)"
            ) from error
        raise MachineError(f"cannot listen at '{endpoint}': {error}") from error


def open_client_session(endpoint: str = DEFAULT_ENDPOINT, timeout: float = 5.0) -> zenoh.Session:
    """Session of a client, connected to the robot process at the endpoint within `timeout` seconds.

    Raises:
        ConfigError: The endpoint is not valid.
        RobotGoneError: Nobody answers there.
    """
    parse_endpoint(endpoint)
    try:
        return zenoh.open(_config("client", [], [endpoint], timeout))
    except zenoh.ZError as error:
        raise RobotGoneError(
            f"no robot process answers at {endpoint} within {timeout:g} s; start one (replan robot sim) "
            "or give the endpoint that it printed"
        ) from error


def ask(session: zenoh.Session, key: str, request: Message, expected: type[M], timeout: float) -> M:
    """The answer to a request.

    Args:
        timeout: Longest wait in [s].

    Raises:
        RefusedError: The robot answered with a Refusal.
        RobotGoneError: No answer.
        MessageError: An answer that is not a message of the expected type.
    """
    replies = list(session.get(key, payload=encode(request), timeout=timeout))
    for reply in replies:
        if reply.ok is not None:
            return decode(reply.ok.payload.to_bytes(), expected)
        assert reply.err is not None
        payload = reply.err.payload.to_bytes()
        try:
            refusal = decode(payload, Refusal)
        except MessageError:
            break  # the transport's own errors ("Timeout") are plain text
        raise RefusedError(refusal.code, refusal.reason)
    raise RobotGoneError(
        f"the robot process did not answer '{key}' within {timeout:g} s; it has ended, is frozen, or does not offer it"
    )


def answer(query: zenoh.Query, message: Message) -> None:
    """Answer a query: with a reply, or with an error payload if the message is a Refusal."""
    if isinstance(message, Refusal):
        query.reply_err(encode(message))
    else:
        query.reply(query.key_expr, encode(message))


def read_request(query: zenoh.Query, expected: type[M]) -> M:
    """The request in a query.

    Raises:
        MessageError: No payload, or one that is not such a message.
    """
    payload = query.payload
    return decode(b"" if payload is None else payload.to_bytes(), expected)


@contextmanager
def refusing(query: zenoh.Query) -> Iterator[None]:
    """Turn every failure inside into a Refusal answered to the query, so that a peer always learns why."""
    try:
        yield
    except RefusedError as error:
        answer(query, Refusal(code=error.code, reason=str(error)[:2000]))
    except MessageError as error:
        answer(query, Refusal(code="bad_message", reason=str(error)[:2000]))
    except Exception as error:  # a fault of ours in one answer must not end the process that holds the arm
        answer(query, Refusal(code="internal_error", reason=f"{type(error).__name__}: {error}"[:2000]))
