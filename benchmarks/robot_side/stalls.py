"""Benchmark episodes on a machine that stalls: how many reach their goal, and what a stall ended.

Every episode is one of `replan bench rc`, in processes of its own: the run (the client) and its simulated cell. Beside
them some processes compute, and every now and then the client, the cell or both are stopped for a while, drawn from a
seed. A stall may make an episode slow; it may end a motion at rest on its path, after which the run acknowledges, since
its cell is simulated, and goes on; it must end nothing else.

    python -m benchmarks.robot_side.stalls --seeds 201 202 --busy 4 [--tasks cabinet-locked ...] [--json]
"""

import argparse
import json
import os
import random
import signal
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.robot_side.transport import load
from planning.reasoners.options import ReasonerOptions
from replan.rc.ending import events_of
from replan.rc.jobs import Job
from replan.rc.records import EpisodeRecord, Setup, setup_now
from replan.rc.runner import run_job
from replan.rc.tasks import TASKS, task_named
from replan.rc.variants import variant_from
from replan.run.motion_player import STALLED

LENGTH = (0.3, 1.5)  # of a stall, in [s]
PAUSE = (0.5, 3.0)  # from the end of a stall to the next, in [s]
WHOM = ("client", "cell", "both")
CLIENT, CELL = "replan.rc.episode", "robot sim"  # in the command lines of their processes
TIME_LIMIT = 1800.0  # [s] of one episode
LINK_ERRORS = ("RobotGoneError", "CameraGoneError")


@dataclass(frozen=True)
class StalledEpisode:
    """What became of one episode.

    Attributes:
        task, seed: Which.
        reached: Whether its goal was truly reached and nothing came to harm.
        stalls: How often processes were stopped.
        stopped_motions: Motions that a stall ended at rest on their path; the run went on after each.
        ended: What ended the run although it should not: "" (nothing did), "at rest" or "moving": a lost link or a
            process that was taken to be frozen, while nothing or something moved; "stopped": a stall ended a motion and
            the run did not go on; "other": the goal was missed for another reason.
        why: That in words.
        seconds: Wall time in [s].
    """

    task: str
    seed: int
    reached: bool
    stalls: int
    stopped_motions: int
    ended: str
    why: str
    seconds: float


class Stalls:
    """Stops client, cell or both of the episode below this process, on a thread, until it is closed.

    Args:
        seed: Of pauses, lengths and who is hit.

    Attributes:
        count: Stalls so far.
    """

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)
        self._ended = threading.Event()
        self.count = 0
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stall nobody any more."""
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._ended.wait(self._random.uniform(*PAUSE)):
            length, whom = self._random.uniform(*LENGTH), self._random.choice(WHOM)
            client, cell = _below(os.getpid(), CLIENT), _below(os.getpid(), CELL)
            pids = [*(client if whom != "cell" else []), *(cell if whom != "client" else [])]
            if not pids:
                continue
            _send(pids, signal.SIGSTOP)
            self.count += 1
            self._ended.wait(length)
            _send(pids, signal.SIGCONT)


def _send(pids: Sequence[int], number: signal.Signals) -> None:
    for pid in pids:
        with suppress(ProcessLookupError):
            os.kill(pid, number)


def _below(root: int, words: str) -> list[int]:
    """Processes below one whose command line has these words."""
    parents, commands = {}, {}
    for entry in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # ended meanwhile
            parents[int(entry.name)] = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            commands[int(entry.name)] = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
    found, grown = [], {root}
    while grown:
        grown = {pid for pid, parent in parents.items() if parent in grown}
        found += grown
    return [pid for pid in found if words in commands.get(pid, "")]


def judge(record: EpisodeRecord, events: Sequence[dict[str, Any]], stalls: int) -> StalledEpisode:
    """What became of an episode, from its record and the events of its run.

    Args:
        stalls: How often its processes were stopped.
    """
    stopped = sum(e["event"] == "executed" and e.get("reason") in STALLED for e in events)
    names = [e["event"] for e in events]
    sent = len(names) - 1 - names[::-1].index("trajectory") if "trajectory" in names else -1
    moving = sent >= 0 and not {"executed", "refused"} & set(names[sent:])
    ended = ""
    if not record.success:
        ended = "other"
        if record.cause in LINK_ERRORS or "frozen" in record.why:
            ended = "moving" if moving else "at rest"
        if record.cause == "StoppedError" and any(f"({code})" in record.why for code in STALLED):
            ended = "stopped"
    return StalledEpisode(
        task=record.job["task"],
        seed=record.job["seed"],
        reached=record.success,
        stalls=stalls,
        stopped_motions=stopped,
        ended=ended,
        why="" if record.success else f"{record.cause}: {record.why}",
        seconds=record.wall_s,
    )


def run_stalled(job: Job, setup: Setup, folder: Path) -> StalledEpisode:
    """One episode, stalled by a plan that its task and seed give."""
    stalls = Stalls(random.Random(job.name).randrange(2**31))
    try:
        record = run_job(job, setup, folder)
    finally:
        stalls.close()
    return judge(record, events_of(folder / record.folder) if record.folder else [], stalls.count)


def as_json(episodes: Sequence[StalledEpisode], busy: int) -> dict[str, Any]:
    """As one JSON object."""
    ended = Counter(e.ended for e in episodes)
    return {
        "episodes": len(episodes),
        "busy": busy,
        "reached": sum(e.reached for e in episodes),
        "stalls": sum(e.stalls for e in episodes),
        "ended_at_rest": ended["at rest"],
        "ended_moving": ended["moving"],
        "stopped_for_good": ended["stopped"],
        "motions_stopped_and_gone_on": sum(e.stopped_motions for e in episodes) - ended["stopped"],
        "each": [asdict(e) for e in episodes],
    }


def as_text(figures: dict[str, Any]) -> str:
    """As a table."""
    lines = [f"{'task':20} {'seed':>5} {'reached':>8} {'stalls':>7} {'stopped':>8} {'ended':>8} {'s':>6}"]
    for e in figures["each"]:
        word = "yes" if e["reached"] else "NO"
        lines.append(
            f"{e['task']:20} {e['seed']:>5} {word:>8} {e['stalls']:>7} {e['stopped_motions']:>8} {e['ended']:>8} "
            f"{e['seconds']:>6.0f}"
        )
        lines += [f"    {e['why']}"] if e["why"] else []
    lines.append(
        f"{figures['reached']} of {figures['episodes']} reached through {figures['stalls']} stalls beside "
        f"{figures['busy']} busy processes; ended by link or freeze while nothing moved: {figures['ended_at_rest']}, "
        f"while something moved: {figures['ended_moving']}; motions that came to rest on their path and were gone on "
        f"with: {figures['motions_stopped_and_gone_on']}, that ended the run: {figures['stopped_for_good']}"
    )
    return "\n".join(lines)


def main() -> int:
    """Run the episodes, print the figures; 1 when a link or a freeze ended one while nothing moved."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=[201, 202])
    parser.add_argument("--tasks", nargs="*", default=[])
    parser.add_argument("--busy", type=int, default=4)
    parser.add_argument("--folder", type=Path, default=None, help="keep the runs here")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    names = [task_named(name).name for name in options.tasks] or list(TASKS)
    jobs = [Job(name, seed, variant_from("full")) for name in names for seed in options.seeds]
    setup = setup_now(ReasonerOptions(), "default", "default", TIME_LIMIT)
    episodes = []
    with tempfile.TemporaryDirectory() as temporary, load(options.busy):
        for job in jobs:
            begun = time.monotonic()
            episodes.append(run_stalled(job, setup, options.folder or Path(temporary)))
            word = "reached" if episodes[-1].reached else f"NOT reached ({episodes[-1].why})"
            print(f"{job.task} seed {job.seed}: {word}, {time.monotonic() - begun:.0f} s", file=sys.stderr, flush=True)
    figures = as_json(episodes, options.busy)
    print(json.dumps(figures, indent=1) if options.json else as_text(figures))
    return int(figures["ended_at_rest"] > 0)


if __name__ == "__main__":
    sys.exit(main())
