"""The player: the process that holds the connection to the control box and commands exactly the certified samples.

It does as little as possible, on one thread: at rest it reads states and a pipe; in a motion libfranka calls back every
millisecond and gets the position of the row that is due. It checks every trajectory with a gate of its own and every
clearance against the robot's limits (`hw_interface.panda.clearance`); where it was cleared to go always ends at rest.
"""

import gc
import logging
import re
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from control.errors import MachineError, RefusedError, StackError
from control.trajectory.samples import Trajectory
from hw_interface.cell.backend import Measured
from hw_interface.cell.gate import Gate
from hw_interface.errors import MessageError
from hw_interface.messages.motions import TrajectoryRequest
from hw_interface.messages.robot import Refusal
from hw_interface.panda.board import ClearanceBoard, Order
from hw_interface.panda.clearance import JOIN_ROWS, ClearedPath
from hw_interface.panda.collision import thresholds
from hw_interface.panda.link import (
    BeginPart,
    Link,
    LoadMotion,
    MotionLoaded,
    PartEnded,
    PlayerReady,
    Recover,
    Recovered,
)
from hw_interface.panda.parts import Part, parts_of
from hw_interface.panda.scheduling import in_own_scheduling, kernel_is_real_time, real_time_trouble
from replan_base.parts import install_part

LOG = logging.getLogger(__name__)
TRACKED = 5e-3  # [rad]; a motion begins only where the arm is really held this near to its set point
MASS_SLACK = 0.15  # [kg] by which the control box may take the gripper to be heavier or lighter
IDLE_MODE, REFLEX_MODE, USER_STOPPED_MODE = 1, 4, 5  # libfranka.RobotMode
POINT = [0.0] * 9  # inertia of a load that is taken as a point


class Player:
    """The control box's only client.

    Args:
        robot: A connected `panda_py.libfranka.Robot`.
        libfranka: That module.
        gate: Checks made again here, whatever the supervisor found.
        board, link: Shared with the supervisor.
        missing_mass: Mass in [kg] of a gripper that the control box does not know of; it is announced as load.
        F_T_EE: Pose of the tool centre point at the flange, shape (4, 4); held things have their centre there.
        patience: Wall time in [s] to wait for the next clearance before beginning to come to rest. 0 on a real robot,
            whose time does not wait; more where the robot's time stands still meanwhile (a control box in lockstep).
        gone: Whether the supervisor's process is gone.
        priority: Whether motions have real-time priority, where this user may give it.
    """

    def __init__(
        self,
        robot: Any,
        libfranka: Any,
        gate: Gate,
        board: ClearanceBoard,
        link: Link,
        missing_mass: float,
        F_T_EE: np.ndarray,
        patience: float,
        gone: Callable[[], bool],
        priority: bool,
    ) -> None:
        self._robot, self._libfranka = robot, libfranka
        self._gate, self._board, self._link = gate, board, link
        self._missing_mass, self._F_T_EE = missing_mass, F_T_EE
        self._end_effector_told = False
        self._patience = patience
        self._gone = gone
        self._priority = priority
        self._motion = 0
        self._trajectory: Trajectory | None = None
        self._parts: tuple[Part, ...] = ()
        self._used: set[str] = set()
        self._state: Any = None
        self._waited_for = -1  # last planned row of the clearance whose successor did not come

    def run(self) -> None:
        """Serve until the supervisor is gone. The arm rests then: every clearance ends at rest."""
        while not self._gone():
            try:
                self._read_state()
            except Exception as error:  # libfranka's own kinds
                LOG.error("the connection to the control box broke: %s", " ".join(str(error).split()))
                return
            try:
                self._serve()
            except (EOFError, OSError):
                return

    def _serve(self) -> None:
        try:
            message = self._link.receive()
        except MessageError as error:
            self._link.send(Refusal(code="bad_message", reason=str(error)[:2000]))
            return
        if isinstance(message, LoadMotion):
            self._load(message.motion)
        elif isinstance(message, BeginPart):
            self._link.send(self._play(message))
        elif isinstance(message, Recover):
            self._recover()
        elif message is not None:
            self._link.send(Refusal(code="bad_message", reason=f"'{message.type_name}' was not expected here"))

    def _read_state(self) -> None:
        self._state = self._robot.read_once()
        self._measure(self._state, 0, -1)

    def _measure(self, state: Any, motion: int, row: int) -> None:
        board = self._board
        place = board.next_measurement()
        place["monotonic"], place["robot_time"] = time.monotonic(), state.time.to_sec()
        place["motion"], place["row"], place["mode"] = motion, row, int(state.robot_mode)
        place["q"], place["qd"], place["q_d"] = state.q, state.dq, state.q_d
        place["tau"], place["tau_ext"] = state.tau_J, state.tau_ext_hat_filtered
        place["force"] = state.O_F_ext_hat_K[:3]
        place["success_rate"] = state.control_command_success_rate
        board.publish_measurement()
        board.turn()

    # --- loading ------------------------------------------------------------------------------------------------

    def _load(self, motion: int) -> None:
        try:
            request = self._link.receive(wait=2.0)
            if not isinstance(request, TrajectoryRequest):
                raise RefusedError("bad_message", "a trajectory was to follow the request to load one")
            trajectory, certificate = request.trajectory(), request.certificate_or_none()
            state = self._state
            # What the gripper holds is known to the supervisor alone, which has checked it.
            measured = Measured(np.array(state.q), np.array(state.dq), np.array(state.tau_J), 0.0, False, True)
            accepted = self._gate.check(trajectory, certificate, np.array(state.q_d), measured, time.time(), self._used)
        except RefusedError as error:
            self._link.send(Refusal(code=error.code, reason=str(error)[:2000]))
        except StackError as error:
            self._link.send(Refusal(code="bad_message", reason=str(error)[:2000]))
        else:
            self._used.add(accepted.serial)
            self._motion, self._trajectory, self._parts = motion, trajectory, parts_of(trajectory)
            self._link.send(MotionLoaded(motion=motion))

    # --- playing ------------------------------------------------------------------------------------------------

    def _play(self, begin: BeginPart) -> PartEnded:
        """Play one part; whatever happens is in the answer."""
        row = begin.first

        def ended(code: str = "", reason: str = "") -> PartEnded:
            outcome = "aborted" if code else "rested"
            return PartEnded(
                motion=begin.motion, part=begin.part, outcome=outcome, row=row, code=code, reason=reason[:2000]
            )

        trajectory = self._trajectory
        if trajectory is None or begin.motion != self._motion or not 0 <= begin.part < len(self._parts):
            return ended("unknown_part", f"part {begin.part} of motion {begin.motion} is not loaded here")
        part = self._parts[begin.part]
        state = self._state
        off = float(np.abs(np.array(state.q) - np.array(state.q_d)).max())
        if off > TRACKED:
            return ended(
                "start_mismatch",
                f"a joint is {off * 1e3:.1f} mrad away from where it is held; {TRACKED * 1e3:g} mrad are allowed: see "
                "what leans on the arm, then plan again",
            )
        gap = np.array(state.q_d) - trajectory.q[part.start]
        if np.abs(gap).max() > TRACKED:
            return ended(
                "start_mismatch", f"the part begins {np.abs(gap).max() * 1e3:.1f} mrad from where the arm is held"
            )
        if not part.start <= begin.begin < part.start + 1.0:
            return ended("unknown_part", f"the part begins at sample {part.start}, not at {begin.begin:.2f}")
        held, limits = np.array(state.q_d), self._gate.robot_limits
        cleared = ClearedPath(trajectory.q, limits, begin.first, begin.begin, part.start, part.stop, held)
        try:
            self._announce(part)
        except Exception as error:
            return ended("refused_by_robot", f"the control box refused thresholds or load: {error}")
        positions = self._libfranka.JointPositions
        elapsed, finished, self._waited_for = 0, False, -1

        def callback(state: Any, period: Any) -> Any:
            nonlocal elapsed, finished, row
            elapsed += round(period.to_sec() * 1000.0)  # more than one after lost packets
            self._take_clearance(begin, cleared, row, elapsed)
            row = cleared.row(elapsed)
            command = positions(cleared.command(elapsed).tolist())
            finished = elapsed >= JOIN_ROWS and row >= cleared.last
            if finished:
                command.motion_finished = True
            self._state = state
            self._measure(state, begin.motion, row)
            return command

        gc.disable()  # a collection in the middle of a motion would lose packets
        try:
            mode = self._libfranka.ControllerMode.kJointImpedance
            in_own_scheduling(
                lambda answer: self._robot.control_joint_position(answer, mode, False, 1000.0), callback, self._priority
            )
        except Exception as error:
            return ended(*_why_aborted(str(error)))
        finally:
            gc.enable()
        return ended()

    def _take_clearance(self, begin: BeginPart, cleared: ClearedPath, row: int, elapsed: int) -> None:
        """Take the latest clearance, waiting for one only where the robot's time waits as well."""
        if (order := self._board.order()) is not None:
            self._judge(order, begin, cleared, row)
        if self._patience <= 0.0 or self._waited_for == cleared.planned:
            return  # waiting for this one was in vain
        until = time.monotonic() + self._patience
        while cleared.planned < cleared.last and cleared.row(elapsed) >= cleared.planned and time.monotonic() < until:
            if (order := self._board.order()) is not None:
                self._judge(order, begin, cleared, row)
            time.sleep(1e-4)
            self._board.turn()
        if time.monotonic() >= until:
            self._waited_for = cleared.planned

    def _judge(self, order: Order, begin: BeginPart, cleared: ClearedPath, row: int) -> None:
        if order.motion != begin.motion or order.part != begin.part:
            why = "it is for another part"
        else:
            why = cleared.accept(order.clearance, row)
        if why not in (None, "late"):
            LOG.error("a clearance was refused: %s", why)
        self._board.tell_order(order.sequence, why)

    def _announce(self, part: Part) -> None:
        """Tell the box from where on to stop, and what hangs at the flange."""
        if not self._end_effector_told:
            self._robot.set_ee([1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0])
            F_T_NE = np.array(self._robot.read_once().F_T_EE).reshape(4, 4).T  # libfranka's columns come first
            NE_T_EE = np.linalg.solve(F_T_NE, self._F_T_EE)
            self._robot.set_ee(NE_T_EE.T.ravel().tolist())
            self._end_effector_told = True
        self._robot.set_collision_behavior(*thresholds(part).as_arguments())
        mass = part.load + self._missing_mass
        if mass > 0.0:
            self._robot.set_load(mass, self._F_T_EE[:3, 3].tolist(), POINT)
        else:
            self._robot.set_load(0.0, [0.0, 0.0, 0.0], POINT)

    def _recover(self) -> None:
        state = self._state
        try:
            if int(state.robot_mode) == USER_STOPPED_MODE:
                raise RefusedError("user_stop", "the user stop is pressed; release it, then acknowledge")
            if int(state.robot_mode) != IDLE_MODE:
                self._robot.automatic_error_recovery()
            self._read_state()
            if int(self._state.robot_mode) != IDLE_MODE:
                raise RefusedError(
                    "not_ready",
                    f"the control box is in mode {self._state.robot_mode.name[1:]} after recovery; open the brakes and "
                    "activate FCI in Desk, then acknowledge",
                )
        except RefusedError as error:
            self._link.send(Refusal(code=error.code, reason=str(error)))
        except Exception as error:
            self._link.send(Refusal(code="not_ready", reason=f"the control box did not recover: {error}"[:2000]))
        else:
            self._link.send(Recovered())


def _why_aborted(text: str) -> tuple[str, str]:
    """Code and reason of a motion that the control box ended."""
    errors = re.findall(r'"([a-z_]+)"', text)
    line = " ".join(text.split())
    if "user" in text.lower() and "stop" in text.lower():
        return "user_stop", "the user stop was pressed; release it, look at the cell, then acknowledge"
    if errors:
        return "reflex", f"the control box stopped the arm: {', '.join(errors)} ({line})"
    if "connection" in text.lower() or "timeout" in text.lower() or "network" in text.lower():
        return "robot_gone", f"the connection to the control box broke: {line}"
    return "refused_by_robot", f"the control box did not play the motion: {line}"


def connect(address: str, realtime: str, log_size: int = 50) -> tuple[Any, Any]:
    """A connected robot and the libfranka module.

    Args:
        address: Host name or IP of the control box.
        realtime: "enforce" (needs a real-time kernel), "ignore", or "auto": enforce where the kernel is one.

    Raises:
        MachineError: panda-python is not installed, the kernel is not real-time or this user may not use that, or the
            box does not take us.
    """
    try:
        from panda_py import libfranka
    except ImportError as error:
        raise MachineError(
            "a real Panda needs panda-python 1.1.1 (libfranka 0.9.2), which is not installed; run: "
            + install_part("panda")
        ) from error
    enforce = realtime == "enforce" or (realtime == "auto" and kernel_is_real_time())
    if enforce and (trouble := real_time_trouble()) is not None:
        raise MachineError(f"{trouble}; or say --realtime ignore for a simulated box")
    config = libfranka.RealtimeConfig.kEnforce if enforce else libfranka.RealtimeConfig.kIgnore
    try:
        return libfranka.Robot(address, config, log_size), libfranka
    except Exception as error:
        text = " ".join(str(error).split())
        if "ncompatible" in text:
            raise MachineError(
                f"the control box at {address} speaks another protocol version ({text}); panda-python 1.1.1 speaks "
                "version 5 (Panda, system 4.2.1 or later); a Franka Research 3 (version 10) needs another library"
            ) from error
        raise MachineError(
            f"no control box takes connections at {address}: {text}; see: replan doctor --robot {address}"
        ) from error


def missing_mass(measured: float, gripper_mass: float) -> float:
    """Mass in [kg] of the gripper that the control box does not know of.

    Args:
        measured: What it takes the end effector to weigh, in [kg].
        gripper_mass: What the cell's gripper weighs, in [kg].

    Raises:
        MachineError: It takes it for another one.
    """
    if abs(measured - gripper_mass) <= MASS_SLACK:
        return 0.0
    if measured <= MASS_SLACK:
        return gripper_mass
    raise MachineError(
        f"the control box takes its end effector to weigh {measured:.2f} kg, the cell's gripper weighs "
        f"{gripper_mass:.2f} kg; choose the right end effector in Desk (or none), or correct the cell file"
    )


def ready(robot: Any, state: Any) -> PlayerReady:
    """What to tell the supervisor after connecting."""
    return PlayerReady(server_version=int(robot.server_version()), end_effector_mass=float(state.m_ee))
