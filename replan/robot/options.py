"""What the processes on the robot's side are started with."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from replan.options import CellOptions, ChildOptions, ClientOptions, ConnectionOptions, ListenOptions


@dataclass(frozen=True, kw_only=True)
class SimCellOptions(ChildOptions, ListenOptions, CellOptions):
    """A simulated cell."""

    seed: int = 0
    """Seed of the placement of objects and of all noise."""
    speed: float = 1.0
    """Pace in times real time while moving; 0 is as fast as it goes."""
    score: bool = False
    """Also answer with true poses on the key `truth`, for scorers only (benchmarks)."""


@dataclass(frozen=True, kw_only=True)
class PandaOptions(ChildOptions, ListenOptions, CellOptions):
    """A real Panda."""

    address: str
    """Host name or IP of the control box, for instance 172.16.0.2."""
    gripper_address: str | None = None
    """Where a Robotiq gripper answers: rtu:/dev/ttyUSB0 (serial line) or tcp:HOST:502. A Franka Hand is at the box."""
    activate_gripper: bool = False
    """Activate a Robotiq gripper that is not: its fingers open and close once and let go of what they hold."""
    audit_log: Path = Path("runs/robot/audit.jsonl")
    """File to which every request, motion, stop and acknowledgement is appended; no motion without it."""
    realtime: Literal["auto", "enforce", "ignore"] = "auto"
    """Whether kernel and user must be able to keep deadlines; auto: where the kernel is real-time. Motions
    have real-time priority if this user may give it; with ignore, for a simulated box, never."""
    lockstep_patience: float = 0.0
    """For a simulated box in lockstep only: wall time in seconds that its clock may wait for this machine."""


@dataclass(frozen=True, kw_only=True)
class ResearchInterfaceOptions(ChildOptions, CellOptions):
    """A simulated control box."""

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


@dataclass(frozen=True)
class RecordOptions(ConnectionOptions, CellOptions):
    """What to record of a cell's cameras."""

    out: Path
    """File to write, ending in .mcap."""
    seed: int = 0
    """Seed of the simulated cell that is started."""
    cameras: tuple[str, ...] = ()
    """Camera to record; may be repeated. Default: all."""
    seconds: float | None = None
    """How long to record."""
    frames: int | None = None
    """How many frames of each camera to record."""
    rate: float = 5.0
    """Frames a second of each camera; a slower cell is recorded as fast as it goes."""
    depth: Literal["16UC1", "32FC1"] = "16UC1"
    """Depth in whole millimetres, or in floating point metres exactly as the camera gives it."""
    compress: bool = False
    """Pictures as PNG: smaller, nothing is lost, for 16UC1 only."""
    truth: bool = False
    """Also record what truly is in each picture, for scorers; only simulated cells started with --score say it."""


@dataclass(frozen=True, kw_only=True)
class CameraOptions(ChildOptions, ClientOptions):
    """Where a camera is offered, and as which."""

    cell: str = CellOptions.cell
    """Built-in cell or cell file (YAML) that says where the camera is."""
    name: str | None = None
    """Name of the camera. Default: the cell file's only one, or the recording's."""
    max_age: float = 0.5
    """How old a picture may be when it is handed out, in [s]."""


@dataclass(frozen=True, kw_only=True)
class Ros2Options(ClientOptions):
    """What of a running cell is shown to ROS 2."""

    listen: str | None = None
    """Endpoint to offer the topics at, for instance tcp/127.0.0.1:7450, which keeps ROS 2's side away from the robot's
    own messages. Default: the robot's endpoint."""
    cell: str | None = None
    """Cell file (YAML) that says where base and cameras stand. Default: the built-in cell that is served."""
    namespace: str = ""
    """In front of every topic, for instance panda1."""
    rmw_zenoh: bool = False
    """For ROS 2 nodes with RMW_IMPLEMENTATION=rmw_zenoh_cpp (Jazzy and later), without a bridge."""
    domain: int = 0
    """ROS_DOMAIN_ID, for --rmw-zenoh."""
    camera_rate: float = 1.0
    """Frames a second of each camera; 0 for none. A simulated cell stands still while it draws one."""
    mcap: Path | None = None
    """Also record everything into this MCAP file."""
