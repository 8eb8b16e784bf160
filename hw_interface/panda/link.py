"""What a supervisor and its player say to each other besides clearances: messages over a pipe between two processes."""

from collections.abc import Sequence
from multiprocessing.connection import Connection
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from hw_interface.errors import MessageError
from hw_interface.messages.motions import TrajectoryRequest
from hw_interface.messages.robot import Refusal, Text
from hw_interface.messages.wire import MAX_MESSAGE_BYTES, Message, decode, encode, type_of

Mass = Annotated[float, Field(ge=0)]


class PlayerReady(Message):
    """The control box answered and is what the cell file says.

    Attributes:
        server_version: Version of the protocol that it speaks.
        end_effector_mass: What it takes the end effector to weigh, in [kg].
    """

    type_name: ClassVar[str] = "player_ready"
    server_version: int
    end_effector_mass: float


class LoadMotion(Message):
    """Asks the player to check a trajectory for itself and keep it; answered by MotionLoaded or Refusal.

    Attributes:
        motion: Ordinal number of the motion, from 1.
    """

    type_name: ClassVar[str] = "load_motion"
    motion: int


class MotionLoaded(Message):
    """The trajectory passed the player's own gate."""

    type_name: ClassVar[str] = "motion_loaded"
    motion: int


class BeginPart(Message):
    """Asks for a part of the loaded trajectory; its first clearance is on the board already.

    Attributes:
        motion, part: Which.
        first: Row of the playback that it begins with.
        begin: Progress along the certified samples at that row.
    """

    type_name: ClassVar[str] = "begin_part"
    motion: int
    part: int
    first: int
    begin: float


class PartEnded(Message):
    """What became of a part.

    Attributes:
        outcome: rested (every cleared row was commanded) or aborted (by the control box, or never begun).
        row: Row that was commanded last.
        code, reason: Why it was aborted; empty otherwise.
    """

    type_name: ClassVar[str] = "part_ended"
    motion: int
    part: int
    outcome: Literal["rested", "aborted"]
    row: int
    code: str
    reason: Text


class Recover(Message):
    """Asks the control box to leave its reflex, after a person acknowledged; answered by Recovered or Refusal."""

    type_name: ClassVar[str] = "recover"


class Recovered(Message):
    """The control box is ready for a motion."""

    type_name: ClassVar[str] = "recovered"


PLAYER_KINDS: Sequence[type[Message]] = (
    PlayerReady,
    LoadMotion,
    MotionLoaded,
    BeginPart,
    PartEnded,
    Recover,
    Recovered,
    Refusal,
    TrajectoryRequest,
)


class Link:
    """One end of the pipe. Whatever comes is decoded strictly, as on every other wire.

    Args:
        connection: The pipe's end.
        kinds: Messages that may come.
    """

    def __init__(self, connection: Connection, kinds: Sequence[type[Message]] = PLAYER_KINDS) -> None:
        self._connection = connection
        self._kinds = {kind.type_name: kind for kind in kinds}

    def send(self, message: Message) -> None:
        """Send a message.

        Raises:
            OSError: The other side is gone.
        """
        self._connection.send_bytes(encode(message))

    def receive(self, wait: float = 0.0) -> Message | None:
        """The next message, or None when none came within `wait` seconds.

        Raises:
            EOFError, OSError: The other side is gone.
            MessageError: Something that is no message of this pipe.
        """
        if not self._connection.poll(wait):
            return None
        data = self._connection.recv_bytes(MAX_MESSAGE_BYTES)
        kind = self._kinds.get(type_of(data))
        if kind is None:
            raise MessageError("type", f"is '{type_of(data)}'; on this pipe there are {sorted(self._kinds)}")
        return decode(data, kind)

    def close(self) -> None:
        """Close this end."""
        self._connection.close()
