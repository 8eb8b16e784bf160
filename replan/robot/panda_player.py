"""The process that talks to a Panda's control box; started by `replan robot panda`, never by a person."""

import os
import sys
from dataclasses import dataclass
from multiprocessing.connection import Connection

import tyro


@dataclass(frozen=True)
class PlayerOptions:
    """What the supervisor tells its player."""

    address: str
    """Host name or IP of the control box."""
    cell: str
    """Built-in cell or cell file: limits, safety table and gripper."""
    option: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """Switches of the cell."""
    realtime: str = "auto"
    """enforce, ignore or auto."""
    patience: float = 0.0
    """See `hw_interface.panda.player.Player`."""
    link_fd: int = -1
    """Descriptor of the pipe to the supervisor."""
    board_fd: int = -1
    """Descriptor of the shared memory."""


def main() -> int:
    """Connect, then play until the supervisor is gone."""
    options = tyro.cli(PlayerOptions)
    supervisor = os.getppid()
    from control.errors import StackError
    from hw_interface.link.memory import keep_memory
    from hw_interface.messages.robot import Refusal
    from hw_interface.panda.board import ClearanceBoard
    from hw_interface.panda.link import Link
    from hw_interface.panda.player import Player, connect, missing_mass, ready
    from replan.robot.gate import cell_gate

    keep_memory()
    link = Link(Connection(options.link_fd))
    board = ClearanceBoard(options.board_fd)
    try:
        gate, _ = cell_gate(options.cell, options.option)
        robot, libfranka = connect(options.address, options.realtime)
        state = robot.read_once()
        lacking = missing_mass(float(state.m_ee), gate.gripper.mass)
        link.send(ready(robot, state))
    except StackError as error:
        link.send(Refusal(code="not_ready", reason=str(error)[:2000]))
        return 1
    gone = lambda: os.getppid() != supervisor  # noqa: E731
    # Before a simulated box on this machine, a player that comes first takes from the box the time to hear it.
    priority = options.realtime != "ignore" and options.patience <= 0.0
    tcp = gate.gripper.flange_T_tcp
    Player(robot, libfranka, gate, board, link, lacking, tcp, options.patience, gone, priority).run()
    return 0


if __name__ == "__main__":
    sys.exit(main())
