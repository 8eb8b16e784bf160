"""`replan bench NAME`: measurements, printed as a table or JSON."""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import tyro

from perception.options import PerceptionModels
from replan.commands.bench_rc import BenchRc
from replan.commands.flags import options_in
from replan_base.processes import python_module

if TYPE_CHECKING:
    from replan.console import Console


@dataclass(frozen=True, kw_only=True)
class BenchGoals(PerceptionModels):
    """Whole runs over seeded placements, judged on the simulated cell's truth."""

    runs: int = 20
    """Runs of each goal, with seeds 0, 1, 2, ..."""
    goals: tuple[str, ...] = ()
    """Names of the goals to run; default all (an unknown name lists them)."""
    speed: float = 0.0
    """Pace of the simulated cells in times real time; 0 is as fast as they go."""
    runs_dir: Path = Path("runs/bench")
    """Where run folders are made."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Run the benchmark."""
        from replan.rc.tabletop_goals import bench_goals
        from replan.rendering import require_mujoco

        require_mujoco()  # else every run would be counted as failed
        models = options_in(self, PerceptionModels)
        report = bench_goals(self.runs, self.goals, self.speed, self.runs_dir, console.note, models)
        console.result(report.as_json(), report.as_text())
        return 0


def _call(module: str, *arguments: str) -> int:
    """Run a script of `benchmarks` in a process of its own; returns its exit code."""
    return subprocess.call(python_module("replan_base.script", module, *arguments))


@dataclass(frozen=True)
class _BenchScript:
    """A script of `benchmarks`, which prints its own table or JSON."""

    MODULE: ClassVar[str]
    EXTRA: ClassVar[tuple[str, ...]] = ()

    seeds: int = 20
    """Number of seeds."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Run the script in a process of its own; returns its exit code."""
        command = [self.MODULE, "--seeds", str(self.seeds), *self.EXTRA]
        return _call(*command, *["--json"] * self.json)


@dataclass(frozen=True)
class BenchPoses(_BenchScript):
    """Pose error of the embedded perception against truth over seeded simulated cells."""

    MODULE: ClassVar[str] = "benchmarks.looking.pose_error"
    EXTRA: ClassVar[tuple[str, ...]] = ("--cameras", "static", "wrist")  # as a run looks


@dataclass(frozen=True)
class BenchUnnamed(_BenchScript):
    """Things that nobody named in looks at the built-in cells: false ones, missed ones, seconds."""

    MODULE: ClassVar[str] = "benchmarks.looking.unnamed_things"


@dataclass(frozen=True)
class BenchPerception:
    """Boxes, masks, poses and times of perception on held-out pictures of random cells, by detector."""

    detectors: tuple[str, ...] = ()
    """Rows: default, bundled, DETECTOR+SEGMENTER as `replan perceive` takes them, "given boxes" (true boxes, default
    segmenter), "given masks" (geometry alone). Default: default colour+grabcut bundled "given boxes" "given masks"."""
    frames: int = 300
    """Frames, at 0.5, 0.7 and 1.0 m in turn; all go through every row."""
    seed: int = 0
    """Seed of the frames; none of them is ever trained on."""
    jobs: int = 1
    """Processes that share the frames; times mean something with 1 only."""
    full_size: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Instead: processor time and memory of full-size GroundingDINO, SAM and SAM 2; random weights, nothing fetched."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Run the script in a process of its own; returns its exit code."""
        command = ["benchmarks.looking.perception", "--frames", str(self.frames)]
        command += ["--seed", str(self.seed), "--jobs", str(self.jobs)]
        command += ["--detectors", *self.detectors] if self.detectors else []
        return _call(*command, *["--full-size"] * self.full_size, *["--json"] * self.json)


@dataclass(frozen=True)
class BenchMotions:
    """Motions for the subtasks of the built-in cells: success, cleanness, time and simulated steps."""

    runs: int = 20
    """Runs of each motion, with seeds 0, 1, 2, ..."""
    motions: tuple[str, ...] = ()
    """Names of the motions; default all (an unknown name lists them)."""
    planner: Literal["candidates", "predictive-sampling"] = "candidates"
    """Who plans."""
    pose_noise_mm: float = 0.0
    """Spread of the errors of perceived positions per axis in [mm]; yaws err by 0.4 degrees a millimetre."""
    mismatch: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Let the true model differ: furniture 5 mm, things 4 mm and 4 degrees, friction and mass 30 %, joint gains 7 %."""
    jobs: int = 1
    """Processes that share the runs; wall times mean something with 1 only."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Run the script in a process of its own; returns its exit code."""
        command = ["benchmarks.motion.motions", "--runs", str(self.runs), "--planner", self.planner]
        command += ["--pose-noise-mm", str(self.pose_noise_mm), "--jobs", str(self.jobs)]
        command += ["--motions", *self.motions] if self.motions else []
        return _call(*command, *["--mismatch"] * self.mismatch, *["--json"] * self.json)


@dataclass(frozen=True)
class BenchPlanner(_BenchScript):
    """CPU time of motion planners over that of the same simulated steps in bare mujoco.batch."""

    MODULE: ClassVar[str] = "benchmarks.motion.planner"

    seeds: int = 2
    """Number of seeds of each task; one takes about three minutes in all, most of it the baseline's."""


@dataclass(frozen=True)
class BenchRetime(_BenchScript):
    """Retiming at published, derated and gentle limits: ratio to the fastest, violations, deviation, time."""

    seeds: int = 5
    """Random paths round corners of each kind, beside all others."""

    MODULE: ClassVar[str] = "benchmarks.motion.retime"


@dataclass(frozen=True)
class BenchDiagnosis:
    """How often the right cause of a failure is named, with true poses and with errors on every pose."""

    runs: int = 20
    """Runs of each case, with seeds 0, 1, 2, ..."""
    pose_noise_mm: float = 5.0
    """Spread of position errors per axis in the second table, in [mm]."""
    yaw_noise_deg: float = 2.0
    """Spread of yaw errors in the second table, in [degrees]."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Run the script in a process of its own; returns its exit code."""
        command = ["benchmarks.judging.diagnosis", "--runs", str(self.runs)]
        command += ["--pose-noise-mm", str(self.pose_noise_mm), "--yaw-noise-deg", str(self.yaw_noise_deg)]
        return _call(*command, *["--json"] * self.json)


@dataclass(frozen=True)
class BenchVerdicts:
    """Verdicts on motions with one injected fault each and on good ones: what slips through, what is a false alarm."""

    seeds: int = 6
    """Seeds 0, 1, 2, ... of each planned motion."""
    motions: tuple[str, ...] = ()
    """Names of the planned motions; default all (an unknown name lists them)."""
    jobs: int = 2
    """Processes that share the motions; the time of one verdict is taken before they start."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Run the script in a process of its own; returns its exit code."""
        command = ["benchmarks.judging.verdicts", "--seeds", str(self.seeds), "--jobs", str(self.jobs)]
        command += ["--motions", *self.motions] if self.motions else []
        return _call(*command, *["--json"] * self.json)


@dataclass(frozen=True)
class BenchResearchInterface:
    """Motions through the real libfranka on the simulated control box: which are aborted, and by what name.

    Validated ones, ones with one limit broken each, and planned paths that were not retimed.
    """

    runs: int = 100
    """Motions of each of the three kinds."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Run the script in a process of its own; returns its exit code."""
        command = ["benchmarks.robot_side.research_interface", "--runs", str(self.runs)]
        return _call(*command, *["--json"] * self.json)


@dataclass(frozen=True)
class BenchRealTime:
    """Validated motions through the real driver on the simulated control box at the pace of the clock.

    How many are completed, and how many commands come late on this machine.
    """

    runs: int = 30
    """Motions."""
    jobs: int = 1
    """Robots at a time, each with a control box of its own."""
    load: int = 0
    """Processes that compute beside them."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Run the script in a process of its own; returns its exit code, 1 when a motion was not completed."""
        command = ["benchmarks.robot_side.real_time", "--runs", str(self.runs), "--jobs", str(self.jobs)]
        return _call(*command, "--load", str(self.load), *["--json"] * self.json)


@dataclass(frozen=True)
class BenchTransport:
    """Delivery of a motion, latency and loss of states, pictures a second: as it is, and while all cores compute."""

    seconds: float = 60.0
    """Of states."""
    rate: float = 1000.0
    """States a second."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Run the script in a process of its own; returns its exit code, 1 when a state was lost."""
        command = ["benchmarks.robot_side.transport", "--seconds", str(self.seconds)]
        return _call(*command, "--rate", str(self.rate), *["--json"] * self.json)


@dataclass(frozen=True)
class BenchFaults:
    """Faults injected into the real driver on the simulated control box: what moved, what rested, what was said."""

    injections: int = 308
    """How many; the kinds of faults take turns."""
    kinds: tuple[str, ...] = ()
    """Names of the faults; default all (an unknown name lists them)."""
    seed: int = 0
    """Seed of the first injection of each kind."""
    jobs: int = 1
    """Robot sides at a time on this machine; each has four processes."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Run the script in a process of its own; returns its exit code."""
        command = ["benchmarks.robot_side.faults", "--injections", str(self.injections)]
        command += ["--seed", str(self.seed), "--jobs", str(self.jobs)]
        command += ["--kinds", *self.kinds] if self.kinds else []
        return _call(*command, *["--json"] * self.json)


@dataclass(frozen=True)
class BenchStalls:
    """Episodes of `replan bench rc` whose processes are stopped for 0.3 to 1.5 s every now and then, beside busy ones.

    How many reach their goal, and what a stall ended.
    """

    seeds: tuple[int, ...] = (201, 202)
    """Seeds of each task."""
    tasks: tuple[str, ...] = ()
    """Names of the tasks; default all eight (an unknown name lists them)."""
    busy: int = 4
    """Processes that compute beside them."""
    folder: Path | None = None
    """Where to keep the runs; default nowhere."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Run the script in a process of its own; returns its exit code, 1 when a stall ended a run at rest."""
        command = ["benchmarks.robot_side.stalls", "--busy", str(self.busy), "--seeds", *map(str, self.seeds)]
        command += ["--tasks", *self.tasks] if self.tasks else []
        command += ["--folder", str(self.folder)] if self.folder else []
        return _call(*command, *["--json"] * self.json)


@dataclass(frozen=True)
class Bench:
    """Measure goals, perception, motions, verdicts or the robot's side.

    Goals in simulated cells, the paper's tasks, perception, motions, planners, retiming, causes, verdicts, the control
    box, the driver in real time and under faults, transport, stalls.
    """

    name: tyro.conf.OmitSubcommandPrefixes[
        tyro.conf.OmitArgPrefixes[
            Annotated[BenchGoals, tyro.conf.subcommand("goals")]
            | Annotated[BenchRc, tyro.conf.subcommand("rc")]
            | Annotated[BenchMotions, tyro.conf.subcommand("motions")]
            | Annotated[BenchPerception, tyro.conf.subcommand("perception")]
            | Annotated[BenchPlanner, tyro.conf.subcommand("planner")]
            | Annotated[BenchPoses, tyro.conf.subcommand("poses")]
            | Annotated[BenchUnnamed, tyro.conf.subcommand("unnamed")]
            | Annotated[BenchRetime, tyro.conf.subcommand("retime")]
            | Annotated[BenchDiagnosis, tyro.conf.subcommand("diagnosis")]
            | Annotated[BenchVerdicts, tyro.conf.subcommand("verdicts")]
            | Annotated[BenchTransport, tyro.conf.subcommand("transport")]
            | Annotated[BenchResearchInterface, tyro.conf.subcommand("research-interface")]
            | Annotated[BenchRealTime, tyro.conf.subcommand("real-time")]
            | Annotated[BenchFaults, tyro.conf.subcommand("faults")]
            | Annotated[BenchStalls, tyro.conf.subcommand("stalls")]
        ]
    ]

    @property
    def json(self) -> bool:
        """Whether the chosen benchmark prints JSON."""
        return self.name.json

    def execute(self, console: Console) -> int:
        """Run the chosen benchmark."""
        return self.name.execute(console)
