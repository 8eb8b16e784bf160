"""Errors that only the messages have; everything else raises from `control.errors`.

control.errors.StackError
├── MessageError           bytes that are not a message of this protocol; nothing was done with them
└── CameraGoneError        a camera process died, froze or never answered; the robot did what it did
"""

from control.errors import StackError


class MessageError(StackError):
    """Bytes that are not a valid message.

    Attributes:
        field: Dotted path of the field at fault, or "message" when the whole is unreadable.
    """

    def __init__(self, field: str, reason: str) -> None:
        super().__init__(f"message field '{field}': {reason}")
        self.field = field


class CameraGoneError(StackError):
    """The process that has a camera died, froze or never answered."""
