"""A perfect robot without physics: for tests of the driver and of whatever talks to it, without MuJoCo."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from control.robot.limits import REST_Q
from control.trajectory.samples import SAMPLE_TIME, GripperCommand
from hw_interface.cell.backend import Measured

GRIPPER_SPEED = 0.2  # [m/s] between the pads


class PerfectRobot:
    """A `RobotBackend` that is exactly where it was told to be. Faults are set from outside.

    Args:
        q: Start configuration in [rad], shape (7,).
        object_width: Width in [m] of what a closing gripper meets, or None for nothing.

    Attributes:
        commands: Every (q_d, qd_d) that was commanded, in order.
        gripper_commands: Every gripper command, in order.
        distort: Applied to each measurement before it is returned, to imitate faults; may raise.
        object_width: As above; setting it to None drops what is held.
    """

    def __init__(self, q: np.ndarray | tuple[float, ...] = REST_Q, object_width: float | None = None) -> None:
        self.commands: list[tuple[np.ndarray, np.ndarray]] = []
        self.gripper_commands: list[GripperCommand] = []
        self.distort: Callable[[Measured], Measured] = lambda measured: measured
        self.object_width = object_width
        self._measured = Measured(np.array(q, float), np.zeros(7), np.zeros(7), 0.08, False, False, 0.0)

    def read(self) -> Measured:
        """Where it was told to be, distorted."""
        return self.distort(self._measured)

    def command(self, q_d: np.ndarray, qd_d: np.ndarray) -> None:
        """Be there a millisecond later."""
        self.commands.append((np.array(q_d), np.array(qd_d)))
        width, busy, grasped = self._gripper_after_a_millisecond()
        self._measured = replace(
            self._measured,
            q=np.array(q_d),
            qd=np.array(qd_d),
            gripper_width=width,
            gripper_busy=busy,
            grasped=grasped,
        )

    def gripper(self, command: GripperCommand) -> None:
        """Begin a gripper command."""
        self.gripper_commands.append(command)
        self._measured = replace(self._measured, gripper_busy=True, grasped=False)

    def _gripper_after_a_millisecond(self) -> tuple[float, bool, bool]:
        width = self._measured.gripper_width
        if not self.gripper_commands:
            return width, False, False
        command = self.gripper_commands[-1]
        grasping = command.kind == "grasp"
        target = (self.object_width or 0.0) if grasping else command.width
        step = GRIPPER_SPEED * SAMPLE_TIME
        width += min(max(target - width, -step), step)
        arrived = abs(width - target) < 1e-9
        return width, not arrived, grasping and arrived and self.object_width is not None
