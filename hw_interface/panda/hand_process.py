"""A gripper in a process of its own, as the supervisor sees it: its library may block or hang, the supervisor never."""

import mmap
import os
import signal
import subprocess
from collections.abc import Callable, Sequence
from multiprocessing.connection import Pipe
from typing import ClassVar, Literal

import numpy as np

from control.errors import MachineError, StackError
from control.trajectory.samples import GripperCommand
from hw_interface.errors import MessageError
from hw_interface.messages.robot import Refusal
from hw_interface.messages.wire import Message
from hw_interface.own_time import OwnTime
from hw_interface.panda.hand import Hand, HandReading
from hw_interface.panda.link import Link

CONNECT_TIMEOUT = 15.0  # [s]
TURN = 0.005  # [s]
_STATE = np.dtype([("alive", "<u8"), ("done", "<u8"), ("width", "<f8"), ("grasped", "<u8")])


class HandReady(Message):
    """The gripper answered."""

    type_name: ClassVar[str] = "hand_ready"


class HandOrder(Message):
    """A gripper command and its ordinal number, from 1."""

    type_name: ClassVar[str] = "hand_order"
    number: int
    kind: Literal["move", "grasp"]
    width: float
    force: float


class HandFault(Message):
    """What is wrong with the gripper."""

    type_name: ClassVar[str] = "hand_fault"
    reason: str


KINDS = (HandReady, HandOrder, HandFault, Refusal)


class HandProcess:
    """The supervisor's side: a `Hand`, which is being connected to at first.

    Args:
        command: Program and arguments of the process; `--link-fd N --board-fd N` are added.
    """

    def __init__(self, command: Sequence[str]) -> None:
        self._command = tuple(command)
        self._start()

    def await_ready(self) -> None:
        """Wait until the gripper has answered.

        Raises:
            MachineError: It does not.
        """
        while not self._ready and self._fault is None:
            self._hear(0.1)
        if self._fault is not None:
            raise MachineError(f"the gripper is not ready: {self._fault}")

    def _start(self) -> None:
        ours, theirs = Pipe()
        self._descriptor = os.memfd_create("replan-hand", os.MFD_CLOEXEC)
        os.ftruncate(self._descriptor, _STATE.itemsize)
        self._state = np.frombuffer(mmap.mmap(self._descriptor, _STATE.itemsize), _STATE, 1)
        self._link = Link(ours, KINDS)
        self._number, self._fault = 0, None
        arguments = ["--link-fd", str(theirs.fileno()), "--board-fd", str(self._descriptor)]
        self._process = subprocess.Popen(
            [*self._command, *arguments],
            stdin=subprocess.DEVNULL,
            pass_fds=(theirs.fileno(), self._descriptor),
            start_new_session=True,
        )
        theirs.close()
        self.pid = self._process.pid
        self._ready, self._turns, self._silent = False, 0, OwnTime()

    def _hear(self, wait: float) -> None:
        """Take in what the process says, waiting up to `wait` seconds for it."""
        try:
            message = self._link.receive(wait)
        except (EOFError, OSError):
            self._fault = self._fault or "the gripper's process has ended"
            return
        except MessageError as error:
            self._fault = str(error)
            return
        if isinstance(message, HandReady):
            self._ready = True
            self._silent.restart()
        elif isinstance(message, HandFault | Refusal):
            self._fault = message.reason
        elif not self._ready and self._silent.look() > CONNECT_TIMEOUT:
            self._fault = f"the gripper does not answer within {CONNECT_TIMEOUT:g} s"

    def read(self) -> HandReading:
        """How it stands, as known now."""
        state = self._state
        busy = int(state["done"][0]) < self._number
        if self._fault is None:
            self._hear(0.0)
        fault = self._fault or self._new_fault()
        connecting = self._fault is None and not self._ready
        grasped = bool(state["grasped"][0]) and not busy
        return HandReading(float(state["width"][0]), busy, grasped, fault, connecting, self._silence())

    def begin(self, command: GripperCommand) -> None:
        """Begin a command."""
        self._number += 1
        order = HandOrder(
            number=self._number, kind=command.kind, width=float(command.width), force=float(command.force)
        )
        try:
            self._link.send(order)
        except OSError:
            self._fault = "the gripper's process has ended"

    def restart(self) -> None:
        """End the process and start it again; until it is connected, `read` tells of a fault."""
        self.close()
        self._start()

    def close(self) -> None:
        """End the process."""
        self._link.close()
        try:
            self._process.wait(1.0)
        except subprocess.TimeoutExpired:
            os.kill(self.pid, signal.SIGKILL)
            self._process.wait()
        os.close(self._descriptor)

    def _new_fault(self) -> str | None:
        if not self._ready:
            return "the gripper is being connected to"
        if self._process.poll() is not None:
            self._fault = "the gripper's process has ended"
        return self._fault

    def _silence(self) -> float:
        """For how long in [s] the process's loop has not turned: it, or the gripper, hangs or stalls."""
        turns = int(self._state["alive"][0])
        if turns != self._turns:
            self._turns = turns
            self._silent.restart()
        return self._silent.look() if self._ready else 0.0


def serve_hand(connect: Callable[[], Hand], link: Link, descriptor: int, gone: Callable[[], bool]) -> int:
    """The process's side: connect, then carry out what is ordered until the supervisor is gone; returns an exit code.

    Args:
        connect: Connects to the gripper. Raises MachineError when it does not answer.
        link, descriptor: Pipe and memory, both inherited.
        gone: Whether the supervisor's process is gone.
    """
    state = np.frombuffer(mmap.mmap(descriptor, _STATE.itemsize), _STATE, 1)
    try:
        hand = connect()
    except StackError as error:
        link.send(Refusal(code="not_ready", reason=str(error)[:2000]))
        return 1
    number, told = 0, False

    def look() -> HandReading:
        reading = hand.read()
        state["width"], state["grasped"] = reading.width, reading.grasped
        if not reading.busy:
            state["done"] = number
        state["alive"] += np.uint64(1)
        return reading

    look()
    link.send(HandReady())
    while not gone():
        try:
            order = link.receive(TURN)
            if isinstance(order, HandOrder):
                hand.begin(GripperCommand(order.kind, order.width, order.force))
                number = order.number
            fault = look().fault
            if fault is not None and not told:
                told = True
                link.send(HandFault(reason=fault[:2000]))
        except (EOFError, OSError):
            break
    hand.close()
    return 0
