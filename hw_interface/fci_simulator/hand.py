"""The gripper's own service: research interface of the gripper, version 3, without sockets.

One command at a time; it is answered when it is over. A Stop ends it, and so does the next command (libfranka,
`gripper.h`). Widths are distances between the pads, speeds those of that distance.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from control.robot.gripper import GripperModel
from control.trajectory.samples import GripperCommand
from hw_interface.fci_simulator.layout import (
    GRIPPER_STATE,
    GripperCommandId,
    HandStatus,
    gripper_response,
)
from hw_interface.simulated.sim_backend import SimBackend

STATE_MS = 20  # [ms] of robot time between two states
TEMPERATURE = 30  # [degrees C]
WIDTH_TOLERANCE = 2e-3  # [m] by which a finished move may miss its width


@dataclass(frozen=True)
class Task:
    """A command under way.

    Attributes:
        command, command_id: What it was asked with.
        step: "move", "grasp", or the two halves of a homing.
        width: Wanted distance between the pads in [m].
        inner, outer: How much narrower or wider than `width` a grasped thing may be, in [m].
    """

    command: GripperCommandId
    command_id: int
    step: Literal["move", "grasp", "close", "open"]
    width: float
    inner: float = 0.0
    outer: float = 0.0


class SimulatedHand:
    """The state machine of one gripper.

    Args:
        backend: The simulated gripper.
        gripper: What it is.
        say: Called with one line for every command.

    Attributes:
        outbox: Answers for the client, oldest first; the caller empties it.
    """

    def __init__(self, backend: SimBackend, gripper: GripperModel, say: Callable[[str], None]) -> None:
        self._backend, self._gripper, self._say = backend, gripper, say
        self._task: Task | None = None
        self._grasped_well = False
        self._message_id = 0
        self._measured = backend.read()
        self.outbox: list[bytes] = []

    def request(self, command: GripperCommandId, command_id: int, body: bytes) -> None:
        """Begin a command; `body` has the length that the protocol gives it."""
        self._say(f"gripper: {command.name.lower()}")
        if self._task is not None:
            self._end(HandStatus.ABORTED)
        if command is GripperCommandId.STOP:
            self._backend.stop_gripper()
            self._answer(command, command_id, HandStatus.SUCCESS)
        elif command is GripperCommandId.HOMING:
            self._begin(Task(command, command_id, "close", 0.0), GripperCommand("move", 0.0), None)
        elif command is GripperCommandId.MOVE:
            width, speed = struct.unpack("<2d", body)
            if not (0.0 <= width <= self._gripper.opening and 0.0 < speed < float("inf")):
                self._answer(command, command_id, HandStatus.FAIL)
                return
            self._begin(Task(command, command_id, "move", width), GripperCommand("move", width), speed / 2)
        else:
            width, inner, outer, speed, force = struct.unpack("<5d", body)
            valid = 0.0 <= width <= self._gripper.opening and min(inner, outer) >= 0.0 and speed > 0.0
            if not (valid and 0.0 < force <= self._gripper.most_force):
                self._answer(command, command_id, HandStatus.FAIL)
                return
            task = Task(command, command_id, "grasp", width, inner, outer)
            self._begin(task, GripperCommand("grasp", width, force), speed / 2)

    def client_gone(self) -> None:
        """The client has left: what is under way goes on, nobody is told of its end."""
        self._task = None
        self.outbox.clear()

    def tick(self, milliseconds: int) -> bytes | None:
        """Look at the gripper; returns a state to send, or None.

        Args:
            milliseconds: Robot time.
        """
        due = milliseconds // STATE_MS
        if due == self._message_id:
            return None
        self._message_id = due
        self._measured = self._backend.read()
        if self._task is not None and not self._measured.gripper_busy:
            self._step_done(self._task)
        return self.state()

    def state(self) -> bytes:
        """The present state as it goes over the wire."""
        grasped = self._grasped_well and self._measured.grasped
        width = max(0.0, self._measured.gripper_width)
        return GRIPPER_STATE.pack(self._message_id, width, self._gripper.opening, grasped, TEMPERATURE)

    def _begin(self, task: Task, command: GripperCommand, finger_speed: float | None) -> None:
        self._task, self._grasped_well = task, False
        self._backend.gripper(command, finger_speed)

    def _step_done(self, task: Task) -> None:
        width = self._measured.gripper_width
        if task.step == "close":
            opening = self._gripper.opening
            self._begin(Task(task.command, task.command_id, "open", opening), GripperCommand("move", opening), None)
        elif task.step == "grasp":
            fits = task.width - task.inner < width < task.width + task.outer
            self._grasped_well = self._measured.grasped and fits
            self._end(HandStatus.SUCCESS if self._grasped_well else HandStatus.UNSUCCESSFUL)
        else:
            arrived = abs(width - task.width) <= WIDTH_TOLERANCE
            self._end(HandStatus.SUCCESS if arrived else HandStatus.UNSUCCESSFUL)

    def _end(self, status: HandStatus) -> None:
        assert self._task is not None
        self._answer(self._task.command, self._task.command_id, status)
        self._task = None

    def _answer(self, command: GripperCommandId, command_id: int, status: HandStatus) -> None:
        self.outbox.append(gripper_response(command, command_id, status))
