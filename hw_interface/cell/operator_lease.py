"""Who may have the robot moved: one operator at a time, for as long as that program lives and its heart beats.

An operator is a client that has sent a motion. It holds a liveliness token, which goes when its process is killed or
its link is closed, and it beats: a thread of the program says every 50 ms that the program runs. The beat is the
application's and goes from end to end, over routers too; how long the link itself lives has nothing to do with it.

The beat counts only while a motion is played. On a robot whose time does not wait, a second without one brings the
arm to rest on its path. That is twenty beats: more than a lost packet takes (Linux sends again after 0.2 s), and more
than a machine with busy cores keeps a thread waiting (0.5 s were measured beside a test suite on two cores). A
program that computes for so long without letting its other threads run counts as silent too; it would not hear a Ctrl-C
either. A simulation waits instead: its time stands still until the beats come again.
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
from hw_interface.own_time import OwnTime

OPERATOR_KEY = "cell/operator"  # liveliness token, followed by /<identity>/<label>
BEAT_KEY = "cell/operator_beat"  # followed by /<identity>; the payload is empty
BEAT_PERIOD = 0.05  # [s]
BEAT_LEASE = 1.0  # [s] without a beat after which the operator counts as silent
PATIENCE = 60.0  # [s] without a beat after which even a simulation waits no longer
TOKEN_LOOKS, TOKEN_PAUSE = 200, 0.005  # how often to look for an unknown operator, and [s] between two looks
TOKEN_TIMEOUT = 1.0  # [s] for the answer to one look; it comes at once


class OperatorLease:
    """The robot side's view of its operators.

    Args:
        session: Of the robot process.
        clock: Monotonic clock in [s].
    """

    def __init__(self, session: zenoh.Session, clock: Callable[[], float] = time.monotonic) -> None:
        self._session = session
        self._labels: dict[str, str] = {}  # of those that are alive, by identity; written by the transport's thread
        self._beats: dict[str, int] = {}  # heard so far, by identity; likewise
        self._heard = 0  # of them, at the last look
        self._silence = OwnTime(clock)
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
        for _ in range(TOKEN_LOOKS):
            if identity in self._labels:
                break
            for reply in self._session.liveliness().get(f"{OPERATOR_KEY}/{identity}/*", timeout=TOKEN_TIMEOUT):
                if reply.ok is not None:
                    self._see(str(reply.ok.key_expr))
            time.sleep(TOKEN_PAUSE)
        if identity not in self._labels:
            raise RefusedError("no_operator", "the motion's operator is not there any more; connect and send it again")
        self.holder = identity
        self._silence.restart()
        return self._labels[identity]

    def silence(self) -> float:
        """For how long in [s] of this process's own time the operator who has the robot was not heard."""
        beats = self._beats.get(self.holder or "", 0)
        if beats != self._heard:
            self._heard = beats
            self._silence.restart()
        return self._silence.look()

    def lost(self, patience: float = BEAT_LEASE) -> str | None:
        """Why the operator who has the robot is no longer there, or None.

        Args:
            patience: Longest silence in [s].
        """
        if self.holder is None:
            return "nobody operates the robot"
        if self.holder not in self._labels:
            return "the operator's program has ended, or its link is cut"
        silent = self.silence()
        if silent > patience:
            return (
                f"the operator's program was not heard for {silent:.1f} s: it is frozen, its link is cut, or it "
                "computes without letting its other threads run"
            )
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
        identity = str(sample.key_expr).rsplit("/", 1)[-1]
        self._beats[identity] = self._beats.get(identity, 0) + 1


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
        # A beat overtakes what is bulky. One that the link has no room for is dropped: the next one says the same.
        self._beat = session.declare_publisher(
            f"{BEAT_KEY}/{self.identity}",
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.REAL_TIME,
            express=True,
        )
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
