"""The computers of machines.yaml played on this one: a network namespace each, joined by a switch, links over TLS.

    sudo .venv/bin/python examples/several-machines/play.py [--delay MS] [--loss PERCENT]

Needs root and Linux. Everything that it makes (namespaces, keys) is gone when it ends, however it ends; the folder with
run and recording stays and is named.
"""

import argparse
import os
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from control.errors import ConfigError, MachineError, StackError
from control.strict_yaml import read_mapping
from hw_interface.link.security import Role

ROOT = Path(__file__).resolve().parents[2]
MACHINES = Path(__file__).with_name("machines.yaml")
READY_TIMEOUT = 60.0  # [s]


class Command(BaseModel):
    """One command of one computer; see machines.yaml."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    role: Role
    ready: bool
    run: tuple[str, ...]


class Machine(BaseModel):
    """One computer."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    name: str
    address: str
    commands: tuple[Command, ...]


class Machines(BaseModel):
    """The whole file."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    router: str
    machines: tuple[Machine, ...]


def read_machines(path: Path) -> Machines:
    """The computers of a file.

    Raises:
        ConfigError: It cannot be read, or has unknown or missing keys.
    """
    try:
        return Machines.model_validate(read_mapping(path, "a file of machines", Machines.model_fields))
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        raise ConfigError(f"{path}: key '{'.'.join(map(str, first['loc']))}': {first['msg']}") from None


def ip(*arguments: str) -> None:
    """Run the program ip.

    Raises:
        MachineError: It failed; with its words.
    """
    done = subprocess.run(["ip", *arguments], capture_output=True, text=True)
    if done.returncode:
        raise MachineError(f"ip {' '.join(arguments)}: {done.stderr.strip()}; is this a Linux that lets root do it?")


class Network:
    """Network namespaces on one switch.

    The switch stands in a namespace of its own, so that nothing of this computer's own network changes.
    """

    def __init__(self, stack: ExitStack) -> None:
        self._prefix = f"replan-{os.getpid()}"
        self._stack = stack
        self._count = 0
        self._switch = self._namespace("switch")
        ip("-n", self._switch, "link", "add", "switch", "type", "bridge")
        ip("-n", self._switch, "link", "set", "switch", "up")

    def _namespace(self, name: str) -> str:
        space = f"{self._prefix}-{name}"
        ip("netns", "add", space)
        # The links go with their namespaces.
        self._stack.callback(subprocess.run, ["ip", "netns", "delete", space], capture_output=True)
        ip("-n", space, "link", "set", "lo", "up")
        return space

    def join(self, machine: Machine, delay: float, loss: float) -> str:
        """Put a computer on the switch; returns its namespace.

        Args:
            delay: Of everything that it sends in [ms].
            loss: Share of the packets that it sends that get lost, in percent.

        Raises:
            MachineError: This kernel cannot.
        """
        space = self._namespace(machine.name)
        port = f"port{self._count}"
        self._count += 1
        ip("-n", self._switch, "link", "add", port, "type", "veth", "peer", "name", "net", "netns", space)
        ip("-n", self._switch, "link", "set", port, "master", "switch", "up")
        ip("-n", space, "address", "add", f"{machine.address}/24", "dev", "net")
        ip("-n", space, "link", "set", "net", "up")
        if delay or loss:
            shape = ["netem", "delay", f"{delay:g}ms", "loss", f"{loss:g}%"]
            done = subprocess.run(
                ["tc", "-n", space, "qdisc", "add", "dev", "net", "root", *shape], capture_output=True, text=True
            )
            if done.returncode:
                raise MachineError(
                    f"this kernel cannot delay or lose packets ({done.stderr.strip()}); it lacks sch_netem: leave out "
                    "--delay and --loss"
                )
        return space


def say(text: str) -> None:
    """One line for people."""
    print(f"-- {text}", flush=True)


def await_line(process: "subprocess.Popen[bytes]", what: str) -> None:
    """Wait for the first line on stdout.

    Raises:
        MachineError: The process ended, or said nothing in time.
    """
    assert process.stdout is not None
    until = time.monotonic() + READY_TIMEOUT
    while (left := until - time.monotonic()) > 0.0:
        if select.select([process.stdout], [], [], left)[0]:
            if os.read(process.stdout.fileno(), 4096):
                return
            raise MachineError(f"{what} ended before it was ready; see its words above")
    raise MachineError(f"{what} was not ready within {READY_TIMEOUT:g} s")


def end(process: "subprocess.Popen[bytes]") -> None:
    """Ask a process to end, then make it."""
    process.terminate()
    try:
        process.wait(10.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def play(machines: Machines, delay: float, loss: float) -> int:
    """Run all commands; returns the exit code of the last one that failed, or 0.

    Raises:
        MachineError: No root, no namespaces, or a command that did not get ready.
    """
    if sys.platform != "linux" or os.geteuid() != 0:
        raise MachineError(
            "network namespaces need Linux and root; run: sudo .venv/bin/python examples/several-machines/play.py"
        )
    if shutil.which("ip") is None:
        raise MachineError("the program ip is not here; run: sudo apt-get install iproute2")
    results = Path(tempfile.mkdtemp(prefix="several-machines-"))
    program = [sys.executable, "-m", "replan.main"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    code = 0
    with ExitStack() as stack:
        keys = Path(stack.enter_context(tempfile.TemporaryDirectory())) / "keys"
        hosts = [part for machine in machines.machines for part in ("--host", machine.address)]
        subprocess.run([*program, "security", "init", str(keys), *hosts], check=True, env=environment)
        network = Network(stack)
        spaces = {machine.name: network.join(machine, delay, loss) for machine in machines.machines}
        for machine in machines.machines:
            values = {"router": machines.router, "address": machine.address, "folder": str(results)}
            for command in machine.commands:
                words = [word.format(**values) for word in command.run]
                say(f"{machine.name} ({machine.address}): replan {' '.join(words)} --link {command.role}.yaml")
                process = subprocess.Popen(
                    [
                        "ip",
                        "netns",
                        "exec",
                        spaces[machine.name],
                        *program,
                        *words,
                        "--link",
                        str(keys / f"{command.role}.yaml"),
                    ],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.PIPE if command.ready else None,
                    env=environment,
                    start_new_session=True,  # Ctrl-C reaches this script alone, which ends them in order
                )
                stack.callback(end, process)
                if command.ready:
                    await_line(process, f"replan {words[0]}")
                elif process.wait():
                    code = process.returncode
                    say(f"{machine.name}: exit code {code}")
        say("ending everything")
    say(f"run and recording are in {results}")
    return code


def main() -> int:
    """Parse, play, and turn errors into one line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--delay", type=float, default=0.0, help="of all that a computer sends, in milliseconds")
    parser.add_argument("--loss", type=float, default=0.0, help="of packets that a computer sends, in percent")
    options = parser.parse_args()
    # A plain kill unwinds like Ctrl-C, so that nothing stays behind.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        return play(read_machines(MACHINES), options.delay, options.loss)
    except StackError as error:
        print(f"play: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(main())
