"""What stands in the registers of a Robotiq 2F-85, and the widths, speeds and forces that its bytes mean.

Three registers of two bytes each are written at 1000 and read at 2000, the first byte in the upper half:

    written   action request (rACT bit 0, rGTO bit 3) | 0        0 | position rPR      speed rSP | force rFR
    read      status (gACT 0, gGTO 3, gSTA 4-5, gOBJ 6-7) | 0    fault gFLT | echo gPR   position gPO | current gCU

Source: Robotiq, 2F-85 & 2F-140 instruction manual, "Control": register mapping, Modbus RTU communication.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from control.robot.gripper import ROBOTIQ_2F85

OUTPUT, INPUT = 1000, 2000  # first registers that are written and read
COUNT = 3
DEVICE = 9  # on the line
BAUD_RATE = 115_200

ACTIVATE, GO = 1 << 0, 1 << 3
ACTIVATED = 3  # gSTA
MOVING, CONTACT_OPENING, CONTACT_CLOSING, ARRIVED = 0, 1, 2, 3  # gOBJ

OPEN, CLOSED = 3, 230  # bytes at which its pads stand still when open and closed without an object; each unit differs
SLOWEST, FASTEST = 0.020, 0.150  # [m/s] between the pads at speed bytes 0 and 255

# Those that a person has to see to; "priority" ones pass once it is activated.
FAULTS = {
    0x05: "an action was asked for before its activation was complete",
    0x07: "an action was asked for without activation",
    0x08: "it is too hot; let it cool down",
    0x09: "it does not communicate (it may be starting)",
    0x0A: "its supply is below 21.6 V",
    0x0B: "it releases automatically",
    0x0C: "an internal fault; switch it off and on",
    0x0D: "its activation failed; see that nothing is between its fingers, then activate it again",
    0x0E: "its motor draws too much current",
    0x0F: "it has released automatically; acknowledge to activate it again",
}


@dataclass(frozen=True)
class Status:
    """What a gripper says, as its bytes.

    Attributes:
        activation: gSTA; 3 is activated.
        going: gGTO, whether it goes to positions.
        contact: gOBJ; see the constants above.
        fault: gFLT; 0 is none.
        wanted: gPR, the position that it was asked for, 0 open to 255 closed.
        position: gPO, where its fingers are.
    """

    activation: int
    going: bool
    contact: int
    fault: int
    wanted: int
    position: int

    @classmethod
    def of(cls, registers: Sequence[int]) -> "Status":
        """From the three registers."""
        first, second, third = registers
        status = first >> 8
        return cls((status >> 4) & 3, bool(status & GO), status >> 6, (second >> 8) & 0x0F, second & 0xFF, third >> 8)


@dataclass(frozen=True)
class Calibration:
    """Bytes of one gripper at its ends; between them the width is linear.

    Attributes:
        opened, closed: Positions when open and when closed without an object.
        opening: Distance between the pads when open in [m].
    """

    opened: int = OPEN
    closed: int = CLOSED
    opening: float = ROBOTIQ_2F85.opening

    def width(self, position: int) -> float:
        """Distance between the pads in [m]."""
        share = (self.closed - position) / (self.closed - self.opened)
        return min(max(share, 0.0), 1.0) * self.opening

    def position(self, width: float) -> int:
        """Byte for a distance between the pads in [m]; beyond its ends, that end."""
        share = min(max(width / self.opening, 0.0), 1.0)
        return round(self.closed - share * (self.closed - self.opened))


def speed_byte(speed: float) -> int:
    """Byte for a speed in [m/s] between the pads."""
    return _byte((speed - SLOWEST) / (FASTEST - SLOWEST))


def force_byte(force: float) -> int:
    """Byte for a force in [N]."""
    least, most = ROBOTIQ_2F85.least_force, ROBOTIQ_2F85.most_force
    return _byte((force - least) / (most - least))


def request(position: int, speed: int, force: int, action: int = ACTIVATE | GO) -> list[int]:
    """The three registers of a request; all arguments are bytes."""
    return [action << 8, position, (speed << 8) | force]


def _byte(share: float) -> int:
    return round(min(max(share, 0.0), 1.0) * 255)
