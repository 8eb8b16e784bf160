"""A real driver in front of the simulated control box: box, supervisor, player and gripper, each in its own process."""

import random
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from control.errors import RefusedError
from control.safety.certificate import Certificate
from control.trajectory.samples import Trajectory
from hw_interface.cell.client import CellClient
from hw_interface.cell.gate import Gate
from hw_interface.cell.process import SimProcess, start_sim_process
from hw_interface.fci_simulator.process import ControlBoxProcess, free_address, start_control_box
from hw_interface.fci_simulator.server import Pace
from replan.robot.gate import cell_gate
from replan_base.processes import python_module

CELL = "cubes"
PATIENCE = 0.5  # [s] of wall time that the lockstep box's clock may wait for a clearance


@dataclass(frozen=True)
class History:
    """What the box did, a row a millisecond.

    Robot time in [ms], mode, commanded and measured positions in [rad], and whether a client's command came (without
    one the box extrapolates or brakes by itself).
    """

    time: np.ndarray
    mode: np.ndarray
    q_d: np.ndarray
    q: np.ndarray
    told: np.ndarray


@dataclass(frozen=True)
class PandaSide:
    """A running robot side.

    Attributes:
        box: The simulated control box.
        supervisor: `replan robot panda`.
        audit_log: Where it writes.
    """

    box: ControlBoxProcess
    supervisor: SimProcess
    audit_log: Path

    @property
    def endpoint(self) -> str:
        """Where clients connect."""
        return self.supervisor.endpoint

    def child(self, module: str) -> int:
        """Process id of the supervisor's child that runs a module: panda_player or panda_hand."""
        pid = self.supervisor.pid
        for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
            if f"replan.robot.{module}" in Path(f"/proc/{child}/cmdline").read_text():
                return int(child)
        raise LookupError(module)

    def history(self, folder: Path) -> History:
        """What the box did in the last minute."""
        path = folder / f"{uuid.uuid4().hex}.npz"
        self.box.faults.send(f"history {path}")
        with np.load(path) as arrays:
            return History(arrays["time"], arrays["mode"], arrays["q_d"], arrays["q"], arrays["told"])


@contextmanager
def panda_side(
    folder: Path, pace: Pace = "lockstep", audit_log: Path | None = None, arm_alone: bool = False
) -> Iterator[PandaSide]:
    """A robot side of the built-in cell, until the end of the block.

    Args:
        folder: For its files.
        pace: Of the box.
        audit_log: Default: a new one in `folder`.
        arm_alone: Nothing but the arm stands in the box's world, whatever the cell says.
    """
    replan = python_module("replan.main", "robot")
    address = free_address(random.Random())
    box_command = [*replan, "research-interface", "--cell", CELL, "--address", address, "--pace", pace]
    if arm_alone:
        box_command = python_module("benchmarks.robot_side.research_interface", "--box", address, "--box-pace", pace)
    with start_control_box(box_command) as box:
        audit = audit_log or folder / f"audit_{uuid.uuid4().hex}.jsonl"
        command = [*replan, "panda", "--address", address, "--cell", CELL, "--endpoint", "tcp/127.0.0.1:0"]
        command += ["--realtime", "ignore"]
        command += ["--audit-log", str(audit), "--lockstep-patience", str(PATIENCE if pace == "lockstep" else 0.0)]
        with start_sim_process(command) as supervisor:
            yield PandaSide(box, supervisor, audit)


def gate() -> Gate:
    """The gate of that cell."""
    return cell_gate(CELL)[0]


def certified(trajectory: Trajectory, of: Gate) -> Certificate:
    """A certificate as a verdict would issue it."""
    now = time.time()
    return Certificate(
        serial=uuid.uuid4().hex,
        trajectory_hash=trajectory.content_hash(),
        profile=of.profile,
        firmware=of.firmware,
        scene_stamp=now,
        limits_hash=of.limits_hash,
        issued=now,
        expires=now + 60.0,
    )


def wait_for_progress(client: CellClient, samples: int, deadline: float = 20.0) -> None:
    """Wait until a motion is under way and so many samples of it were played."""
    until = time.monotonic() + deadline
    while (state := client.state()).mode != "moving" or state.progress < samples:
        assert time.monotonic() < until, state
        time.sleep(0.005)


def acknowledge(client: CellClient, deadline: float = 30.0) -> None:
    """Acknowledge as a person would: again while something is being connected to."""
    until = time.monotonic() + deadline
    while True:
        try:
            client.acknowledge()
            return
        except RefusedError as error:
            if "acknowledge again" not in str(error) or time.monotonic() > until:
                raise
            time.sleep(0.2)


def wait_for_mode(client: CellClient, *modes: str, deadline: float = 20.0) -> str:
    """Wait for one of these modes; returns it."""
    until = time.monotonic() + deadline
    while (mode := client.state().mode) not in modes:
        assert time.monotonic() < until, client.state()
        time.sleep(0.01)
    return mode
