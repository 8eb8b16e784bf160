"""The simulated control box as a process: one loop that owns the world, its sockets and its pace.

Paces:

    real-time   A millisecond of the wall clock is one of the robot, and a command that is not there by then is lost.
                A loop that is late itself lets robot time stand still instead of blaming the client.
    lockstep    While a client commands a motion, the robot advances by exactly one millisecond for each command,
                however long that takes; nothing is lost because a machine is busy. At rest it keeps wall time. A
                client that sends nothing for `SILENCE` seconds of wall time has failed to communicate.

libfranka counts time by the ids of the states that it has seen. In lockstep, states that were sent before a motion's
first command may still be under way when it comes; each of them is answered by a command as well. So a command that
answers an older state than the last one takes over the millisecond that was counted ahead, and commands that are
missing between two answered states are lost ones.
"""

import json
import os
import selectors
import sys
import time
import uuid
from collections.abc import Callable
from typing import Any, Literal, Protocol

import numpy as np

from control.robot.gripper import PANDA_HAND, GripperModel
from control.robot.limits import RobotLimits
from control.trajectory.samples import SAMPLE_TIME
from hw_interface.cell.pacing import Leash
from hw_interface.fci_simulator.clients import Service
from hw_interface.fci_simulator.control_box import CommandedMotion, ControlBox
from hw_interface.fci_simulator.control_channel import ControlChannel
from hw_interface.fci_simulator.faults import FaultCommands, Faults
from hw_interface.fci_simulator.hand import SimulatedHand
from hw_interface.fci_simulator.layout import (
    COMMAND,
    GRIPPER_HEADER,
    GRIPPER_PORT,
    GRIPPER_REQUEST_BYTES,
    GRIPPER_VERSION,
    HEADER,
    PORT,
    REQUEST_BYTES,
    VERSION,
    Command,
    Error,
    GripperCommandId,
    LibraryStatus,
    response,
)
from hw_interface.fci_simulator.plant import Plant

Pace = Literal["real-time", "lockstep"]

SILENCE = 2.0  # [s] of wall time without a command after which a motion in lockstep is a failure of communication
FIRST_COMMAND = 2.0  # [s] in which a motion's first command must come, at any pace
# [s] of wall time between states before a motion's first command, in lockstep: libfranka looks at two of them before it
# commands; the long pause keeps further ones from being under way.
SOON, AHEAD = 0.002, 0.05
# [s] of wall time without a command after which the last state is sent again, in lockstep: a datagram may get lost, and
# then both sides would wait for each other. A client that has seen it takes no notice.
AGAIN = 0.2
IDLE_BURST = 5  # milliseconds of robot time between two states at rest, in lockstep
LONELY_BURST = 20  # likewise without a client, at any pace
MOST_LATE = 0.005  # [s] of wall time that are caught up after a delay
ANSWER_SHARE = 0.9  # of a millisecond of wall time that a client has at least to answer a state, in real time
STALLED = 0.5  # [s] of wall time in one turn of the loop that is worth a line
LONGEST_LOOK = 0.02  # [s] of waiting for anything, so that the leash and the administrative channel are looked at


class BoxWorld(Protocol):
    """What stands in the simulated cell; the robot carries the names of `control.twin_model`."""

    model: Any
    data: Any


class ResearchInterface:
    """The simulated control box with its sockets. `serve` runs it; `leash.end()` ends it from any thread.

    Args:
        world: The world; this object steps it, nobody else may.
        limits: What commands are checked against.
        gripper: What the robot carries.
        address: Where to listen, for instance 127.0.0.1; the ports are those of the protocol.
        pace: How robot time passes.
        control_port: Port of the administrative channel, 0 for a free one; None for none.
        with_hand: Whether the gripper is Franka's own hand, whose service the box offers; others have their own wire.
        say: Called with one line for every event that a person would want to read.
        leash: To end the loop from elsewhere.

    Attributes:
        box, hand: State machines.
        arm_model: Pinocchio model of the arm without its hand.
        library: Bytes of the model library that clients may load; None where it could not be built.
        leash: Ends the loop.
        between: Called between ticks on the loop's thread, while the world stands still: the place for answers that
            look at it; None for nothing.
        control_port: Where the administrative channel listens, or None.

    Raises:
        MachineError: A port is taken or the address is not one of this machine.
        ConfigError: The world's model is not that of a Panda.
    """

    def __init__(
        self,
        world: BoxWorld,
        limits: RobotLimits,
        *,
        gripper: GripperModel = PANDA_HAND,
        address: str = "127.0.0.1",
        pace: Pace = "real-time",
        control_port: int | None = None,
        with_hand: bool = True,
        say: Callable[[str], None] = lambda _line: None,
        leash: Leash | None = None,
    ) -> None:
        self.address, self._pace, self._say = address, pace, say
        self.between: Callable[[], None] | None = None
        self.library: bytes | None = None
        self.leash = leash or Leash()
        plant = Plant(world.model, world.data, gripper)
        self.arm_model = plant.arm.model
        self.box = ControlBox(plant, limits, say)
        self.hand = SimulatedHand(plant.backend, gripper, say)
        self._faults = Faults()
        self._commands: list[np.void] = []
        self._motion: CommandedMotion | None = None  # whose beginning has been seen
        self._answered = 0  # id of the last state that a command answered
        self._heard = 0.0  # wall time of the last command, or of the motion's beginning
        self._next_ahead, self._sent_ahead, self._next_again = 0.0, 0, 0.0
        self._selector = selectors.SelectSelector()  # epoll rounds waits up to whole milliseconds
        self._robot: Service | None = None
        self._gripper: Service | None = None
        self._channel: ControlChannel | None = None
        try:
            self._robot = Service(
                address, PORT, self._selector, HEADER, self._request, REQUEST_BYTES, VERSION, "robot", say
            )
            self._gripper = Service(
                address,
                GRIPPER_PORT,
                self._selector,
                GRIPPER_HEADER,
                self._gripper_request,
                GRIPPER_REQUEST_BYTES,
                GRIPPER_VERSION,
                "gripper",
                say,
            )
            if not with_hand:
                self._gripper.refuse()
            self._robot.on_leave = self.box.client_gone
            self._gripper.on_leave = self.hand.client_gone
            if control_port is not None:
                commands = FaultCommands(self.box, self._robot, self._gripper, self._faults)
                self._channel = ControlChannel(control_port, commands.carry_out)
        except BaseException:
            self.close()
            raise

    @property
    def control_port(self) -> int | None:
        """Port of the administrative channel, or None."""
        return None if self._channel is None else self._channel.port

    def _announce(self) -> None:
        line = {
            "ready": True,
            "endpoint": self.address,
            "pid": os.getpid(),
            "epoch": uuid.uuid4().hex,
            "pace": self._pace,
            "control_port": self.control_port,
        }
        print(json.dumps(line), file=sys.stdout, flush=True)

    def serve(self) -> None:
        """Print the line that tells a parent process that the box is ready, and run until the leash ends it.

        It leaves the network afterwards.
        """
        try:
            with self.leash.signals():
                self._announce()  # whoever has read it may end this at once
                self._loop()
        finally:
            self.close()

    def close(self) -> None:
        """Leave the network."""
        for part in (self._robot, self._gripper, self._channel):
            if part is not None:
                part.close()
        self._robot = self._gripper = self._channel = None

    # the loop

    def _loop(self) -> None:
        assert self._robot is not None
        if self._pace == "lockstep":  # in real time the loop looks for commands itself, once a millisecond
            self._selector.register(self._robot.datagrams, selectors.EVENT_READ, self._receive)
        due = time.monotonic()
        mark = time.monotonic()
        while not self.leash.ended():
            mark, before = time.monotonic(), mark
            if mark - before > STALLED and not self._faults.frozen:
                self._say(f"this process stood still for {mark - before:.1f} s; a client may have given up meanwhile")
            if self._channel is not None:
                self._channel.poll(LONGEST_LOOK if self._faults.frozen else 0.0)
            if self._faults.frozen:
                due = time.monotonic()
                continue
            if self.between is not None:
                begun = time.monotonic()
                self.between()
                due += time.monotonic() - begun  # robot time stands still while a picture is taken
            if self._motion is not self.box.motion:
                self._begin(self.box.motion)
            if self._pace == "lockstep" and self._motion is not None and self._motion.stop_id is None:
                self._in_lockstep(self._motion)
                due = time.monotonic()
                continue
            now = time.monotonic()
            if now < due:
                self._look(min(due - now, LONGEST_LOOK))
                continue
            # In a motion every state leaves the client its time to answer, however late this loop is.
            earliest = now + ANSWER_SHARE * SAMPLE_TIME if self._motion is not None else now - MOST_LATE
            due = max(due + self._burst(), earliest)
            self._look(0.0)

    def _begin(self, motion: CommandedMotion | None) -> None:
        """Note that a motion has begun (or ended)."""
        if motion is None:
            self._faults.drop = 0
        self._motion = motion
        self._heard = self._next_ahead = time.monotonic()
        self._sent_ahead = 0
        self._answered = self.box.milliseconds
        self._commands.clear()

    def _burst(self) -> float:
        """Advance at the pace of the wall clock; returns how much in [s]."""
        assert self._robot is not None
        motion = self._motion
        self._receive()
        # A command that answers an older state comes too late: what it says belongs to a millisecond that is over.
        command = next((c for c in self._commands if c["message_id"] == self.box.milliseconds), None)
        self._commands.clear()
        if motion is not None:
            if command is not None and self._lost():
                command = None
            if not motion.started and time.monotonic() - self._heard > FIRST_COMMAND:
                self.box.reflex(Error.COMMUNICATION)
            self._tick(command)
            self._publish()
            return SAMPLE_TIME
        milliseconds = 1 if self._pace == "real-time" else IDLE_BURST
        if not self._robot.connected:
            milliseconds = LONELY_BURST
        for left in reversed(range(milliseconds)):
            self._tick(None, shown=left == 0)
        self._publish()
        return milliseconds * SAMPLE_TIME

    def _in_lockstep(self, motion: CommandedMotion) -> None:
        """Advance by the commands that have come, or wait for one."""
        if not self._commands:
            now = time.monotonic()
            if not motion.started and now >= self._next_ahead:
                self._sent_ahead += 1
                self._next_ahead = now + (SOON if self._sent_ahead == 1 else AHEAD)
                self._tick(None)
                self._publish()
            elif motion.started and now >= self._next_again:
                self._publish()
            self._look(LONGEST_LOOK if motion.started else min(LONGEST_LOOK, max(0.0, self._next_ahead - now)))
        if not self._commands:
            allowed = SILENCE if motion.started else FIRST_COMMAND
            if self.box.motion is motion and time.monotonic() - self._heard > allowed:
                self.box.reflex(Error.COMMUNICATION)
                self._flush()
            return
        self._heard = time.monotonic()
        commands, self._commands = self._commands, []
        for command in commands:
            if self.box.motion is motion and motion.stop_id is None:
                self._obey(motion, command)

    def _obey(self, motion: CommandedMotion, command: np.void) -> None:
        """Advance by one command in lockstep, and by those that are missing before it."""
        answers = int(command["message_id"])
        if answers <= self._answered:
            return  # left over from the motion before, or twice
        if motion.started:
            for _ in range(answers - self._answered - 1):
                self._tick(None, counts=False)
        self._answered = answers
        newest = answers >= self.box.milliseconds
        self._tick(None if self._lost() else command, counts=newest)
        if newest:
            self._publish()

    def _lost(self) -> bool:
        """Whether the command at hand is to be lost."""
        if self._faults.drop == 0:
            return False
        self._faults.drop -= 1
        return True

    def _tick(self, command: np.void | None, counts: bool = True, shown: bool = True) -> None:
        self.box.tick(command, counts, shown)
        hand_state = self.hand.tick(self.box.milliseconds)
        if hand_state is not None and self._gripper is not None and not self._gripper.silent:
            self._gripper.send_state(hand_state)
        self._flush()

    def _publish(self) -> None:
        self._next_again = time.monotonic() + AGAIN
        if self._robot is not None and not self._robot.silent:
            self._robot.send_state(self.box.state)

    def _flush(self) -> None:
        if self.box.outbox and self._robot is not None:
            self._robot.send(self.box.outbox)
        if self.hand.outbox and self._gripper is not None and not self._gripper.silent:
            self._gripper.send(self.hand.outbox)

    def _receive(self) -> None:
        assert self._robot is not None
        for data in self._robot.received(COMMAND.itemsize):
            self._commands.append(np.frombuffer(data, COMMAND)[0])

    def _look(self, wait: float) -> None:
        """Carry out what has come over the sockets, waiting up to `wait` seconds for something."""
        for key, _ in self._selector.select(wait):
            key.data()
        self._flush()

    # requests

    def _request(self, number: int, command_id: int, body: bytes) -> None:
        command = Command(number)
        match command:
            case Command.MOVE:
                self.box.move(command_id, body)
            case Command.STOP_MOVE:
                self.box.stop_move(command_id)
            case Command.AUTOMATIC_ERROR_RECOVERY:
                self.box.recover(command_id)
            case Command.LOAD_MODEL_LIBRARY:
                here = self.library is not None
                status = LibraryStatus.SUCCESS if here else LibraryStatus.ERROR
                self.box.outbox.append(response(command, command_id, status, self.library or b""))
            case _:
                self.box.configure(command, command_id, body)

    def _gripper_request(self, number: int, command_id: int, body: bytes) -> None:
        self.hand.request(GripperCommandId(number), command_id, body)
