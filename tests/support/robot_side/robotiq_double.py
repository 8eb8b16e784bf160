"""A simulated Robotiq 2F-85: a Modbus server that speaks its registers, with fingers that take their time."""

import asyncio
import os
import socket
import threading
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager

from pymodbus.server import ModbusSerialServer, ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

FULL_SPEED = 400.0  # bytes of position a second at the highest speed


class RobotiqDouble:
    """One gripper.

    Attributes:
        thing: Position at which closing fingers meet a thing; None without one.
        fault: What it says is wrong.
        silent: Whether it does not answer.
        activations: How often it was activated.
        requests: (position, speed, force) as asked for, without repetitions.
    """

    def __init__(self, activated: bool = False, thing: int | None = None) -> None:
        self.thing = thing
        self.fault = 0
        self.silent = False
        self.activations = 0
        self.activation_time = 0.2
        self.requests: list[tuple[int, int, int]] = []
        self._active = activated
        self._activated_at = time.monotonic() - 100.0 if activated else None
        self._going = False
        self._wanted = 3
        self._position = 3.0
        self._speed = 255
        self._at = time.monotonic()

    def write(self, registers: list[int]) -> None:
        """What a master wrote at 1000."""
        self._move()
        action, position = registers[0] >> 8, registers[1] & 0xFF
        speed, force = registers[2] >> 8, registers[2] & 0xFF
        if not action & 1:
            self._active, self._activated_at, self._going, self.fault = False, None, False, 0
            return
        if not self._active:
            self._active, self._activated_at = True, time.monotonic()
            self.activations += 1
        self._going = bool(action & 8)
        if self._going:
            self._wanted, self._speed = position, speed
            if not self.requests or self.requests[-1] != (position, speed, force):
                self.requests.append((position, speed, force))

    def status(self) -> list[int]:
        """What a master reads at 2000."""
        self._move()
        state = 0
        if self._activated_at is not None:
            state = 3 if time.monotonic() - self._activated_at > self.activation_time else 1
        first = int(self._active) | int(self._going) << 3 | state << 4 | self._contact() << 6
        return [first << 8, self.fault << 8 | self._wanted, round(self._position) << 8]

    def _contact(self) -> int:
        if not self._going:
            return 0
        if self.thing is not None and self._wanted > self.thing and self._position >= self.thing:
            return 2
        return 3 if abs(self._position - self._end()) < 0.5 else 0

    def _end(self) -> float:
        """Where its fingers stop without a thing: between 3 and 230, whatever it was asked for."""
        return min(max(self._wanted, 3), 230)

    def _move(self) -> None:
        now = time.monotonic()
        way = FULL_SPEED * (now - self._at) * (20 + 130 * self._speed / 255) / 150
        self._at = now
        if not self._going:
            return
        end = self._end()
        if self.thing is not None and end > self.thing >= self._position:
            end = self.thing
        self._position += min(max(end - self._position, -way), way)

    async def answer(self, code, start, address, count, current, new) -> None:
        """The server's hook on each access."""
        while self.silent:
            await asyncio.sleep(0.02)
        if new is not None and address == 1000:
            self.write(list(new))
        elif new is None and address == 2000:
            current[2000 - start : 2003 - start] = self.status()

    def device(self) -> SimDevice:
        """As pymodbus serves it; its address on the line is 9."""
        blocks = [SimData(first, values=[0] * 3, datatype=DataType.REGISTERS) for first in (1000, 2000)]
        return SimDevice(9, blocks, action=self.answer)


@contextmanager
def _serving(make) -> Iterator[None]:
    loop = asyncio.new_event_loop()
    ready = threading.Event()
    servers: list = []

    async def serve() -> None:
        server = make()
        servers.append(server)
        await server.serve_forever(background=True)
        ready.set()

    def run() -> None:
        asyncio.set_event_loop(loop)
        loop.run_until_complete(serve())
        loop.run_forever()

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    assert ready.wait(5.0)
    try:
        yield
    finally:
        asyncio.run_coroutine_threadsafe(servers[0].shutdown(), loop).result(5.0)
        loop.call_soon_threadsafe(loop.stop)
        thread.join(5.0)


@contextmanager
def on_tcp(gripper: RobotiqDouble) -> Iterator[str]:
    """The gripper behind a gateway; gives its address."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    with _serving(lambda: ModbusTcpServer(gripper.device(), address=("127.0.0.1", port))):
        yield f"tcp:127.0.0.1:{port}"


@contextmanager
def on_serial_line(gripper: RobotiqDouble) -> Iterator[str]:
    """The gripper on a serial line, which is two pseudo terminals back to back; gives its address."""
    near, near_end = os.openpty()
    far, far_end = os.openpty()
    for descriptor in (near_end, far_end):
        tty.setraw(descriptor)
    ended = threading.Event()

    def pass_on(source: int, target: int) -> None:
        while not ended.is_set():
            try:
                os.write(target, os.read(source, 256))
            except OSError:
                return

    threads = [threading.Thread(target=pass_on, args=pair, daemon=True) for pair in ((near, far), (far, near))]
    for thread in threads:
        thread.start()
    try:
        with _serving(lambda: ModbusSerialServer(gripper.device(), port=os.ttyname(far_end), baudrate=115_200)):
            yield f"rtu:{os.ttyname(near_end)}"
    finally:
        ended.set()
        for descriptor in (near_end, far_end):
            os.close(descriptor)
