"""The Franka Hand through libfranka, in a thread of its own process: its commands block until they are done."""

import threading
from typing import Any

from control.errors import MachineError
from control.robot.gripper import GripperModel
from control.trajectory.samples import GripperCommand
from hw_interface.own_time import OwnTime
from hw_interface.panda.hand import HandReading
from replan_base.parts import install_part

SPEED = 0.1  # [m/s] between the pads; Franka Hand, product manual: travel speed 50 mm/s a finger
PATIENCE = 2.5  # [s] without a state after which the gripper is taken to be gone
LATE_STATE = 1.0  # [s] after which libfranka gives up on a state
NOTHING = 0.002  # [m]; pads nearer than this hold nothing


class FrankaHand:
    """A Franka Hand. Commands run on a thread; states are read between them.

    Args:
        gripper: A connected `panda_py.libfranka.Gripper`.
        model: What it can do.
    """

    def __init__(self, gripper: Any, model: GripperModel) -> None:
        self._gripper, self._model = gripper, model
        self._worker: threading.Thread | None = None
        self._fault: str | None = None
        self._silent = OwnTime(longest=LATE_STATE)
        self._look()

    def read(self) -> HandReading:
        """How it stands."""
        busy = self._worker is not None and self._worker.is_alive()
        if not busy and self._fault is None:
            try:
                self._look()
            except Exception as error:  # libfranka gives up on a state that is late; the next one may come
                if self._silent.look() > PATIENCE:
                    self._fault = f"the gripper sends no states: {' '.join(str(error).split())}"
        return HandReading(self._width, busy, self._grasped and not busy, self._fault)

    def restart(self) -> None:
        """Its process is started anew instead."""
        raise MachineError("a Franka Hand is connected to anew by starting its process again")

    def close(self) -> None:
        """Nothing to let go of: the connection ends with the process."""

    def begin(self, command: GripperCommand) -> None:
        """Begin a command."""
        self._worker = threading.Thread(target=self._carry_out, args=(command,), daemon=True)
        self._worker.start()

    def _look(self) -> None:
        state = self._gripper.read_once()
        self._width, self._grasped = float(state.width), bool(state.is_grasped)
        self._silent.restart()

    def _carry_out(self, command: GripperCommand) -> None:
        try:
            if command.kind == "move":
                # False when it is blocked on the way: the width tells.
                self._gripper.move(min(command.width, float(self._gripper.read_once().max_width)), SPEED)
            else:
                inner, outer = max(0.0, command.width - NOTHING), self._model.opening
                self._gripper.grasp(command.width, SPEED, command.force, inner, outer)
        except Exception as error:
            if "aborted" not in str(error):  # by a newer command
                self._fault = f"the gripper did not do what it was told: {' '.join(str(error).split())}"
        finally:
            self._silent.restart()


def connect_hand(address: str, model: GripperModel) -> FrankaHand:
    """The hand at a control box.

    Raises:
        MachineError: There is none, it was not homed, or panda-python is not installed.
    """
    try:
        from panda_py import libfranka
    except ModuleNotFoundError as error:
        raise MachineError(f"a Franka Hand needs panda-python 1.1.1; run: {install_part('panda')}") from error
    try:
        hand = libfranka.Gripper(address)
        state = hand.read_once()
    except Exception as error:
        raise MachineError(
            f"no Franka Hand answers at {address}: {' '.join(str(error).split())}; see that it is attached and "
            "activated in Desk"
        ) from error
    if float(state.max_width) < 0.5 * model.opening:
        raise MachineError(
            f"the gripper says that it opens {float(state.max_width) * 1e3:.0f} mm; it opens "
            f"{model.opening * 1e3:.0f} mm: home it in Desk, then start again"
        )
    return FrankaHand(hand, model)
