"""Runs the jobs of a folder that have no record yet, each in a process of its own."""

import os
import shutil
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from functools import partial
from pathlib import Path

from pydantic import ValidationError

from replan.progress import Progress
from replan.rc.episode import told
from replan.rc.folder import RcFolder
from replan.rc.isolation import Outcome, run_isolated
from replan.rc.jobs import Job
from replan.rc.records import EpisodeRecord, Setup
from replan_base.processes import python_module

Work = Callable[[Job], EpisodeRecord]
Backend = Callable[[Sequence[Job], Work], Iterator[tuple[Job, EpisodeRecord]]]


def run_jobs(folder: RcFolder, setup: Setup, jobs: Sequence[Job], backend: Backend, say: Callable[[str], None]) -> int:
    """Run what has not been run yet; each record is on disk as soon as its episode ends.

    Args:
        folder: Prepared for this setup.
        setup: With what.
        jobs: Which.
        backend: Where: `local_backend` with its number of workers, or another.
        say: Progress.

    Returns:
        How many were run.

    Raises:
        ConfigError: A job was run with another configuration.
        KeyboardInterrupt: Passed on after everything that was started has been ended.
    """
    left = [job for job in jobs if not folder.done(job, setup)]
    if len(left) < len(jobs):
        say(f"{len(jobs) - len(left)} of {len(jobs)} episodes were run before")
    if not left:
        return 0
    with Progress("episode", len(left), say) as progress:
        for job, record in backend(left, partial(run_job, setup=setup, folder=folder.path)):
            folder.write(job, record)
            word = "success" if record.success else f"FAILED ({record.cause}: {record.why})"
            progress.step(f"{job.task} seed {job.seed}, {job.variant.name}: {word}, {record.wall_s:.0f} s")
    return len(left)


def run_job(job: Job, setup: Setup, folder: Path, stop: threading.Event | None = None) -> EpisodeRecord:
    """One episode in a process of its own; a hung or crashed one is a failed one, with its cause.

    Args:
        job, setup: What to run.
        folder: The benchmark's folder; the run's folder is made anew in `runs/JOB` of it.
        stop: Ends the episode early.

    Raises:
        Interrupted: `stop` was set.
    """
    import json

    runs_dir = folder.absolute() / "runs" / job.name
    shutil.rmtree(runs_dir, ignore_errors=True)  # what an interrupted try left
    command = python_module("replan.rc.episode", "--parent-pid", str(os.getpid()))
    given = json.dumps({"job": job.as_json(), "setup": setup.as_json(), "runs_dir": str(runs_dir)})
    # One thread a process: episodes share the machine's cores, and equal seeds should give equal episodes.
    environment = {"OMP_NUM_THREADS": "1", **os.environ}
    outcome = run_isolated(command, given, setup.time_limit_s, stop, environment)
    record = _record_of(outcome) or EpisodeRecord(
        setup=setup.as_json(),
        job=job.as_json(),
        ended="timed_out" if outcome.ended == "timed_out" else "crashed",
        cause=_cause(outcome),
        why=_why(outcome, setup.time_limit_s),
        **told(runs_dir),
    )
    return record.model_copy(update={"wall_s": round(outcome.seconds, 2)})


def _record_of(outcome: Outcome) -> EpisodeRecord | None:
    if outcome.ended != "done":
        return None
    try:
        return EpisodeRecord.model_validate_json(outcome.out)
    except ValidationError:
        return None  # it printed something else: as bad as a crash


def _cause(outcome: Outcome) -> str:
    return "timed_out" if outcome.ended == "timed_out" else "crashed"


def _why(outcome: Outcome, limit_s: float) -> str:
    last = (outcome.errors.strip().splitlines() or ["it said nothing"])[-1]
    if outcome.ended == "timed_out":
        return f"not at an end after {limit_s:g} s; it said last: {last}"
    how = f"signal {-outcome.code}" if outcome.code < 0 else f"exit code {outcome.code}"
    return f"the episode's process ended with {how}; it said last: {last}"


def local_backend(workers: int) -> Backend:
    """Runs jobs on this machine, some at a time."""

    def run(jobs: Sequence[Job], work: Work) -> Iterator[tuple[Job, EpisodeRecord]]:
        stop = threading.Event()
        with ThreadPoolExecutor(workers) as pool:
            futures = {pool.submit(work, job, stop=stop): job for job in jobs}  # pyright: ignore[reportCallIssue]
            try:
                for future in as_completed(futures):
                    yield futures[future], future.result()
            except BaseException:
                # Also GeneratorExit: whoever asked for records does not want more of them.
                stop.set()
                pool.shutdown(wait=False, cancel_futures=True)
                raise

    return run
