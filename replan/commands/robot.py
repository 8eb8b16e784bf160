"""`replan robot sim|panda|research-interface|play|speed|acknowledge`: processes and acts on the robot's side."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from replan.commands.flags import SetOnly, Switches
from replan.options import CellOptions, ClientOptions
from replan.robot.options import PandaOptions, ResearchInterfaceOptions, SimCellOptions

if TYPE_CHECKING:
    from replan.console import Console


@dataclass(frozen=True, kw_only=True)
class RobotSim(SimCellOptions):
    """Start a simulated cell: a Panda, its gripper, its cameras and whatever stands there, in this process.

    It speaks to others through the same messages as a real robot and runs until Ctrl-C.
    """

    cell_options: Switches = CellOptions.cell_options
    json: SetOnly = False
    """Print the ready line as JSON."""

    def execute(self, console: Console) -> int:
        """Run until told to stop."""
        console.note(f"simulated cell {self.cell}, seed {self.seed}: building its world")
        from replan.robot.sim import serve_simulated_cell

        return serve_simulated_cell(self, console.note)


@dataclass(frozen=True, kw_only=True)
class RobotPanda(PandaOptions):
    """Offer a real Panda: connect to its control box and play what has a certificate, and nothing else.

    This process supervises; it starts a player, which alone talks to the control box, and a process for the gripper.
    Whatever dies or freezes, the arm comes to rest on its path and stays until a person acknowledges
    (`replan robot acknowledge`). A stop by software is no emergency stop: keep the user stop in reach.
    """

    cell: str = CellOptions.cell
    """Built-in cell or a cell file (YAML): its robot, safety table and gripper."""
    cell_options: Switches = CellOptions.cell_options
    activate_gripper: SetOnly = PandaOptions.activate_gripper
    json: SetOnly = False
    """Print the ready line as JSON."""

    def execute(self, console: Console) -> int:
        """Run until told to stop."""
        console.note(f"connecting to the control box at {self.address}")
        from replan.robot.panda import serve_panda

        return serve_panda(self, console.note)


@dataclass(frozen=True, kw_only=True)
class RobotResearchInterface(ResearchInterfaceOptions):
    """Start a simulated Panda behind its own protocol: a control box that libfranka connects to as to a real one.

    It listens on the ports 1337 (robot) and 1338 (Franka's hand) of its address and runs until Ctrl-C.
    """

    cell: str = CellOptions.cell
    """Built-in cell or a cell file (YAML) that the robot stands in."""
    cell_options: Switches = CellOptions.cell_options
    json: SetOnly = False
    """Print the ready line as JSON."""

    def execute(self, console: Console) -> int:
        """Run until told to stop."""
        console.note(f"simulated control box in cell {self.cell}, seed {self.seed}: building its world")
        from replan.robot.research_interface import serve_research_interface

        return serve_research_interface(self, console.note)


@dataclass(frozen=True, kw_only=True)
class RobotAcknowledge(ClientOptions):
    """Say, after a stop or reflex, that you looked at the cell and that the robot may move again."""

    json: SetOnly = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Send the acknowledgement."""
        from hw_interface.cell.client import CellClient
        from hw_interface.link.security import link_or_none

        with CellClient.connect(self.robot, security=link_or_none(self.link)) as client:
            before = client.state()
            client.acknowledge()
            after = client.state()
        why = before.last_error.reason if before.last_error else None
        console.result(
            {"mode_before": before.mode, "mode": after.mode, "last_error": why},
            f"robot was '{before.mode}'" + (f" ({why})" if why else "") + f", is '{after.mode}' now",
        )
        return 0


@dataclass(frozen=True, kw_only=True)
class RobotPlay(ClientOptions):
    """Have a robot play exactly the trajectory in a file, with its certificate; Ctrl-C rests on the path.

    Nothing is planned or judged here. The robot refuses, in one line and with exit code 4, what its certificate does
    not cover: other samples, another robot, firmware or limits, a certificate that expired or was used, another start.
    """

    trajectory: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="TRAJECTORY")]
    """Trajectory file (NPZ) that the certificate was issued for."""
    certificate: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="CERTIFICATE")]
    """Its certificate (JSON)."""
    motion_speed: float | None = None
    """Share of the certified speed to play it at, above 0 and at most 1; slower on exactly the same path. Stays set on
    the robot. Default: as the robot is set."""
    json: SetOnly = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Read both files and play."""
        from control.motion_files.reading import read_motion
        from control.motion_files.resampling import to_trajectory
        from control.safety.certificate_file import read_certificate
        from hw_interface.link.security import link_or_none
        from replan.robot.play import play

        certificate = read_certificate(self.certificate)
        trajectory = to_trajectory(read_motion(self.trajectory))
        security = link_or_none(self.link)
        report = play(trajectory, certificate, self.robot, console.note, self.motion_speed, security)
        console.result(report.as_json(), report.as_text())
        return 0


@dataclass(frozen=True, kw_only=True)
class RobotSpeed(ClientOptions):
    """Have a robot play its motions at a share of their certified speed: the present one from now on, and later ones.

    The arm stays exactly on its path and changes its speed within its limits. 1 is the speed that a motion was judged
    at; nothing plays faster.
    """

    speed: Annotated[tyro.conf.Positional[float], tyro.conf.arg(metavar="SHARE")]
    """Share of the certified speed, above 0 and at most 1, for instance 0.3."""
    json: SetOnly = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Send the speed."""
        from hw_interface.cell.client import CellClient
        from hw_interface.link.security import link_or_none

        with CellClient.connect(self.robot, security=link_or_none(self.link)) as client:
            state = client.set_speed(self.speed)
        now = f"at speed {state.speed:.2g} now" if state.mode == "moving" else f"'{state.mode}'"
        console.result(
            {"mode": state.mode, "speed": state.speed, "speed_wanted": state.speed_wanted},
            f"robot plays at speed {state.speed_wanted:g} of 1; it is {now}",
        )
        return 0


@dataclass(frozen=True)
class Robot:
    """The robot's side.

    A simulated cell or control box, a real Panda, playing a certified trajectory, its speed, acknowledging a stop.
    """

    which: tyro.conf.OmitSubcommandPrefixes[
        tyro.conf.OmitArgPrefixes[
            Annotated[RobotSim, tyro.conf.subcommand("sim")]
            | Annotated[RobotPanda, tyro.conf.subcommand("panda")]
            | Annotated[RobotResearchInterface, tyro.conf.subcommand("research-interface")]
            | Annotated[RobotPlay, tyro.conf.subcommand("play")]
            | Annotated[RobotSpeed, tyro.conf.subcommand("speed")]
            | Annotated[RobotAcknowledge, tyro.conf.subcommand("acknowledge")]
        ]
    ]

    @property
    def json(self) -> bool:
        """Whether the chosen command prints JSON."""
        return self.which.json

    def execute(self, console: Console) -> int:
        """Run the chosen command."""
        return self.which.execute(console)
