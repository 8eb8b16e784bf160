"""Starting the simulated control box as a child process, and speaking to its administrative channel."""

import json
import random
import socket
from collections.abc import Sequence
from types import TracebackType

from control.errors import ConfigError, MachineError, RobotGoneError
from hw_interface.cell.process import SimProcess, start_sim_process
from hw_interface.fci_simulator.layout import GRIPPER_PORT, PORT

ANSWER_TIME = 5.0  # [s]
TRIES = 50


class FaultChannel:
    """The client's side of `control_channel`.

    Args:
        port: Of a simulated control box on this machine.

    Raises:
        RobotGoneError: Nobody listens there.
    """

    def __init__(self, port: int) -> None:
        try:
            self._socket = socket.create_connection(("127.0.0.1", port), ANSWER_TIME)
        except OSError as error:
            raise RobotGoneError(f"no simulated control box takes faults at port {port}: {error}") from error
        self._file = self._socket.makefile("rb")

    def send(self, line: str) -> dict[str, object]:
        """Have one line of `faults` carried out; returns what the box is like then.

        Raises:
            ConfigError: The line is not valid.
            RobotGoneError: No answer.
        """
        try:
            self._socket.sendall(line.encode() + b"\n")
            answer = json.loads(self._file.readline() or b"null")
        except OSError as error:
            raise RobotGoneError(f"the simulated control box did not answer '{line}': {error}") from error
        if answer is None:
            raise RobotGoneError(f"the simulated control box ended instead of answering '{line}'")
        if not answer["ok"]:
            raise ConfigError(str(answer["error"]))
        return answer

    def close(self) -> None:
        """Leave."""
        self._file.close()
        self._socket.close()


class ControlBoxProcess:
    """A running simulated control box.

    Attributes:
        address: What to give to libfranka.
        faults: Its administrative channel.
        process: The process.
    """

    def __init__(self, process: SimProcess) -> None:
        self.process = process
        self.address = process.endpoint
        self.faults = FaultChannel(int(str(process.ready["control_port"])))

    def __enter__(self) -> "ControlBoxProcess":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the process."""
        self.faults.close()
        self.process.close()


def start_control_box(command: Sequence[str], deadline: float = 60.0) -> ControlBoxProcess:
    """Start a simulated control box and wait until it is ready.

    Args:
        command: Program and arguments, for instance `python -m replan.main robot research-interface --pace lockstep
            --address 127.0.0.5`; `--control-port 0` and the parent's id are added.
        deadline: Longest wait in [s].

    Raises:
        MachineError: The program cannot be started, or ended before it was ready.
        RobotGoneError: It was not ready in time.
    """
    process = start_sim_process([*command, "--control-port", "0"], deadline)
    try:
        return ControlBoxProcess(process)
    except BaseException:
        process.close()
        raise


def free_address(rng: random.Random) -> str:
    """An address of this machine, other than 127.0.0.1, at which a simulated control box could listen now.

    The ports of the protocol are fixed, so that boxes side by side need an address each (Linux: all of 127.0.0.0/8).

    Raises:
        MachineError: None was found.
    """
    for _ in range(TRIES):
        address = f"127.{rng.randrange(1, 255)}.{rng.randrange(256)}.{rng.randrange(1, 255)}"
        try:
            for port in (PORT, GRIPPER_PORT):
                socket.create_server((address, port)).close()
        except OSError:
            continue
        return address
    raise MachineError("no free address in 127.0.0.0/8 for a simulated control box; this needs Linux")
