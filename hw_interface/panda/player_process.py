"""The player as a child process of the supervisor: starting it, seeing that it lives, ending it when it does not."""

import os
import signal
import subprocess
import time
from collections.abc import Sequence
from multiprocessing.connection import Pipe

from control.errors import MachineError, RobotGoneError
from hw_interface.messages.robot import Refusal
from hw_interface.messages.wire import Message
from hw_interface.own_time import LOOK, OwnTime
from hw_interface.panda.board import ClearanceBoard
from hw_interface.panda.link import Link, PlayerReady

CONNECT_TIMEOUT = 15.0  # [s] until the control box has answered; importing takes a second or two
# [s] of the supervisor's own time without a turn of the player's loop after which it is ended. At rest nothing waits
# for it but the next motion, which asks it first: it may stand still for as long as a link may.
STILL_MOVING, STILL_RESTING = 0.3, 10.0


class PlayerProcess:
    """A running player. Its pipe and memory are inherited by descriptor, so no other process can pose as it.

    It connects to the control box by itself; `connected` tells when it has.

    Args:
        command: Program and arguments; `--link-fd N --board-fd N` are added.
        still_moving: Time in [s] without a turn of its loop in a motion after which it counts as hung.
    """

    def __init__(self, command: Sequence[str], still_moving: float = STILL_MOVING) -> None:
        self._still_moving = still_moving
        ours, theirs = Pipe()
        self.board = ClearanceBoard.create()
        self.link = Link(ours)
        descriptors = (theirs.fileno(), self.board.descriptor)
        arguments = ["--link-fd", str(descriptors[0]), "--board-fd", str(descriptors[1])]
        self._process = subprocess.Popen(
            [*command, *arguments], stdin=subprocess.DEVNULL, pass_fds=descriptors, start_new_session=True
        )
        theirs.close()
        self.pid = self._process.pid
        self._turns, self._still = 0, OwnTime()
        self._connecting = OwnTime()
        self._ready = False

    def connected(self, wait: float = 0.0) -> bool:
        """Whether the control box has answered and measurements come.

        Args:
            wait: Longest wait for that in [s].

        Raises:
            MachineError: The player says why it cannot work with the control box.
            RobotGoneError: The control box takes connections and is silent, or the player died.
        """
        waited = OwnTime()
        while True:
            left = max(0.0, wait - waited.look())
            if self._ready:
                time.sleep(min(left, 0.002))
            else:
                self._hear(min(left, LOOK))
            if self._ready and self.board.written > 0:
                self._still.restart()
                return True
            if self._connecting.look() >= CONNECT_TIMEOUT:
                raise RobotGoneError(
                    f"the control box took the connection and was silent for {CONNECT_TIMEOUT:g} s; see that FCI is "
                    "active in Desk and that no other program holds it"
                )
            if left <= 0.0:
                return False

    def _hear(self, wait: float) -> None:
        try:
            message = self.link.receive(wait)
        except (EOFError, OSError):
            code = self._process.wait(5.0)
            raise RobotGoneError(f"the player ended before the control box was ready (exit code {code})") from None
        if isinstance(message, Refusal):
            raise MachineError(message.reason)
        self._ready = isinstance(message, PlayerReady)

    @property
    def running(self) -> bool:
        """Whether the process has not ended."""
        return self._process.poll() is None

    def silent(self, moving: bool) -> float | None:
        """For how long in [s] of this process's own time its loop has not turned, when that is too long; else None.

        Args:
            moving: Whether a part is being played; at rest requests to the control box may take a while.
        """
        turns = self.board.alive
        if turns != self._turns:
            self._turns = turns
            self._still.restart()
        still = self._still.look()
        return still if still > (self._still_moving if moving else STILL_RESTING) else None

    def ask(self, message: Message, expected: type[Message], wait: float) -> Message:
        """The answer to a request at rest.

        Raises:
            RobotGoneError: None of the expected kind within `wait` seconds.
        """
        try:
            self.link.send(message)
            waited = OwnTime()
            while (left := wait - waited.look()) > 0.0:
                answer = self.link.receive(min(left, LOOK))
                if isinstance(answer, expected | Refusal):
                    return answer
        except (EOFError, OSError):
            pass
        raise RobotGoneError(f"the player did not answer '{message.type_name}' within {wait:g} s")

    def kill(self) -> None:
        """End it at once; the control box then brings the arm to rest by itself."""
        if self.running:
            os.kill(self.pid, signal.SIGKILL)
            self._process.wait()

    def close(self) -> None:
        """Let go of it: it ends when its pipe closes; killed when it does not."""
        self.link.close()
        try:
            self._process.wait(1.0)
        except subprocess.TimeoutExpired:
            self.kill()
        self.board.close()
