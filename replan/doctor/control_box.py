"""Whether a real Panda could be driven from here: every way in which its control box may not answer, in one line."""

from dataclasses import dataclass

from hw_interface.fci_simulator.handshake import Answer, RobotAnswer, ask_gripper, ask_robot, listens
from hw_interface.fci_simulator.layout import GRIPPER_PORT, PORT, VERSION, Mode

DESK_PORT = 443  # of the web pages of a control box
CLIENT = "panda-python 1.1.1 (libfranka 0.9.2)"


@dataclass(frozen=True)
class Examined:
    """One part of a robot.

    Attributes:
        name: "control box" or "gripper", with the address.
        ok: Whether it can be used now.
        detail: What it is like, or what is wrong and what to do.
    """

    name: str
    ok: bool
    detail: str


def examine_control_box(address: str, timeout: float = 2.0, desk_port: int = DESK_PORT) -> tuple[Examined, ...]:
    """Look at a robot and its gripper; moves nothing, takes at most a few seconds.

    Args:
        address: Host name or address of the control box.
        timeout: Longest wait in [s] at each step.
        desk_port: Where its web pages are, which tell a control box without FCI from any other machine.
    """
    robot = ask_robot(address, timeout)
    found = Examined(f"control box {address}", robot.trouble is None and robot.mode is Mode.IDLE, "")
    if robot.trouble is None:
        found = Examined(found.name, found.ok, _mode(robot))
    else:
        desk = robot.trouble == "refused" and listens(address, desk_port, timeout)
        found = Examined(found.name, False, _trouble(robot, address, timeout, desk))
    if robot.trouble in ("no_host", "unreachable"):
        return (found,)
    return found, _gripper(ask_gripper(address, timeout), address)


def _mode(robot: RobotAnswer) -> str:
    speaks = f"research interface {robot.version}, {robot.states_per_second:.0f} states/s"
    errors = f" ({', '.join(robot.errors)})" if robot.errors else ""
    match robot.mode:
        case Mode.IDLE:
            return f"{speaks}, idle: ready to move"
        case Mode.USER_STOPPED:
            return f"{speaks}, but the user stop is pressed: release the external activation device"
        case Mode.REFLEX:
            return f"{speaks}, but in reflex{errors}: look at the cell, then recover (robot acknowledge, or Desk)"
        case Mode.OTHER:
            return f"{speaks}, but in mode 'other', which mostly means locked brakes: open the brakes in Desk"
        case Mode.GUIDING:
            return f"{speaks}, but somebody is guiding the arm by hand: let go of the guiding button"
        case Mode.MOVE:
            return f"{speaks}, but it is moving: another program drives it"
        case _:
            return f"{speaks}, but it is recovering from an error: wait, then look again"


def _trouble(robot: RobotAnswer, address: str, timeout: float, desk: bool) -> str:
    match robot.trouble:
        case "no_host":
            return f"no machine is called '{address}' ({robot.detail}); give the address that Desk is opened with"
        case "unreachable":
            return (
                f"no answer from {address} ({robot.detail}): is the control box on, and this computer connected to its "
                "LAN port (not the arm's) with an address of the same network?"
            )
        case "refused" if desk:
            return (
                f"a control box answers at {address}, but FCI is not activated: open https://{address}, unlock the "
                "joints, and choose Activate FCI in the menu at the top right"
            )
        case "refused":
            return (
                f"nothing listens at {address}:{PORT} and there is no Desk either: it is another machine, or the "
                "control box is still starting"
            )
        case "closed":
            return (
                f"{address}:{PORT} closed the connection at once: another program is connected to the robot (there is "
                "one client at a time); end it"
            )
        case "silent":
            return (
                f"{address}:{PORT} takes connections and does not answer within {timeout:g} s: the control box hangs "
                "or is still starting; wait a minute, else restart it (a libfranka program would wait for ever)"
            )
        case "version":
            return _version(robot.version)
        case "no_states":
            return (
                f"connected to {address}, but no state arrives by UDP within {timeout:g} s: a firewall on this "
                "computer or network address translation is in the way"
            )
        case _:
            return f"what answers at {address}:{PORT} is no research interface ({robot.detail})"


def _version(spoken: int | None) -> str:
    if spoken is not None and spoken > VERSION:
        return (
            f"it speaks research interface {spoken} (10 is a Franka Research 3's), {CLIENT} speaks {VERSION}: a Panda "
            "with system 4.2.1 or later; for an FR3 install a libfranka that speaks its version"
        )
    return (
        f"it speaks research interface {spoken}, {CLIENT} speaks {VERSION}: update the Panda's system to 4.2.1 or "
        "later in Desk, under Settings"
    )


def _gripper(answer: Answer, address: str) -> Examined:
    name = f"gripper {address}"
    match answer.trouble:
        case None:
            return Examined(name, True, f"Franka Hand, interface {answer.version}")
        case "refused" | "unreachable":
            detail = (
                f"no Franka Hand at {address}:{GRIPPER_PORT}: none is mounted or chosen as end effector in Desk "
                "(another gripper has its own connection)"
            )
        case "silent":
            detail = "the Franka Hand's service does not answer: choose Re-initialize hand in Desk, under End effector"
        case "closed":
            detail = "the Franka Hand's service closed the connection: another program is connected to it; end it"
        case "version":
            detail = f"the Franka Hand speaks interface {answer.version}, {CLIENT} speaks 3: update the Panda's system"
        case _:
            detail = f"what answers at {address}:{GRIPPER_PORT} is no Franka Hand ({answer.detail})"
    return Examined(name, False, detail)
