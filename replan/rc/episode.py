"""One episode in this process: a goal in a simulated cell of its own, scored on the cell's truth.

    echo '{"job": {...}, "setup": {...}, "runs_dir": "..."}' | python -m replan.rc.episode --parent-pid PID

prints the episode's record as one JSON object. A runner starts one such process an episode, so that whatever happens
in one stays there.
"""

import argparse
import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from replan.rc.jobs import Job
from replan.rc.records import ROOT, EpisodeAction, EpisodeRecord, Setup
from replan.rc.tasks import RcTask, task_named
from replan_base.errors import ReplanError

if TYPE_CHECKING:
    from hw_interface.cell.client import CellClient
    from perception.ground_truth import CellTruth
    from planning.reasoners.options import ReasonerOptions
    from replan.run.options import RunOptions
    from replan.run.report import RunReport


def options_of(job: Job, setup: Setup, runs_dir: Path) -> "RunOptions":
    """What a job asks of a run whose folder is made in `runs_dir`."""
    from replan.run.options import RunOptions

    task = task_named(job.task)
    return RunOptions(
        task.goal,
        cell=task.cell,
        seed=job.seed,
        speed=0.0,
        detector=setup.detector,
        segmenter=setup.segmenter,
        reasoner=_reasoner(setup, job.variant.answer_noise),
        runs_dir=runs_dir,
        video=False,
        go_on_after_stall=True,  # the cell is simulated; what this machine does beside it is no part of the task
        score=True,
        without=job.variant.without,
        method=job.variant.method,
        poses=job.variant.poses,
    )


def _reasoner(setup: Setup, noise: float) -> "ReasonerOptions":
    from planning.reasoners.options import ReasonerOptions

    chosen: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in setup.reasoner.items()}
    if "cassette" in chosen:
        chosen["cassette"] = Path(chosen["cassette"])
    return ReasonerOptions(**chosen, noise=noise)


def run_episode(job: Job, setup: Setup, runs_dir: Path) -> EpisodeRecord:
    """Run and score one episode; a run that ends with one of the program's own errors is a failed episode.

    Args:
        job: Which.
        setup: With what.
        runs_dir: The run's folder is made in it.
    """
    from replan.rc.ending import events_of
    from replan.run.goal import run_goal

    truths: dict[str, CellTruth] = {}
    shown: dict[str, int] = {}

    def note_truth(when: str, client: "CellClient") -> None:
        truths[when] = client.truth()
        if when == "after":
            shown.update(_shown(client))

    common: dict[str, Any] = {"setup": setup.as_json(), "job": job.as_json(), "commit": commit()}
    options = options_of(job, setup, runs_dir)
    try:
        report = run_goal(options, lambda text: print(text, file=sys.stderr, flush=True), note_truth)
    except ReplanError as error:
        name = type(error).__name__
        return EpisodeRecord(**common, cause=name, why=str(error), reason=str(error), **told(runs_dir))
    common |= told(runs_dir)
    return _scored(task_named(job.task), report, truths, shown, common, events_of(report.folder))


def _scored(
    task: RcTask,
    report: "RunReport",
    truths: "dict[str, CellTruth]",
    shown: dict[str, int],
    common: dict[str, Any],
    events: list[dict[str, Any]],
) -> EpisodeRecord:
    from replan.rc.ending import Ending, last_estimates
    from replan.rc.scoring import harm
    from sim_check.cells.loading import load_cell
    from sim_check.furniture.build import furniture_model

    furniture = {name: furniture_model(name, config) for name, config in load_cell(task.cell).furniture.items()}
    ending = Ending(truths["before"], truths["after"], furniture, report.reached, last_estimates(events), shown)
    short, harmed = task.scorer(ending), harm(ending.before, ending.after, task.needed)
    data = report.as_json()
    return EpisodeRecord(
        **common,
        success=not short and not harmed,
        claimed=report.reached,
        cause=_cause(short, harmed, report),
        why="; ".join([*([short] if short else []), *harmed]),
        reason=report.reason,
        harmed=harmed,
        actions=tuple(EpisodeAction(**a) for a in data["actions"]),
        motions=report.motions,
        replans=report.replans,
        simulated_steps=report.steps,
        seconds=report.seconds,
        seconds_by_part=data["seconds_by_part"],
        reasoner=report.reasoner,
        perception=report.detector,
    )


def _cause(short: str, harmed: tuple[str, ...], report: "RunReport") -> str:
    """The failure in one word: what the run wrongly claims, what it harmed, or the last failure that it met."""
    if not short:
        return "harm" if harmed else ""
    if report.reached:
        return "claimed_wrongly"
    causes = [a.cause.kind for a in report.actions if a.cause is not None]
    return causes[-1] if causes else "no_plan"


def told(runs_dir: Path) -> dict[str, Any]:
    """What the record of the only run in a folder tells, however the run ended: its plans, how much was asked."""
    from replan.rc.ending import events_of

    folder = next((p for p in sorted(runs_dir.glob("*")) if (p / "events.jsonl").is_file()), None)
    if folder is None:
        return {}
    events = events_of(folder)
    used = next((e["total"] for e in reversed(events) if e["event"] == "reasoner_usage"), None)
    taken = {} if used is None else {"tokens": used["tokens_in"] + used["tokens_out"], "cost": used["cost"]}
    return taken | {
        "folder": folder.relative_to(runs_dir.parents[1]).as_posix(),
        "plans": tuple(tuple(e["steps"]) for e in events if e["event"] == "plan"),
        "questions": sum(e["event"] == "prompt" for e in events),
    }


def _shown(client: "CellClient") -> dict[str, int]:
    """Pixels of each thing in the camera that shows most of it."""
    most: dict[str, int] = {}
    for camera in client.cameras():
        for thing in client.frame_truth(camera).objects:
            assert thing.mask is not None  # a simulated cell always says
            most[thing.name] = max(most.get(thing.name, 0), int(thing.mask.sum()))
    return most


def commit() -> str | None:
    """The commit that this program was taken from, with "+" after it where files were changed; None where unknown."""
    if not (ROOT / ".git").exists():
        return None  # installed; a repository further up is another project's
    try:
        call = ("git", "-C", str(ROOT), "describe", "--always", "--dirty=+", "--abbrev=12", "--exclude=*")
        done = subprocess.run(call, capture_output=True, text=True, timeout=10)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() or None if done.returncode == 0 else None


def _end_with(parent: int) -> None:
    """End this process at once when its parent is gone, so that a runner that was killed leaves nothing running."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def main() -> None:
    """Read what to do from stdin, print the record."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--parent-pid", type=int, default=None)
    parent = parser.parse_args().parent_pid
    if parent is not None:
        _end_with(parent)
    asked = json.load(sys.stdin)
    record = run_episode(Job.from_json(asked["job"]), Setup(**asked["setup"]), Path(asked["runs_dir"]))
    print(record.model_dump_json())


if __name__ == "__main__":
    main()
