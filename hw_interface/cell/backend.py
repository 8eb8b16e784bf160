"""What a driver needs of a robot, simulated or real: read, command, gripper."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from control.trajectory.samples import GripperCommand


@dataclass(frozen=True)
class Measured:
    """What a robot measures at one moment.

    Attributes:
        q, qd: Joint positions in [rad] and velocities in [rad/s], shape (7,).
        tau: Joint torques in [Nm], shape (7,).
        gripper_width: Distance between the pads in [m].
        gripper_busy: Whether the last gripper command is still under way.
        grasped: Whether the pads are pressed apart by something between them.
        contact_force: Estimated force on the arm and hand, fingers not counted, in [N]; None where it is not measured.
    """

    q: NDArray[np.float64]
    qd: NDArray[np.float64]
    tau: NDArray[np.float64]
    gripper_width: float
    gripper_busy: bool
    grasped: bool
    contact_force: float | None = None


class RobotBackend(Protocol):
    """A robot that follows joint positions, one command a millisecond of robot time."""

    def read(self) -> Measured:
        """What the robot measures now."""
        ...

    def command(self, q_d: np.ndarray, qd_d: np.ndarray) -> None:
        """Be at `q_d` in [rad] moving with `qd_d` in [rad/s] one millisecond from now; both of shape (7,).

        Returns when that millisecond has passed on the robot's own clock (a simulation advances by it).
        """
        ...

    def gripper(self, command: GripperCommand) -> None:
        """Begin a gripper command; `read().gripper_busy` tells when it is over."""
        ...
