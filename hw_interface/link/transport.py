"""Zenoh sessions and the keys of a cell. Nothing is discovered or multicast.

Plain TCP stays within this machine (loopback). Between machines there is mutual TLS with rights by role; see
`hw_interface.link.security`.

The link lives long: a busy machine delays what passes over it and tears nothing. Who may have the robot moved, and
that a motion ends when nobody watches it, is decided elsewhere and sooner (`hw_interface.cell.operator_lease`).
"""

import ipaddress
import json
import socket

import zenoh

from control.errors import ConfigError, MachineError, RobotGoneError
from hw_interface.link.rights import access_rules
from hw_interface.link.security import LISTENING_ROLES, LinkSecurity
from hw_interface.link.trouble import why_no_link

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
# A killed process is noticed at once, by its closed socket. One that is not heard for the lease loses its link: it is
# frozen, or its cable is cut. No right to move depends on it, so it is as long as a machine may stall.
LEASE_MS = 10_000
KEEP_ALIVES_PER_LEASE = 4
QUEUE_BATCHES = 16  # of 64 kB; with the transport's own 2 a picture of megabytes waits for the sender's thread 50 times
# States have a queue of their own, so that they overtake pictures, and room for a second at 1 kHz (a batch takes about
# 100 of them) when a client's machine is busy. Beyond that they are dropped: nobody's slowness holds up a robot's loop.
STREAM_PRIORITY, _STREAM_QUEUE = zenoh.Priority.INTERACTIVE_HIGH, "interactive_high"

LOOK_TIMEOUT = 5.0  # [s] for the answer to who is there; it comes at once where nobody stalls

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
    if any(reply.ok is not None for reply in session.liveliness().get(ALIVE_KEY, timeout=LOOK_TIMEOUT)):
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
