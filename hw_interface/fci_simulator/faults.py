"""Faults on demand, for tests and benchmarks: an administrative channel that only the simulated control box has.

One line in, one line of JSON out, over TCP on this machine. The lines:

    state                              robot time, mode, errors, whether a client is there
    user_stop on|off                   press or release the user stop
    brakes on|off                      lock or open the brakes (mode "other")
    guiding on|off                     as if somebody guided the arm
    push JOINT TORQUE SECONDS          push joint 1..7 with a torque in [Nm]
    reflex NAME                        abort with this error, as libfranka prints it
    freeze on|off                      answer nothing any more, neither TCP nor UDP; robot time stands still
    gripper_silent on|off              the gripper takes requests and does not answer
    gripper off|on                     nothing listens on the gripper's port
    drop N                             lose the next N commands of the client, in this motion
    version N                          report another protocol version
    history FILE                       write the last 60 s, every millisecond, to an NPZ file (see `history`)
    fci on|off|silent                  answer; refuse connections; take connections and never answer

Nothing that drives a robot may use this.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from control.errors import ConfigError
from hw_interface.fci_simulator.clients import Service
from hw_interface.fci_simulator.control_box import ControlBox
from hw_interface.fci_simulator.layout import ERROR_NAMES, Error


@dataclass
class Faults:
    """Faults that the server itself carries out.

    Attributes:
        frozen: Whether the box answers nothing.
        drop: Commands still to lose.
    """

    frozen: bool = False
    drop: int = 0


class FaultCommands:
    """Carries out the lines of the administrative channel.

    Args:
        box: The robot's state machine.
        robot, gripper: Their services.
        faults: Where what the server itself does is written down.
    """

    def __init__(self, box: ControlBox, robot: Service, gripper: Service, faults: Faults) -> None:
        self._box, self._robot, self._gripper, self._faults = box, robot, gripper, faults

    def carry_out(self, line: str) -> dict[str, object]:
        """Carry out one line; returns what to answer.

        Raises:
            ConfigError: It is none of the lines that there are.
        """
        name, *words = line.split() or [""]
        switches = {
            "user_stop": self._box.press_user_stop,
            "brakes": self._box.lock_brakes,
            "guiding": self._box.guide,
            "freeze": self._freeze,
            "gripper_silent": self._gripper.silence,
            "gripper": lambda on: self._gripper.listen() if on else self._gripper.refuse(),
        }
        try:
            if name in switches:
                switches[name]({"on": True, "off": False}[words[0]])
            elif name == "push":
                torque = np.zeros(7)
                torque[range(7)[int(words[0]) - 1]] = float(words[1])
                self._box.push(torque, float(words[2]))
            elif name == "reflex":
                self._box.reflex(Error(ERROR_NAMES.index(words[0])))
            elif name == "drop":
                self._faults.drop = int(words[0])
            elif name == "history":
                self._box.history.write(Path(words[0]))
            elif name == "version":
                self._robot.version = int(words[0])
            elif name == "fci":
                self._set_fci(words[0])
            elif name != "state":
                raise KeyError(name)
        except (KeyError, IndexError, ValueError):
            raise ConfigError(
                f"'{line}' is not valid; valid are: state, user_stop|brakes|guiding|freeze|gripper_silent|gripper "
                "on|off, push JOINT TORQUE SECONDS, reflex NAME, drop N, version N, "
                "history FILE, fci on|off|silent"
            ) from None
        return {
            "ok": True,
            "milliseconds": self._box.milliseconds,
            "mode": self._box.mode.name.lower(),
            "errors": list(self._box.errors),
            "connected": self._robot.connected,
        }

    def _freeze(self, on: bool) -> None:
        self._faults.frozen = on

    def _set_fci(self, how: str) -> None:
        if how == "off":
            self._robot.refuse()
        elif how in ("on", "silent"):
            self._robot.silence(how == "silent")
            self._robot.listen()
        else:
            raise ValueError(how)
