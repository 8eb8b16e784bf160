"""What works on this machine: packages, rendering, model weights, a robot."""

import importlib.metadata
import platform
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from replan_base.parts import install_part

if TYPE_CHECKING:
    from hw_interface.messages.cameras import CameraHealth

# Use and part of each package; no part: it comes with the program itself.
PACKAGES = {
    "mujoco": ("twin and simulated cell", "twin"),
    "pin": ("robot dynamics", None),
    "toppra": ("retiming", "twin"),
    "eclipse-zenoh": ("transport", None),
    "opencv-python-headless": ("embedded detector and masks", "twin"),
    "open3d": ("point clouds", "perception"),
    "torch": ("learned models", "perception"),
    "transformers": ("GroundingDINO and SAM", "perception"),
    "example-robot-data": ("the Panda's description", None),
}
ROBOT_PACKAGES = {
    "pin": ("robot dynamics", None),
    "eclipse-zenoh": ("transport", None),
    "example-robot-data": ("the Panda's description", None),
    "panda-python": ("the Panda's control box", "panda"),
    "cryptography": ("keys of links between machines", "security"),
    "pymodbus": ("Robotiq grippers", "robotiq"),
    "pyserial": ("Robotiq grippers", "robotiq"),
    "rosbags": ("ROS 2 messages", "ros2"),
}
NOT_NEEDED = ("torch", "transformers", "cryptography", "pymodbus", "pyserial", "rosbags")


@dataclass(frozen=True)
class Finding:
    """One thing that was examined.

    Attributes:
        topic: "package", "rendering", "weights", "reasoner", "link" or "robot".
        name: What was examined.
        ok: Whether it is there and works.
        detail: Version, place, or what to do.
        needed: Whether a simulated run is impossible without it.
        command: What to type to get it, where that is known.
    """

    topic: str
    name: str
    ok: bool
    detail: str
    needed: bool = False
    command: str = ""


@dataclass(frozen=True)
class Findings:
    """Everything that was examined.

    Attributes:
        items: One by one.
        robot_side: Whether they are about what the robot's own computer needs, not about a simulated run.
    """

    items: tuple[Finding, ...]
    robot_side: bool = False

    @property
    def complete(self) -> bool:
        """Whether all that is needed is there."""
        return all(f.ok for f in self.items if f.needed)

    def as_json(self) -> dict[str, Any]:
        """As one JSON object."""
        return {
            "can_run_robot" if self.robot_side else "can_simulate": self.complete,
            "platform": platform.platform(),
            "python": platform.python_version(),
            "findings": [asdict(f) for f in self.items],
        }


def examine(
    robot_endpoint: str,
    detector: str = "default",
    segmenter: str = "default",
    server: tuple[str, str | None, str] | None = None,
    link: Path | None = None,
) -> Findings:
    """Look at everything; takes a few seconds.

    Args:
        robot_endpoint: Where a robot process may be listening, for instance tcp/127.0.0.1:7447; or, without a
            protocol in front, the address of a Panda's control box.
        detector, segmenter: Weights to look at beside those that are known, as given to `replan run`.
        server: Address of a language server, model or None, and environment variable of its key; None to ask none.
        link: Link file of a robot on another machine, or None.
    """
    from replan.doctor.reasoners import examine_reasoners
    from replan.doctor.weights import examine_weights

    items = [_package(name, *facts) for name, facts in PACKAGES.items()]
    items.append(_rendering())
    items += [
        Finding("weights", w.name, w.here, w.detail, command=w.command) for w in examine_weights(detector, segmenter)
    ]
    items += [Finding("reasoner", r.name, r.here, r.detail) for r in examine_reasoners(server)]
    items += [*_link(link), *_robots(robot_endpoint, link), *_cameras(robot_endpoint, link)]
    return Findings(tuple(items))


def examine_robot_side(robot_endpoint: str, link: Path | None = None) -> Findings:
    """Look at what the robot's own computer needs.

    Args:
        robot_endpoint, link: As in `examine`.
    """
    items = [_package(name, *facts) for name, facts in ROBOT_PACKAGES.items()]
    return Findings((*items, _real_time(), *_link(link), _robot(robot_endpoint, link)), robot_side=True)


def _package(name: str, use: str, part: str | None) -> Finding:
    needed = name not in NOT_NEEDED
    try:
        return Finding("package", name, True, f"{importlib.metadata.version(name)} ({use})", needed)
    except importlib.metadata.PackageNotFoundError:
        how = f"run: {install_part(part)}" if part else "install this program anew (docs/install.md)"
        return Finding("package", name, False, f"not installed ({use}); {how}", needed)


def _rendering() -> Finding:
    from control.errors import StackError
    from replan.rendering import require_mujoco

    try:
        require_mujoco()
        from sim_check.models.render import available_backend

        return Finding("rendering", "off-screen", True, f"MUJOCO_GL={available_backend()} works", needed=True)
    except StackError as error:
        return Finding("rendering", "off-screen", False, str(error), needed=True)


def _link(link: Path | None) -> list[Finding]:
    import datetime

    from control.errors import StackError
    from hw_interface.link.keys import examine_keys
    from hw_interface.link.security import read_link_file

    if link is None:
        return []
    try:
        known = examine_keys(read_link_file(link), datetime.datetime.now(datetime.UTC))
    except StackError as error:
        return [Finding("link", str(link), False, str(error))]
    return [
        Finding("link", f"{k.path.name} ({k.name})", not k.trouble, k.trouble or f"good until {k.expires:%Y-%m-%d}")
        for k in known
    ]


def _robots(where: str, link: Path | None) -> list[Finding]:
    """A robot process at an endpoint, or a control box and its gripper at an address."""
    if "/" in where:
        return [_robot(where, link)]
    from replan.doctor.control_box import examine_control_box

    found = [Finding("robot", part.name, part.ok, part.detail) for part in examine_control_box(where)]
    return [*found, _real_time()]


def _real_time() -> Finding:
    from hw_interface.panda.scheduling import real_time_trouble

    trouble = real_time_trouble()
    return Finding("machine", "real time", trouble is None, trouble or "kernel and rights are there")


def _robot(endpoint: str, link: Path | None) -> Finding:
    from control.errors import StackError
    from hw_interface.cell.client import CellClient
    from hw_interface.link.security import link_or_none

    try:
        with CellClient.connect(endpoint, timeout=1.0, security=link_or_none(link)) as client:
            state = client.state()
    except StackError as error:
        return Finding("robot", endpoint, False, str(error))
    return Finding("robot", endpoint, True, f"{state.profile} in cell {state.cell}, mode {state.mode}")


def _cameras(endpoint: str, link: Path | None) -> list[Finding]:
    """What the camera processes say of themselves; nothing where no robot process is meant or answers."""
    if "/" not in endpoint:
        return []
    from control.errors import RobotGoneError, StackError
    from hw_interface.cell.client import CellClient
    from hw_interface.link.security import link_or_none

    try:
        with CellClient.connect(endpoint, timeout=1.0, security=link_or_none(link)) as client:
            found = client.camera_health()
    except RobotGoneError:
        return []  # said with the robot already
    except StackError as error:
        return [Finding("camera", endpoint, False, str(error))]
    return [_camera(h) for h in found]


def _camera(h: "CameraHealth") -> Finding:
    age = "no picture yet" if h.age is None else f"newest {h.age:.2f} s old (at most {h.max_age:g})"
    clock = "clock not measured"
    if h.clock_offset is not None and h.clock_uncertainty is not None:
        clock = f"clock {1000 * h.clock_offset:+.1f} +- {1000 * h.clock_uncertainty:.1f} ms"
        clock += f", set anew {h.clock_jumps} times" if h.clock_jumps else ""
    numbers = f"{h.rate:.1f} pictures a second, {h.dropped} of {h.frames + h.dropped} dropped, {age}, {clock}"
    return Finding("camera", h.camera, h.trouble is None, f"{h.trouble or h.source}; {numbers} ({h.owner})")


def render(findings: Findings) -> str:
    """The findings as a table for people."""
    import io

    from rich.console import Console
    from rich.table import Table

    table = Table(title=None, box=None, pad_edge=False)
    for column in ("", "topic", "name", "detail"):
        table.add_column(column, overflow="fold")
    for f in findings.items:
        mark = "ok" if f.ok else ("MISSING" if f.needed else "-")
        table.add_row(mark, f.topic, f.name, f.detail)
    out = io.StringIO()
    Console(file=out, width=120, no_color=True).print(table)
    lines = [line.rstrip() for line in out.getvalue().splitlines()]
    # Below the table and unfolded, so that they can be copied.
    commands = [f.command for f in findings.items if f.command]
    if commands:
        lines += ["weights from the hub that are not here are fetched, each once, with:", *(f"  {c}" for c in commands)]
    what = "a robot's process" if findings.robot_side else "a simulated run"
    verdict = f"{what} is possible" if findings.complete else f"{what} is NOT possible; see MISSING"
    return "\n".join([*lines, verdict])
