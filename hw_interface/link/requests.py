"""Requests and their answers.

A request is a zenoh query. Its answer is either a message of the expected type, or an error payload that holds a
Refusal. No answer at all means that nobody was there to hear it, which is a failure and never a success.
"""

import logging
import queue
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import zenoh

from control.errors import RefusedError, RobotGoneError
from hw_interface.errors import MessageError
from hw_interface.link.rights import may_ask
from hw_interface.link.security import ROLES, Role
from hw_interface.messages.robot import Refusal
from hw_interface.messages.wire import M, Message, decode, encode
from hw_interface.own_time import LOOK, OwnTime

# The transport's own limit on a question runs on while this process stands still; the one that counts is kept here.
_TRANSPORTS_LIMIT = 3600.0  # [s]
_LOOKS_AT_LINK, _LOOK_PAUSE = 20, 0.005  # how often to look whether the link is there, and [s] between two looks
_LAST_WORDS = 1.0  # [s] for what is still to be sent when an outbox is closed


def ask(
    session: zenoh.Session, key: str, request: Message, expected: type[M], timeout: float, role: Role | None = None
) -> M:
    """The answer to a request: the first reply, whatever the other side does before it lets go of the query.

    Args:
        timeout: Longest wait in [s]; time in which this process itself stood still does not count.
        role: Of this side's certificate, if it has one: explains why there was no answer.

    Raises:
        RefusedError: The robot answered with a Refusal, or (no_right) the role may not ask this.
        RobotGoneError: No answer; says how long was waited, and what ended it.
        MessageError: An answer that is not a message of the expected type.
    """
    inbox: queue.SimpleQueue[zenoh.Reply | None] = queue.SimpleQueue()  # None: there will be no more
    waited, cancel = OwnTime(), zenoh.CancellationToken()
    session.get(
        key,
        zenoh.handlers.Callback(inbox.put, lambda: inbox.put(None)),
        payload=encode(request),
        timeout=timeout + _TRANSPORTS_LIMIT,
        # Otherwise a reply is held back until the other side lets go of the query.
        consolidation=zenoh.ConsolidationMode.NONE,
        # A request that the link has no room for now waits; so does its answer, which has the request's own settings.
        congestion_control=zenoh.CongestionControl.BLOCK,
        cancellation_token=cancel,
    )
    try:
        ended_by = ""
        while (left := timeout - waited.look()) > 0.0:
            try:
                reply = inbox.get(timeout=min(left, LOOK))
            except queue.Empty:
                continue
            if reply is None:
                ended_by = _without_an_answer(session, waited)
                break
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
    finally:
        cancel.cancel()
    if role is not None and not may_ask(role, key):
        raise RefusedError(
            "no_right",
            f"this link's certificate has role '{role}', which may not use '{key}'; nothing was done: use a link file "
            f"of a role that may ({', '.join(r for r in ROLES if may_ask(r, key))})",
        )
    raise RobotGoneError(f"the robot process did not answer '{key}': {ended_by or _too_late(waited)}")


def _without_an_answer(session: zenoh.Session, waited: OwnTime) -> str:
    after = f"after {waited.look():.2f} s"
    # The transport ends the questions over a link before it says that the link has ended.
    for _ in range(_LOOKS_AT_LINK):
        if not any((*session.info.routers_zid(), *session.info.peers_zid())):
            return (
                f"{after} the link to it was lost; see whether it still runs, to the cable and to the network, then "
                "connect again"
            )
        time.sleep(_LOOK_PAUSE)
    return f"{after} there was nobody who would; it has ended, does not offer it, or gives this link no right to it"


def _too_late(waited: OwnTime) -> str:
    stood = f" (besides {waited.stood_still:.1f} s in which this process stood still)" if waited.stood_still > 0 else ""
    return (
        f"nothing came in {waited.counted:.1f} s{stood}; it is frozen or too busy, its link is slow, or it gives this "
        "link no right to it"
    )


def answer(query: zenoh.Query, message: Message) -> None:
    """Answer a query: with a reply, or with an error payload if the message is a Refusal.

    Waits while the asker's link is full. An asker who takes nothing for 5 s loses that link.
    """
    _reply(query, encode(message), isinstance(message, Refusal))


def _reply(query: zenoh.Query, payload: bytes, refused: bool) -> None:
    if refused:
        query.reply_err(payload)
    else:
        query.reply(query.key_expr, payload)


def read_request(query: zenoh.Query, expected: type[M]) -> M:
    """The request in a query.

    Raises:
        MessageError: No payload, or one that is not such a message.
    """
    payload = query.payload
    return decode(b"" if payload is None else payload.to_bytes(), expected)


def refusal_of(error: Exception) -> Refusal:
    """What to answer when a request has failed, so that a peer always learns why."""
    if isinstance(error, RefusedError):
        return Refusal(code=error.code, reason=str(error)[:2000])
    if isinstance(error, MessageError):
        return Refusal(code="bad_message", reason=str(error)[:2000])
    # A fault of ours in one answer must not end the process that holds the arm.
    return Refusal(code="internal_error", reason=f"{type(error).__name__}: {error}"[:2000])


@contextmanager
def refusing(query: zenoh.Query) -> Iterator[None]:
    """Turn every failure inside into a Refusal answered to the query."""
    try:
        yield
    except Exception as error:
        answer(query, refusal_of(error))


class Outbox:
    """Sends answers and bulky news on a thread of its own, in order, so that no asker holds up a robot's loop.

    Nothing is dropped: what a full link has no room for waits. Where a reader takes nothing for 5 s the transport ends
    its link, and what was meant for it is void.

    Args:
        session: On which news are published.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._waiting: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._send, name="outbox", daemon=True)
        self._thread.start()

    def reply(self, query: zenoh.Query, message: Message) -> None:
        """Answer a query and let go of it; a Refusal as an error payload.

        Raises:
            MessageError: The message is too large.
        """
        payload, refused = encode(message), isinstance(message, Refusal)

        def send() -> None:
            with query:
                _reply(query, payload, refused)

        self._waiting.put(send)

    def publish(self, key: str, payload: zenoh.ZBytes | bytes) -> None:
        """Publish a message on a key."""
        self._waiting.put(lambda: self._session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK))

    def close(self) -> None:
        """Send what is left, as far as that takes no longer than a second."""
        self._waiting.put(None)
        self._thread.join(_LAST_WORDS)

    def _send(self) -> None:
        while (send := self._waiting.get()) is not None:
            try:
                send()
            except zenoh.ZError as error:
                logging.getLogger(__name__).warning("a message could not be sent: %s", error)
