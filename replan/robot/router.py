"""The process of a router: a session that listens, passes messages on and enforces rights; it says nothing itself."""

import time
from collections.abc import Callable

from hw_interface.cell.pacing import Leash
from hw_interface.link.security import LinkSecurity
from hw_interface.link.transport import open_listening_session

_BEAT = 0.1  # [s] between two looks at whether to end


def serve_router(endpoint: str, security: LinkSecurity | None, announce: Callable[[str], None]) -> None:
    """Pass messages on until SIGTERM, SIGINT or SIGHUP.

    Args:
        endpoint: Where to listen.
        security: Certificates, for a "tls/" endpoint.
        announce: Called with the endpoint that it really has, once it listens.

    Raises:
        ConfigError: The endpoint is not valid, or the certificate is not one to listen with.
        MachineError: The port is in use.
    """
    leash = Leash()
    with leash.signals():
        session, endpoint = open_listening_session(endpoint, security)
        try:
            announce(endpoint)
            while not leash.ended():
                time.sleep(_BEAT)
        finally:
            session.close()
