"""Zenoh sessions and request/answer helpers. Nothing is discovered or multicast.

Plain TCP stays within this machine (loopback). Between machines there is mutual TLS with rights by role; see
`hw_interface.link.security`.

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
from hw_interface.link.rights import access_rules, may_ask
from hw_interface.link.security import LISTENING_ROLES, ROLES, LinkSecurity, Role
from hw_interface.link.trouble import why_no_link
from hw_interface.messages.robot import Refusal
from hw_interface.messages.wire import M, Message, decode, encode

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
# A killed process is noticed at once, a frozen one after its lease. Keep-alives come from the transport's own threads,
# so a process that computes for seconds without letting go of Python's lock keeps its lease. Nor did a link lose it in
# 40 s with five times as many busy processes as processors.
LEASE_MS = 300
KEEP_ALIVES_PER_LEASE = 4
QUEUE_BATCHES = 16  # of 64 kB; with the transport's own 2 a picture of megabytes waits for the sender's thread 50 times
# States have a queue of their own, so that they overtake pictures, and room for a second at 1 kHz (a batch takes about
# 100 of them) when a client's machine is busy. Beyond that they are dropped: nobody's slowness holds up a robot's loop.
STREAM_PRIORITY, _STREAM_QUEUE = zenoh.Priority.INTERACTIVE_HIGH, "interactive_high"

ALIVE_KEY = "cell/alive"  # liveliness token of the robot process
INFO_KEY = "cell/info"
STATE_KEY = "cell/state"  # published, and answered to a query with a fresh measurement
FRAME_KEY = "cell/frame"  # followed by /<camera>
CAMERA_KEY = "cell/camera"  # liveliness token of a camera process; followed by /<camera>/<owner>
CAMERA_HEALTH_KEY = "cell/camera_health"  # published and answered by a camera process; followed by /<camera>
CLOCK_KEY = "cell/clock"
TRAJECTORY_KEY = "cell/trajectory"
EXECUTING_KEY = "cell/executing"  # published: each trajectory that the robot has accepted
STOP_KEY = "cell/stop"
SPEED_KEY = "cell/speed"
ACKNOWLEDGE_KEY = "cell/acknowledge"
RESULT_KEY = "cell/result"
TRUTH_KEY = "cell/truth"  # exists only in simulated cells started for scoring
FRAME_TRUTH_KEY = "cell/frame_truth"  # likewise; followed by the camera's name


def parse_endpoint(endpoint: str, secured: bool = False) -> tuple[str, str, int]:
    """Protocol, host and port of "tcp/HOST:PORT" or "tls/HOST:PORT".

    Args:
        secured: Whether the process has certificates (a link file).

    Raises:
        ConfigError: Another form; plain TCP to or from another machine, or although there are certificates; TLS
            without them.
    """
    protocol, _, address = endpoint.partition("/")
    host, _, port = address.rpartition(":")
    if protocol not in ("tcp", "tls") or not host or not port.isdecimal() or int(port) > 65535:
        raise ConfigError(
            f"endpoint '{endpoint}' is not valid; write it as {DEFAULT_ENDPOINT} (port 0 picks a free one), or as "
            "tls/HOST:PORT with a link file between machines"
        )
    if protocol == "tls" and not secured:
        raise ConfigError(
            f"endpoint '{endpoint}' needs certificates: give a link file (--link FILE; `replan security init` makes "
            "one for each role)"
        )
    if protocol == "tcp" and secured:
        raise ConfigError(
            f"endpoint '{endpoint}' is plain TCP, but a link file was given: write tls/{address}, or leave the link "
            "file out"
        )
    if protocol == "tcp" and not _is_loopback(host):
        raise ConfigError(
            f"endpoint '{endpoint}' is not on this machine; messages over plain TCP are neither encrypted nor "
            f"authenticated, so only loopback addresses such as {DEFAULT_ENDPOINT} are allowed: write tls/{address} "
            "and give a link file (--link FILE; `replan security init` makes one for each role)"
        )
    return protocol, host, int(port)


def _is_loopback(host: str) -> bool:
    try:
        return host == "localhost" or ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def _config(
    mode: str, listen: list[str], connect: list[str], timeout: float, security: LinkSecurity | None
) -> zenoh.Config:
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
        "transport/link/protocols": ["tcp" if security is None else "tls"],
        "transport/link/tx/lease": LEASE_MS,
        "transport/link/tx/keep_alive": KEEP_ALIVES_PER_LEASE,
        **{f"transport/link/tx/queue/size/{queue}": QUEUE_BATCHES for queue in (_STREAM_QUEUE, "data")},
        "transport/shared_memory/enabled": False,  # segments would outlive a killed process
    }
    if security is not None:
        settings |= security.tls_settings()
        if listen:
            settings["access_control"] = access_rules()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def open_listening_session(
    endpoint: str = DEFAULT_ENDPOINT, security: LinkSecurity | None = None
) -> tuple[zenoh.Session, str]:
    """Session that listens at the endpoint and passes on what its clients say to each other.

    Args:
        security: Certificates, for a "tls/" endpoint; the session enforces the rights of `hw_interface.link.rights`.

    Returns:
        The session, and the endpoint with the port it really has.

    Raises:
        ConfigError: The endpoint is not valid, or the certificate is not one to listen with.
        MachineError: Its port is in use, or it cannot listen there.
    """
    protocol, host, port = parse_endpoint(endpoint, security is not None)
    if security is not None and security.role not in LISTENING_ROLES:
        raise ConfigError(f"the link file has role '{security.role}'; only {' and '.join(LISTENING_ROLES)} may listen")
    if port == 0:
        with socket.create_server((host.strip("[]"), 0)) as probe:  # the transport cannot tell which port it was given
            port = probe.getsockname()[1]
        endpoint = f"{protocol}/{host}:{port}"
    try:
        return zenoh.open(_config("router", [endpoint], [], 1.0, security)), endpoint
    except zenoh.ZError as error:
        if "in use" in str(error):
            raise MachineError(
                f"port {port} is in use; another cell may be running: end it, or choose another port "
                f"(--endpoint {protocol}/{host}:PORT, port 0 picks a free one)"
            ) from error
        raise MachineError(f"cannot listen at '{endpoint}': {error}") from error


def open_robot_session(
    endpoint: str = DEFAULT_ENDPOINT,
    security: LinkSecurity | None = None,
    connect: bool = False,
) -> tuple[zenoh.Session, str]:
    """Session of a robot process, and the endpoint at which clients find it.

    Args:
        endpoint: Where to listen; with `connect`, where the router listens that the robot joins.
        security: Certificates, for a "tls/" endpoint.
        connect: Connect to a router instead of listening.

    Raises:
        ConfigError: The endpoint is not valid, or the certificate is not a robot's.
        MachineError: The port is in use, or the router has a robot already.
        RobotGoneError: No router answers there.
    """
    if not connect:
        return open_listening_session(endpoint, security)
    if security is not None and security.role != "robot":
        raise ConfigError(f"the link file has role '{security.role}'; a robot process needs one with role 'robot'")
    session = _connect(endpoint, 5.0, security, "router", "start one (replan router)")
    if any(reply.ok is not None for reply in session.liveliness().get(ALIVE_KEY, timeout=1.0)):
        session.close()
        raise MachineError(f"the router at {endpoint} has a robot already; end that one, or start another router")
    return session, endpoint


def open_client_session(
    endpoint: str = DEFAULT_ENDPOINT,
    timeout: float = 5.0,
    security: LinkSecurity | None = None,
) -> zenoh.Session:
    """Session of a client, connected to the robot process or router at the endpoint within `timeout` seconds.

    Args:
        timeout: Longest wait in [s].
        security: Certificates, for a "tls/" endpoint.

    Raises:
        ConfigError: The endpoint is not valid.
        RobotGoneError: Nobody answers there, or certificates are not accepted.
    """
    return _connect(
        endpoint,
        timeout,
        security,
        "robot process",
        "start one (replan robot sim) or give the endpoint that it printed",
    )


def _connect(endpoint: str, timeout: float, security: LinkSecurity | None, whom: str, remedy: str) -> zenoh.Session:
    protocol, host, port = parse_endpoint(endpoint, security is not None)
    try:
        return zenoh.open(_config("client", [], [endpoint], timeout, security))
    except zenoh.ZError as error:
        why = why_no_link(protocol, host, port, security, timeout)
        raise RobotGoneError(f"no {whom} answers at {endpoint} within {timeout:g} s; {why or remedy}") from error


def ask(
    session: zenoh.Session, key: str, request: Message, expected: type[M], timeout: float, role: Role | None = None
) -> M:
    """The answer to a request.

    Args:
        timeout: Longest wait in [s].
        role: Of this side's certificate, if it has one: explains why there was no answer.

    Raises:
        RefusedError: The robot answered with a Refusal, or (no_right) the role may not ask this.
        RobotGoneError: No answer.
        MessageError: An answer that is not a message of the expected type.
    """
    # The first reply is the answer; what the other side does before it lets go of the query is not waited for.
    for reply in session.get(key, payload=encode(request), timeout=timeout):
        if reply.ok is not None:
            return decode(reply.ok.payload.to_bytes(), expected)
        assert reply.err is not None
        payload = reply.err.payload.to_bytes()
        try:
            refusal = decode(payload, Refusal)
        except MessageError as error:
            if error.field == "protocol":
                raise
            break  # the transport's own errors ("Timeout") are plain text
        raise RefusedError(refusal.code, refusal.reason)
    if role is not None and not may_ask(role, key):
        raise RefusedError(
            "no_right",
            f"this link's certificate has role '{role}', which may not use '{key}'; nothing was done: use a link file "
            f"of a role that may ({', '.join(r for r in ROLES if may_ask(r, key))})",
        )
    raise RobotGoneError(
        f"the robot process did not answer '{key}' within {timeout:g} s; it has ended, is frozen, does not "
        "offer it, or gives this link no right to it"
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
