"""Validated motions through the whole driver at real-time pace: how many are completed, how many commands came late.

The simulated control box keeps the wall clock: a command that is not there within its millisecond is lost, twenty lost
ones in a row abort the motion. In front of it stands `replan robot panda`, at ordinary priority, and a client that
sends motion after motion with a certificate. Losses are counted in the box. Gripper events are rests of the arm; the
box's world holds the arm alone.

    python -m benchmarks.robot_side.real_time --motions motions.npz --runs 30 [--jobs 4] [--load 16] [--json]
"""

import argparse
import contextlib
import json
import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.motion.broken_limits import Motion
from benchmarks.robot_side.fault_judgement import MOVE
from benchmarks.robot_side.libfranka_motions import swing
from benchmarks.robot_side.panda_side import History, PandaSide, acknowledge, certified, gate, panda_side
from benchmarks.robot_side.research_interface import find_motions, read_motions, write_motions
from benchmarks.robot_side.transport import load
from control.errors import RefusedError, StackError
from control.trajectory.samples import SAMPLE_TIME, Trajectory, TrajectorySegment
from hw_interface.cell.client import CellClient
from hw_interface.cell.gate import Gate

COMPLETED = "completed"


@dataclass(frozen=True)
class Played:
    """What became of one motion.

    Attributes:
        name: Of the motion.
        seconds: Of robot time that it has.
        told: `COMPLETED`, or what the client was told.
        commands: Milliseconds from the first command that came to the last one.
        lost: Of these, how many no command came for in time.
        longest: Most of them in a row.
        pace: Robot time per wall time while it was played; below 1 the simulated box itself was late.
    """

    name: str
    seconds: float
    told: str
    commands: int
    lost: int
    longest: int
    pace: float


def lost_commands(history: History, since: int) -> tuple[int, int, int]:
    """Milliseconds of motion, those without a command, and most of them in a row.

    Args:
        history: Of the control box.
        since: Robot time in [ms] from which on to count.
    """
    told = history.told[(history.time >= since) & (history.mode == MOVE)]
    came = np.flatnonzero(told)
    if len(came) == 0:
        return 0, 0, 0
    missing = np.diff(came) - 1
    return int(came[-1] - came[0] + 1), int(missing.sum()), int(missing.max(initial=0))


def as_trajectory(samples: np.ndarray) -> Trajectory:
    """Samples in [rad], shape (n, 7), at rest at both ends, with their derivatives by central differences."""
    padded = np.concatenate([samples[:1], samples, samples[-1:]])
    qd = (padded[2:] - padded[:-2]) / (2.0 * SAMPLE_TIME)
    qdd = (padded[2:] - 2.0 * samples + padded[:-2]) / SAMPLE_TIME**2
    for k in (0, -1):
        qd[k], qdd[k] = 0.0, 0.0
    return Trajectory(samples, qd, qdd, (), (TrajectorySegment("motion", 0, len(samples)),))


class Rig:
    """One robot side and its client.

    Args:
        side: The robot side; its box keeps real time.
        client: Connected to it.
        of: The gate of its cell.
        folder: For files.
    """

    def __init__(self, side: PandaSide, client: CellClient, of: Gate, folder: Path) -> None:
        self._side, self._client, self._gate, self._folder = side, client, of, folder

    def play(self, motion: Motion) -> Played:
        """Go to where the motion begins, play it, and look at what the box counted."""
        here = np.array(self._client.state().q_d)
        way = motion.samples[0] - here
        if (far := float(np.abs(way).max())) > 0.0:
            back = self._execute(swing(here, way, 1.0 + 4.0 * far))
            if back != COMPLETED:
                return Played(motion.name, 0.0, f"on the way to its start: {back}", 0, 0, 0, 0.0)
        since, begun = self._milliseconds(), time.monotonic()
        told = self._execute(motion.samples)
        passed, wall = self._milliseconds() - since, time.monotonic() - begun
        counted = lost_commands(self._side.history(self._folder), since)
        if self._client.state().mode != "idle":
            acknowledge(self._client)
        return Played(motion.name, len(motion.samples) * SAMPLE_TIME, told, *counted, SAMPLE_TIME * passed / wall)

    def _execute(self, samples: np.ndarray) -> str:
        trajectory = as_trajectory(samples)
        try:
            report = self._client.execute(trajectory, certified(trajectory, self._gate))
        except RefusedError as error:
            return f"{error.code}: {error}"
        except StackError as error:
            return f"{type(error).__name__}: {error}"
        return COMPLETED if report.completed else f"{report.reason}: {report.detail}"

    def _milliseconds(self) -> int:
        return int(str(self._side.box.faults.send("state")["milliseconds"]))


def measure(motions: list[Motion], jobs: int, say: Callable[[str], None]) -> list[Played]:
    """Play motions on so many robot sides at once, started before the first motion begins."""
    of = gate()
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        rigs = []
        for _ in range(jobs):
            side = stack.enter_context(panda_side(folder, "real-time", arm_alone=True))
            client = stack.enter_context(contextlib.closing(CellClient.connect(side.endpoint)))
            rigs.append(Rig(side, client, of, folder))

        def share(k: int) -> list[Played]:
            done = []
            for motion in motions[k::jobs]:
                done.append(rigs[k].play(motion))
                say(f"{done[-1]}")
            return done

        with ThreadPoolExecutor(jobs) as pool:
            return [one for part in pool.map(share, range(jobs)) for one in part]


def report(played: list[Played], jobs: int, busy: int) -> dict[str, Any]:
    """The figures."""
    commands, lost = sum(p.commands for p in played), sum(p.lost for p in played)
    return {
        "cores": os.cpu_count(),
        "robots_at_once": jobs,
        "busy_processes": busy,
        "motions": len(played),
        "completed": sum(p.told == COMPLETED for p in played),
        "told": dict(Counter(p.told for p in played if p.told != COMPLETED)),
        "robot_seconds": round(sum(p.seconds for p in played), 3),
        "commands": commands,
        "lost": lost,
        "success_rate": 1.0 - lost / commands if commands else 0.0,
        "motions_without_loss": sum(p.told == COMPLETED and p.lost == 0 for p in played),
        "most_lost_in_a_row": max((p.longest for p in played), default=0),
        "slowest_pace": min((p.pace for p in played), default=0.0),
        "each": [asdict(p) for p in played],
    }


def as_text(found: dict[str, Any]) -> str:
    """For people."""
    f = found
    lines = [
        f"{f['completed']} of {f['motions']} motions completed in real time ({f['robot_seconds']:.0f} s); "
        f"{f['robots_at_once']} at once, {f['busy_processes']} busy processes, {f['cores']} cores",
        f"commands lost: {f['lost']} of {f['commands']} ({100 * f['success_rate']:.3f} % came), at most "
        f"{f['most_lost_in_a_row']} in a row; {f['motions_without_loss']} motions lost none",
        f"slowest robot time: {f['slowest_pace']:.4f} of wall time",
        *(f"{count:4} {told}" for told, count in f["told"].items()),
    ]
    return "\n".join(lines)


def main() -> int:
    """Measure and print; exit code 1 when a motion was not completed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=30, help="validated motions")
    parser.add_argument("--motions", type=Path, help="file (NPZ) to keep the motions in, or to read")
    parser.add_argument("--jobs", type=int, default=1, help="robots at once, each with a box of its own")
    parser.add_argument("--load", type=int, default=0, help="processes that compute beside them")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    given = parser.parse_args()

    def say(line: str) -> None:
        print(line, file=sys.stderr, flush=True)

    motions = read_motions(given.motions) if given.motions and given.motions.exists() else find_motions(given.runs, say)
    if given.motions and not given.motions.exists():
        write_motions(given.motions, motions)
    with load(given.load):
        found = report(measure(motions[: given.runs], given.jobs, say), given.jobs, given.load)
    print(json.dumps(found, indent=2) if given.json else as_text(found))
    return 0 if found["completed"] == found["motions"] else 1


if __name__ == "__main__":
    sys.exit(main())
