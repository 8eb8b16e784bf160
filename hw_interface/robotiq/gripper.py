"""A Robotiq 2F-85 as a gripper that moves by itself; a thread of its own speaks Modbus, so that nobody waits for it."""

import threading
import time
from typing import Any

from control.errors import ConfigError, MachineError
from control.robot.gripper import ROBOTIQ_2F85
from control.trajectory.samples import GripperCommand
from hw_interface.own_time import OwnTime
from hw_interface.panda.hand import HandReading
from hw_interface.robotiq import registers
from hw_interface.robotiq.registers import Calibration, Status
from replan_base.parts import install_part

TIMEOUT = 0.2  # [s] for one answer
SILENT = 0.5  # [s] without an answer after which the gripper is taken to be gone
FIRST = 1.0  # [s] for the first answer on a line that was just opened
PERIOD = 0.02  # [s] between two looks; a round trip on the serial line takes some 5 ms
ACTIVATION = 10.0  # [s]; it opens and closes its fingers once
SPEED = 2 * ROBOTIQ_2F85.rated_speed  # [m/s] between the pads


class RobotiqHand:
    """One gripper; a `Hand`.

    Args:
        client: A pymodbus client, not connected yet.
        where: Its address, for messages.
        activate: Whether it may be activated when it is not: its fingers open and close once, and let go of whatever
            they held.
        calibration: Which bytes are open and closed.

    Raises:
        MachineError: It does not answer, or cannot be activated.
    """

    def __init__(self, client: Any, where: str, activate: bool, calibration: Calibration | None = None) -> None:
        self._client, self._may_activate = client, activate
        self._where = where
        self._calibration = calibration or Calibration()
        self._news = threading.Condition()
        self._status: Status | None = None
        self._request: list[int] | None = None  # to be written
        self._wanted: int | None = None  # position that was asked for and that its answers do not show yet
        self._fault: str | None = None
        self._closed = False
        self._start()
        with self._news:
            self._news.wait_for(lambda: self._status is not None or self._fault is not None)
            if self._fault is not None:
                raise MachineError(self._fault)

    def read(self) -> HandReading:
        """How it stands."""
        with self._news:
            status = self._status
            if status is None:
                return HandReading(0.0, False, False, self._fault, connecting=self._fault is None)
            busy = self._wanted is not None or (status.going and status.contact == registers.MOVING)
            held = not busy and status.contact == registers.CONTACT_CLOSING
            return HandReading(self._calibration.width(status.position), busy, held, self._fault)

    def begin(self, command: GripperCommand) -> None:
        """Begin a command: a move goes to a width, a grasp closes until its force is reached.

        Raises:
            MachineError: It has a fault.
        """
        with self._news:
            if self._fault is not None:
                raise MachineError(self._fault)
            # A grasp goes all the way: only then does it press, whatever the thing's true width is.
            position = 255 if command.kind == "grasp" else self._calibration.position(command.width)
            force = registers.force_byte(command.force if command.kind == "grasp" else ROBOTIQ_2F85.least_force)
            self._request = registers.request(position, registers.speed_byte(SPEED), force)
            self._wanted = position

    def restart(self) -> None:
        """Connect and activate anew after a fault; `read` says how it goes."""
        self.close()
        with self._news:
            self._status = self._request = self._wanted = self._fault = None
            self._closed = False
        self._start()

    def close(self) -> None:
        """Let go of the line; the fingers stay as they are."""
        self._closed = True
        self._thread.join()
        self._client.close()

    def _start(self) -> None:
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            if not self._client.connect():
                raise MachineError(f"no line to the gripper at {self._where}; see to its cable and its address")
            self._activate()
            silent = OwnTime(longest=TIMEOUT)
            while not self._closed:
                self._turn(silent)
                time.sleep(PERIOD)
        except MachineError as error:
            with self._news:
                self._fault = str(error)
                self._news.notify_all()

    def _turn(self, silent: OwnTime) -> None:
        """Write what was asked for and look.

        Args:
            silent: Since when it has not answered.

        Raises:
            MachineError: It has not answered for too long, or says that it has a fault.
        """
        with self._news:
            order = self._request
        status = None
        if order is None or self._write(order):
            with self._news:
                if self._request is order:  # else a newer one came meanwhile; one that was lost is written again
                    self._request = None
            status = self._look()
        if status is None:
            if silent.look() > SILENT - TIMEOUT:
                raise MachineError(
                    f"the gripper at {self._where} does not answer; see to its cable and its 24 V supply, then "
                    "acknowledge"
                )
            return
        silent.restart()
        if status.fault:
            why = registers.FAULTS.get(status.fault, f"fault {status.fault:#04x}")
            raise MachineError(f"the gripper at {self._where} has a fault: {why}")
        with self._news:
            if self._request is None and status.wanted == self._wanted:
                self._wanted = None  # it has taken the request in; from now on its own bits tell
            self._status = status
            self._news.notify_all()

    def _activate(self) -> None:
        until = time.monotonic() + FIRST
        while (status := self._look()) is None:
            if time.monotonic() > until:
                raise MachineError(
                    f"the gripper at {self._where} does not answer; see to its cable, its 24 V supply and its address "
                    f"on the line ({registers.DEVICE})"
                )
        if status.activation == registers.ACTIVATED and status.fault == 0:
            return
        if not self._may_activate:
            raise MachineError(
                f"the gripper at {self._where} is not activated, or has a fault; activation opens and closes its "
                "fingers once and lets go of what they hold: see that they are free, then start with --activate-gripper"
            )
        # Taken away and given again, which also ends a fault.
        self._write(registers.request(0, 0, 0, action=0))
        self._write(registers.request(0, 0, 0, action=registers.ACTIVATE))
        until = time.monotonic() + ACTIVATION
        while not self._closed:
            status = self._look()
            if status is not None and status.activation == registers.ACTIVATED:
                return
            if time.monotonic() > until:
                raise MachineError(
                    f"the gripper at {self._where} was not activated within {ACTIVATION:g} s; see that its fingers are "
                    "free to move"
                )
            time.sleep(PERIOD)

    def _look(self) -> Status | None:
        """What it says; None when it does not answer."""
        from pymodbus.exceptions import ModbusException

        try:
            answer = self._client.read_holding_registers(
                registers.INPUT, count=registers.COUNT, device_id=registers.DEVICE
            )
        except (ModbusException, OSError):
            return None
        return None if answer.isError() else Status.of(answer.registers)

    def _write(self, values: list[int]) -> bool:
        """Whether it took the registers."""
        from pymodbus.exceptions import ModbusException

        try:
            return not self._client.write_registers(registers.OUTPUT, values, device_id=registers.DEVICE).isError()
        except (ModbusException, OSError):
            return False


def connect_robotiq(where: str, activate: bool, calibration: Calibration | None = None) -> RobotiqHand:
    """The gripper at an address.

    Args:
        where: "rtu:/dev/ttyUSB0" for a serial line, "tcp:HOST" or "tcp:HOST:PORT" for a gateway (port 502).
        activate: As for `RobotiqHand`.
        calibration: Which bytes are open and closed; None takes the usual ones.

    Raises:
        ConfigError: Another form.
        MachineError: pymodbus is missing, the gripper does not answer, or cannot be activated.
    """
    kind, _, rest = where.partition(":")
    try:
        from pymodbus import FramerType
        from pymodbus.client import ModbusSerialClient, ModbusTcpClient
    except ImportError as error:
        raise MachineError(
            f"a Robotiq gripper needs the packages pymodbus and pyserial; run: {install_part('robotiq')}"
        ) from error
    if kind == "rtu" and rest:
        client: Any = ModbusSerialClient(
            rest, framer=FramerType.RTU, baudrate=registers.BAUD_RATE, timeout=TIMEOUT, retries=0
        )
    elif kind == "tcp" and rest:
        host, _, port = rest.partition(":")
        if port and not port.isdecimal():
            raise ConfigError(f"gripper address '{where}' is not valid; the port is a number, usually 502")
        client = ModbusTcpClient(host, port=int(port or 502), timeout=TIMEOUT, retries=0)
    else:
        raise ConfigError(
            f"gripper address '{where}' is not valid; write it as rtu:/dev/ttyUSB0 (serial line) or tcp:HOST:502 "
            "(gateway)"
        )
    return RobotiqHand(client, where, activate, calibration)
