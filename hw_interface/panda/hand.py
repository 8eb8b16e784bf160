"""What a supervisor needs of a gripper that moves by itself: begin a command, see how it stands."""

from dataclasses import dataclass
from typing import Protocol

from control.trajectory.samples import GripperCommand


@dataclass(frozen=True)
class HandReading:
    """How a gripper stands.

    Attributes:
        width: Distance between the pads in [m].
        busy: Whether a command is under way.
        grasped: Whether it holds something.
        fault: What is wrong with it, in words; None while all is well.
        silent: For how long in [s] of the supervisor's own time its process has said nothing; 0 while it answers.
        connecting: Whether it is being connected to, which is a fault until it is.
    """

    width: float
    busy: bool
    grasped: bool
    fault: str | None = None
    connecting: bool = False
    silent: float = 0.0


class Hand(Protocol):
    """A gripper that takes one command at a time."""

    def read(self) -> HandReading:
        """How it stands, as known now; never waits."""
        ...

    def begin(self, command: GripperCommand) -> None:
        """Begin a command; never waits. `read().busy` is true until it is over."""
        ...

    def restart(self) -> None:
        """Begin to connect anew after a fault, when a person acknowledged; never waits."""
        ...

    def close(self) -> None:
        """Let go of it."""
        ...
