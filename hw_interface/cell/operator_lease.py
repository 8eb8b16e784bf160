"""Who may have the robot moved: one operator at a time, for as long as that program lives and its heart beats.

An operator is a client that has sent a motion. It holds a liveliness token, which goes when its process is killed, its
link is cut or, after the lease (300 ms), when it is frozen; and it beats by
itself, which shows that its interpreter still runs. Losing either while a motion is played brings the arm to rest on
its path.
"""

import getpass
import re
import socket
import threading
import time
import uuid
from collections.abc import Callable
from types import TracebackType

import zenoh

from control.errors import RefusedError

OPERATOR_KEY = "cell/operator"  # liveliness token, followed by /<identity>/<label>
BEAT_KEY = "cell/operator_beat"  # followed by /<identity>; the payload is empty
BEAT_PERIOD = 0.2  # [s]
BEAT_LEASE = 1.5  # [s] without a beat; a program may well compute for a second without letting another thread run
OWN_PAUSE = 0.5  # [s] between two looks of the robot side after which the silence in between does not count
TOKEN_TIMEOUT = 1.0  # [s] for the answer to whether an unknown operator is there


class OperatorLease:
    """The robot side's view of its operators.

    Args:
        session: Of the robot process.
        clock: Monotonic clock in [s].
    """

    def __init__(self, session: zenoh.Session, clock: Callable[[], float] = time.monotonic) -> None:
        self._session, self._clock = session, clock
        self._labels: dict[str, str] = {}  # of those that are alive, by identity; written by the transport's thread
        self._beats: dict[str, float] = {}
        self._asked = clock()
        self.holder: str | None = None
        self._subscribers = (
            session.liveliness().declare_subscriber(f"{OPERATOR_KEY}/*/*", self._on_token, history=True),
            session.declare_subscriber(f"{BEAT_KEY}/*", self._on_beat),
        )

    def take(self, identity: str) -> str:
        """Give the robot to an operator, unless another one has it; returns the operator's label.

        Raises:
            RefusedError: other_operator, or no_operator: nobody lives under this identity.
        """
        if self.holder not in (None, identity) and self.holder in self._labels:
            raise RefusedError(
                "other_operator",
                f"'{self._labels[self.holder]}' operates this robot, and one may at a time; wait until that program "
                "has ended (anybody may stop the robot)",
            )
        # The token was declared before the motion was sent, but the two may come in another order.
        until = time.monotonic() + TOKEN_TIMEOUT
        while identity not in self._labels and time.monotonic() < until:
            for reply in self._session.liveliness().get(f"{OPERATOR_KEY}/{identity}/*", timeout=TOKEN_TIMEOUT):
                if reply.ok is not None:
                    self._see(str(reply.ok.key_expr))
            time.sleep(0.005)
        if identity not in self._labels:
            raise RefusedError("no_operator", "the motion's operator is not there any more; connect and send it again")
        self.holder = identity
        self._beats[identity] = self._clock()
        return self._labels[identity]

    def lost(self) -> str | None:
        """Why the operator who has the robot is no longer there, or None."""
        if self.holder is None:
            return "nobody operates the robot"
        if self.holder not in self._labels:
            return "the operator's program has ended or is frozen, or its link is cut"
        now = self._clock()
        if now - self._asked > OWN_PAUSE:
            self._beats[self.holder] = now  # this process stood still itself: what it has not heard says nothing
        self._asked = now
        silent = now - self._beats.get(self.holder, 0.0)
        if silent > BEAT_LEASE:
            return f"the operator's program has stood still for {silent:.1f} s"
        return None

    def _on_token(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        if sample.kind == zenoh.SampleKind.PUT:
            self._see(key)
        else:
            self._labels.pop(key.split("/")[-2], None)

    def _see(self, key: str) -> None:
        identity, label = key.split("/")[-2:]
        self._labels[identity] = label

    def _on_beat(self, sample: zenoh.Sample) -> None:
        self._beats[str(sample.key_expr).rsplit("/", 1)[-1]] = self._clock()


class Operator:
    """A client's side: alive and beating from its making until it is closed.

    Args:
        session: Of the client.

    Attributes:
        identity: What it is known by.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self.identity = uuid.uuid4().hex
        self._token = session.liveliness().declare_token(f"{OPERATOR_KEY}/{self.identity}/{operator_label()}")
        self._beat = session.declare_publisher(f"{BEAT_KEY}/{self.identity}")
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._beat_on, name="operator's heartbeat", daemon=True)
        self._thread.start()

    def __enter__(self) -> "Operator":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Give the robot back; closing it again does nothing."""
        if self._ended.is_set():
            return
        self._ended.set()
        self._thread.join(1.0)
        self._token.undeclare()

    def _beat_on(self) -> None:
        while not self._ended.wait(BEAT_PERIOD):
            try:
                self._beat.put(b"")
            except zenoh.ZError:
                return  # the session is closed


def operator_label() -> str:
    """Who this is, for people, as part of a key: user@host."""
    try:
        user = getpass.getuser()
    except (KeyError, OSError):
        user = "somebody"
    return re.sub(r"[^A-Za-z0-9_.@-]", "_", f"{user}@{socket.gethostname()}")[:60]
