"""`replan robot sim|panda|research-interface|play|speed|acknowledge`: processes and acts on the robot's side."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

if TYPE_CHECKING:
    from replan.console import Console

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"


@dataclass(frozen=True)
class RobotSim:
    """Start a simulated cell: a Panda, its gripper, its cameras and whatever stands there, in this process.

    It speaks to others through the same messages as a real robot and runs until Ctrl-C.
    """

    cell: str = "cubes"
    """Built-in cell or a cell file (YAML)."""
    option: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """Switch of the cell to turn on; may be repeated."""
    seed: int = 0
    """Seed of the placement of objects and of all noise."""
    endpoint: str = DEFAULT_ENDPOINT
    """Where to listen: tcp/ within this machine, or tls/HOST:PORT with --link."""
    connect: str | None = None
    """Join the router at this endpoint (`replan router`) instead of listening."""
    link: Path | None = None
    """Link file with this machine's certificates, for tls/ endpoints (docs/security.md)."""
    state_rate: float = 70.0
    """States a second to publish, at most 1000."""
    speed: float = 1.0
    """Pace in times real time while moving; 0 is as fast as it goes."""
    score: bool = False
    """Also answer with true poses on the key `truth`, for scorers only (benchmarks)."""
    parent_pid: Annotated[int | None, tyro.conf.arg(help="End when this process is gone.")] = None
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print the ready line as JSON."""

    def execute(self, console: Console) -> int:
        """Run until told to stop."""
        console.note(f"simulated cell {self.cell}, seed {self.seed}: building its world")
        from replan.robot.sim import serve_simulated_cell

        return serve_simulated_cell(self, console.note)


@dataclass(frozen=True)
class RobotPanda:
    """Offer a real Panda: connect to its control box and play what has a certificate, and nothing else.

    This process supervises; it starts a player, which alone talks to the control box, and a process for the gripper.
    Whatever dies or freezes, the arm comes to rest on its path and stays until a person acknowledges
    (`replan robot acknowledge`). A stop by software is no emergency stop: keep the user stop in reach.
    """

    address: str
    """Host name or IP of the control box, for instance 172.16.0.2."""
    cell: str = "cubes"
    """Built-in cell or a cell file (YAML): its robot, safety table and gripper."""
    option: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """Switch of the cell to turn on; may be repeated."""
    endpoint: str = DEFAULT_ENDPOINT
    """Where to listen: tcp/ within this machine, or tls/HOST:PORT with --link."""
    connect: str | None = None
    """Join the router at this endpoint (`replan router`) instead of listening."""
    link: Path | None = None
    """Link file with this machine's certificates, for tls/ endpoints (docs/security.md)."""
    state_rate: float = 70.0
    """States a second to publish, at most 1000."""
    gripper_address: str | None = None
    """Where a Robotiq gripper answers: rtu:/dev/ttyUSB0 (serial line) or tcp:HOST:502. A Franka Hand is at the box."""
    activate_gripper: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Activate a Robotiq gripper that is not: its fingers open and close once and let go of what they hold."""
    audit_log: Path = Path("runs/robot/audit.jsonl")
    """File to which every request, motion, stop and acknowledgement is appended; no motion without it."""
    realtime: Literal["auto", "enforce", "ignore"] = "auto"
    """Whether kernel and user must be able to keep deadlines; auto: where the kernel is real-time. Motions
    have real-time priority if this user may give it; with ignore, for a simulated box, never."""
    lockstep_patience: float = 0.0
    """For a simulated box in lockstep only: wall time in seconds that its clock may wait for this machine."""
    parent_pid: Annotated[int | None, tyro.conf.arg(help="End when this process is gone.")] = None
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print the ready line as JSON."""

    def execute(self, console: Console) -> int:
        """Run until told to stop."""
        console.note(f"connecting to the control box at {self.address}")
        from replan.robot.panda import serve_panda

        return serve_panda(self, console.note)


@dataclass(frozen=True)
class RobotResearchInterface:
    """Start a simulated Panda behind its own protocol: a control box that libfranka connects to as to a real one.

    It listens on the ports 1337 (robot) and 1338 (Franka's hand) of its address and runs until Ctrl-C.
    """

    cell: str = "cubes"
    """Built-in cell or a cell file (YAML) that the robot stands in."""
    option: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """Switch of the cell to turn on; may be repeated."""
    seed: int = 0
    """Seed of the placement of objects."""
    address: str = "127.0.0.1"
    """Address to listen at; another one of 127.0.0.0/8 for each box on this machine."""
    pace: Literal["real-time", "lockstep"] = "real-time"
    """Real time as a real robot, or lockstep: a motion advances by the client's commands, however long they take."""
    control_port: int | None = None
    """Port on 127.0.0.1 that takes faults to simulate (user stop, pushes, silence), 0 for a free one. Default: none."""
    endpoint: str | None = None
    """Also offer the cell's cameras to the robot process or router at this endpoint once it is there."""
    link: Path | None = None
    """Link file of a camera, for an endpoint tls/HOST:PORT on another machine (docs/security.md)."""
    score: bool = False
    """Also answer there with true poses on the key `truth`, for scorers only (benchmarks)."""
    parent_pid: Annotated[int | None, tyro.conf.arg(help="End when this process is gone.")] = None
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print the ready line as JSON."""

    def execute(self, console: Console) -> int:
        """Run until told to stop."""
        console.note(f"simulated control box in cell {self.cell}, seed {self.seed}: building its world")
        from replan.robot.research_interface import serve_research_interface

        return serve_research_interface(self, console.note)


@dataclass(frozen=True)
class RobotAcknowledge:
    """Say, after a stop or reflex, that you looked at the cell and that the robot may move again."""

    robot: str = DEFAULT_ENDPOINT
    """Endpoint of the robot process or router: tls/HOST:PORT on another machine."""
    link: Path | None = None
    """Link file with this machine's certificates, for tls/ endpoints (docs/security.md)."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
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


@dataclass(frozen=True)
class RobotPlay:
    """Have a robot play exactly the trajectory in a file, with its certificate; Ctrl-C rests on the path.

    Nothing is planned or judged here. The robot refuses, in one line and with exit code 4, what its certificate does
    not cover: other samples, another robot, firmware or limits, a certificate that expired or was used, another start.
    """

    trajectory: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="TRAJECTORY")]
    """Trajectory file (NPZ) that the certificate was issued for."""
    certificate: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="CERTIFICATE")]
    """Its certificate (JSON)."""
    robot: str = DEFAULT_ENDPOINT
    """Endpoint of the robot process or router: tls/HOST:PORT on another machine."""
    link: Path | None = None
    """Link file with this machine's certificates, for tls/ endpoints (docs/security.md)."""
    motion_speed: float | None = None
    """Share of the certified speed to play it at, above 0 and at most 1; slower on exactly the same path. Stays set on
    the robot. Default: as the robot is set."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
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


@dataclass(frozen=True)
class RobotSpeed:
    """Have a robot play its motions at a share of their certified speed: the present one from now on, and later ones.

    The arm stays exactly on its path and changes its speed within its limits. 1 is the speed that a motion was judged
    at; nothing plays faster.
    """

    speed: Annotated[tyro.conf.Positional[float], tyro.conf.arg(metavar="SHARE")]
    """Share of the certified speed, above 0 and at most 1, for instance 0.3."""
    robot: str = DEFAULT_ENDPOINT
    """Endpoint of the robot process or router: tls/HOST:PORT on another machine."""
    link: Path | None = None
    """Link file with this machine's certificates, for tls/ endpoints (docs/security.md)."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
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
    """The robot's side: a simulated cell or control box, a real Panda, playing a certified trajectory, its speed,
    acknowledging a stop.
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
