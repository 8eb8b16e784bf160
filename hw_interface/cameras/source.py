"""What a source of pictures is: read one after the other, close. Devices, recordings and tests are sources."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from perception.frames import RgbdFrame

NO_POSE = np.eye(4)  # devices do not know where they stand


class CameraFailedError(Exception):
    """A source gives no more pictures: its device was unplugged, hangs or reports a fault."""


class SourceEndedError(CameraFailedError):
    """A source has come to its end as it was asked to: the last picture of a recording."""


@dataclass(frozen=True)
class Shot:
    """One picture as a source gives it.

    Attributes:
        frame: The picture; its stamp is on this computer's wall clock.
        number: The device's number of it, which skips those that did not come; None where it has none.
    """

    frame: RgbdFrame
    number: int | None = None


class CameraSource(Protocol):
    """A device or a recording.

    Attributes:
        description: What it is, for people.
        placed: Whether its frames say where the camera stood (recordings); else the cell file does.
    """

    description: str
    placed: bool

    def read(self) -> Shot:
        """The next picture; waits for it.

        Raises:
            CameraFailedError: There is none.
        """
        ...

    def close(self) -> None:
        """Give the device back."""
        ...
