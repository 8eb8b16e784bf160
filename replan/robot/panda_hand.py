"""The process that talks to a gripper; started by `replan robot panda`, never by a person."""

import os
import sys
from dataclasses import dataclass
from multiprocessing.connection import Connection

import tyro


@dataclass(frozen=True)
class HandOptions:
    """What the supervisor tells the gripper's process."""

    address: str
    """Where the gripper answers: the control box for a Franka Hand."""
    gripper: str = "panda_hand"
    """Which gripper it is."""
    activate: bool = False
    """Whether a Robotiq gripper may be activated, which moves its fingers."""
    link_fd: int = -1
    """Descriptor of the pipe to the supervisor."""
    board_fd: int = -1
    """Descriptor of the shared memory."""


def main() -> int:
    """Connect, then carry out commands until the supervisor is gone."""
    options = tyro.cli(HandOptions)
    supervisor = os.getppid()
    from control.robot.gripper import gripper_model
    from hw_interface.panda.franka_hand import connect_hand
    from hw_interface.panda.hand import Hand
    from hw_interface.panda.hand_process import KINDS, serve_hand
    from hw_interface.panda.link import Link

    model = gripper_model(options.gripper)
    link = Link(Connection(options.link_fd), KINDS)
    gone = lambda: os.getppid() != supervisor  # noqa: E731

    def connect() -> Hand:
        if model.mounting is None:
            return connect_hand(options.address, model)
        from hw_interface.robotiq.gripper import connect_robotiq

        return connect_robotiq(options.address, options.activate)

    return serve_hand(connect, link, options.board_fd, gone)


if __name__ == "__main__":
    sys.exit(main())
