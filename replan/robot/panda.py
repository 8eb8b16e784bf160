"""The supervisor of a real Panda as a process."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from control.errors import ConfigError
from replan_base.processes import python_module

STILL_LOCKSTEP = 1.5  # [s] of wall time

if TYPE_CHECKING:
    from control.robot.gripper import GripperModel
    from replan.robot.options import PandaOptions


def serve_panda(options: "PandaOptions", say: Callable[[str], None]) -> int:
    """Connect to the control box and serve until told to stop; returns the exit code.

    Raises:
        ConfigError: Unknown cell, port in use, no audit log, a link file or endpoint that is not valid.
        MachineError, RobotGoneError: The control box or the gripper is not ready, or there is no router to join.
    """
    from hw_interface.cell.audit_log import AuditLog
    from hw_interface.cell.node import RobotNode
    from hw_interface.cell.pacing import Leash, announce
    from hw_interface.link.memory import keep_memory
    from hw_interface.link.security import link_or_none
    from hw_interface.panda.driver import PandaDriver
    from hw_interface.panda.hand_process import HandProcess
    from hw_interface.panda.player_process import STILL_MOVING, PlayerProcess
    from hw_interface.panda.scheduling import kernel_is_real_time, real_time_trouble
    from hw_interface.panda.serve import supervise
    from replan.robot.gate import cell_gate

    simulated = options.lockstep_patience > 0.0  # no real box waits
    if options.realtime == "auto" and not simulated and not kernel_is_real_time():
        say(f"{real_time_trouble()}. That will do for a simulated control box only (say --realtime ignore for one)")
    keep_memory()
    security = link_or_none(options.link)
    gate, cell = cell_gate(options.cell, options.cell_options)
    audit = AuditLog(options.audit_log)
    hand_command = python_module("replan.robot.panda_hand", "--address", _gripper_address(options, gate.gripper))
    hand_command += ["--gripper", gate.gripper.name, *["--activate"] * options.activate_gripper]
    player_command = python_module("replan.robot.panda_player", "--address", options.address, "--cell", options.cell)
    player_command += ["--realtime", options.realtime, "--patience", str(options.lockstep_patience)]
    for name in options.cell_options:
        player_command += ["--option", name]
    leash = Leash(options.parent_pid)
    with leash.signals():
        # Where robot time waits for this machine, a player that is slow is no danger.
        still = STILL_LOCKSTEP if simulated else STILL_MOVING
        hand = HandProcess(hand_command)  # both connect at the same time
        try:
            start = lambda: PlayerProcess(player_command, still)  # noqa: E731
            driver = PandaDriver(start, hand, gate, cell.name, time_waits=simulated)
        except BaseException:
            hand.close()
            raise
        try:
            hand.await_ready()
            node = RobotNode(
                driver,
                (),
                _no_picture,
                options.connect or options.endpoint,
                security=security,
                connect=options.connect is not None,
                state_rate=options.state_rate,
                audit=audit,
            )
            try:
                announce(node, driver)
                say(f"the Panda at {options.address} is '{driver.mode}'; Ctrl-C brings it to rest and ends")
                supervise(driver, node, leash)
            finally:
                node.close()
        finally:
            driver.close()
            audit.close()
    return 0


def _gripper_address(options: "PandaOptions", gripper: "GripperModel") -> str:
    """Where the gripper of the cell answers.

    Raises:
        ConfigError: A Robotiq gripper without its address, or an address for a Franka Hand.
    """
    is_franka = gripper.mounting is None
    if is_franka and options.gripper_address is not None:
        raise ConfigError(
            "the cell's gripper is a Franka Hand, which is at the control box; leave out --gripper-address"
        )
    if not is_franka and options.gripper_address is None:
        raise ConfigError(
            f"the cell's gripper is a '{gripper.name}'; say where it answers: --gripper-address rtu:/dev/ttyUSB0 "
            "(serial line) or tcp:HOST:502"
        )
    return options.gripper_address or options.address


def _no_picture(camera: str):
    raise LookupError(camera)  # a node without cameras is never asked
