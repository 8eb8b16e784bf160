"""A client process for tests: `python -m ...hw_link_peer ENDPOINT BUSY LEASE`; offers what a camera process does.

BUSY is for how many whole seconds it keeps Python's lock, once, after it has begun; LEASE is of its link, in [ms].
"""

import ctypes
import sys
import time

from hw_interface.link import transport

NAME = "bench"


def hold_the_lock(seconds: int) -> None:
    """What a long operation in an extension does: no other Python thread runs meanwhile (PyDLL keeps the lock)."""
    ctypes.PyDLL(None).sleep(seconds)


def main(endpoint: str, busy: int, lease_ms: int) -> None:
    """Offer a frame key, a topic and a liveliness token until killed."""
    transport.LEASE_MS = lease_ms
    session = transport.open_client_session(endpoint)
    held = [
        session.declare_queryable(f"{transport.FRAME_KEY}/{NAME}", lambda q: q.reply(q.key_expr, b"a picture")),
        session.liveliness().declare_token(f"cell/camera/{NAME}"),
    ]
    publisher = session.declare_publisher("cell/news")
    print("ready", flush=True)
    if busy:
        time.sleep(0.3)
        hold_the_lock(busy)
        print("computed", flush=True)
    while held:
        publisher.put(b"news")
        time.sleep(0.02)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
