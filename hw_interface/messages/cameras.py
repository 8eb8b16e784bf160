"""What camera processes say of themselves, and the time of the robot process. SI units."""

from typing import ClassVar

from hw_interface.messages.robot import Name, Text
from hw_interface.messages.wire import Message


class ClockRequest(Message):
    """Asks the robot process for the time."""

    type_name: ClassVar[str] = "clock_request"


class ClockReading(Message):
    """Answer to a ClockRequest.

    Attributes:
        stamp: The robot process's wall clock when it answered in [s].
    """

    type_name: ClassVar[str] = "clock_reading"
    stamp: float


class HealthRequest(Message):
    """Asks a camera process for its CameraHealth."""

    type_name: ClassVar[str] = "health_request"


class CameraHealth(Message):
    """How a camera does.

    Attributes:
        camera: Its name.
        owner: Who has it, as in its token.
        source: What delivers its pictures, for people.
        stamp: When this was said, on this camera process's wall clock in [s].
        frames: Pictures that came from the device.
        dropped: Pictures that the device took and that did not come.
        rate: Pictures a second over the last seconds.
        age: Of the newest picture in [s]; None before the first.
        max_age: How old a picture may be in [s].
        clock_offset: The robot's clock less this computer's in [s]; None where it is not measured.
        clock_uncertainty: By how much that may be wrong in [s].
        clock_jumps: How often one of the two clocks was set anew.
        trouble: Why there are no pictures; None where there are.
    """

    type_name: ClassVar[str] = "camera_health"
    camera: Name
    owner: Name
    source: Text
    stamp: float
    frames: int
    dropped: int
    rate: float
    age: float | None
    max_age: float
    clock_offset: float | None
    clock_uncertainty: float | None
    clock_jumps: int
    trouble: Text | None
