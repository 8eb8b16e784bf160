"""The benchmark's machinery: lists of jobs, folders that are taken up again, processes that hang, counts, the page."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from control.errors import ConfigError
from planning.reasoners.options import ReasonerOptions
from replan.rc.bench import RcOptions, report_on, run_benchmark
from replan.rc.episode import options_of
from replan.rc.folder import RcFolder
from replan.rc.isolation import Interrupted, run_isolated
from replan.rc.jobs import Job, jobs_text, make_jobs, shard_of
from replan.rc.paper import AVERAGES, published, published_average
from replan.rc.ray_backend import ray_backend
from replan.rc.records import EpisodeAction, EpisodeRecord, Setup
from replan.rc.results import summarise
from replan.rc.runner import local_backend, run_job, run_jobs
from replan.rc.tasks import TASKS
from replan.rc.text import results_text
from replan.rc.variants import Variant, variant_from
from replan.run.stopwatch import PARTS, Stopwatch
from sim_check.cells.loading import load_cell
from tests.support.waiting import until

BUILTIN = {"backend": "builtin"}
SETUP = Setup(BUILTIN, "default", "default", 60.0, version="0", code="abc")
FULL = variant_from("full")


def record_of(job: Job, success: bool = True, **changes) -> EpisodeRecord:
    parts = dict.fromkeys(PARTS, 1.0) | {"planning": 0.5}
    actions = tuple(
        EpisodeAction(action="open door", kind="hands", ok=k > 0, cause=None if k else "locked") for k in range(2)
    )
    base = EpisodeRecord(
        setup=SETUP.as_json(),
        job=job.as_json(),
        success=success,
        claimed=success,
        cause="" if success else "locked",
        why="" if success else "the door is <locked>",
        actions=actions,
        plans=(("open door",),),
        seconds=20.0,
        seconds_by_part=parts,
        reasoner="rules",
        questions=12,
        tokens=2000,
        cost=0.25,
        perception="colours",
    )
    return base.model_copy(update=changes)


# -- jobs and variants -------------------------------------------------------------------------------------------------


def test_every_job_belongs_to_exactly_one_shard_and_shards_are_of_one_size():
    jobs = make_jobs((), 10, [FULL, variant_from("no-replan")])
    shards = [shard_of(jobs, f"{k}/7") for k in range(1, 8)]
    assert sorted(j.name for shard in shards for j in shard) == sorted(j.name for j in jobs)
    assert len(jobs) == 160 and {len(s) for s in shards} <= {22, 23}
    assert all(len({j.task for j in shard}) > 5 for shard in shards), "no machine gets one task only"
    assert [j for j in jobs if j in shards[2]] == list(shards[2]), "in the list's order"


@pytest.mark.parametrize("shard", ["0/3", "4/3", "2", "a/b", "1/0", ""])
def test_a_shard_that_is_none_is_refused(shard):
    with pytest.raises(ConfigError, match=r"is not K/N with K from 1 to N, for instance 2/8"):
        shard_of(make_jobs((), 1, [FULL]), shard)


def test_a_list_of_jobs_reads_back_as_it_was_written():
    jobs = make_jobs(("cubes-color",), 2, [variant_from("no-verifier+true-poses+answer-noise=0.2")])
    lines = jobs_text(jobs).splitlines()
    assert json.loads(lines[1])["variant"] == {
        "name": "no-verifier+true-poses+answer-noise=0.2",
        "without": ["verifier"],
        "method": "replan",
        "poses": "true",
        "answer_noise": 0.2,
    }
    assert tuple(Job.from_json(json.loads(line)) for line in lines) == jobs


def test_variants_are_named_by_what_differs_from_the_method():
    assert variant_from("full", "true", 0.1).name == "full+true-poses+answer-noise=0.1"
    assert variant_from("pddl") == Variant("pddl", method="pddl")
    for text, why in (
        ("fully", "no variant 'fully'; it has: full, no-verifier"),
        ("full+poses", "'poses' is not known; there are: true-poses, answer-noise=SHARE"),
        ("full+answer-noise=x", "a share from 0 to 1, not 'x'"),
        ("full+answer-noise=2", "a share from 0 to 1, not 2"),
    ):
        with pytest.raises(ConfigError, match=why.replace("+", r"\+")):
            variant_from(text)


def test_what_cannot_be_run_is_said_before_anything_runs():
    for arguments, why in (
        ((("cabinet",), 1, [FULL]), "no task 'cabinet'; it has: cabinet-open, "),
        (((), 0, [FULL]), "--runs must be at least 1, not 0"),
        (((), 1, []), "no variant to run; say --variants full"),
        (((), 1, [FULL, FULL]), "variant 'full' is named twice"),
    ):
        with pytest.raises(ConfigError, match=why):
            make_jobs(*arguments)


def test_the_tasks_are_the_papers_and_their_cells_have_what_they_name():
    assert len(TASKS) == 8
    for task in TASKS.values():
        cell = load_cell(task.cell)
        assert set(task.needed) <= set(cell.objects), task.name
    for variant in ("full", "no-perceiver", "no-replan", "language-to-rewards"):
        assert np.mean([published(variant, t) for t in TASKS]) == pytest.approx(AVERAGES[variant])  # type: ignore
    assert published("pddl", "cabinet-open") is None and published_average("pddl", TASKS) is None
    assert published_average("full", TASKS) == 86.25, "as printed"
    assert published_average("full", ["cabinet-blocked", "cubes-color"]) == 75.0


# -- the folder --------------------------------------------------------------------------------------------------------


def test_a_folder_is_taken_up_where_it_was_left(tmp_path):
    jobs = make_jobs(("cubes-color", "cubes-blocked"), 3, [FULL])
    folder = RcFolder(tmp_path / "rc")
    ran: list[str] = []

    def backend(left, work):
        for job in left:
            if len(ran) == 2:
                raise KeyboardInterrupt
            ran.append(job.name)
            yield job, record_of(job)

    folder.prepare(SETUP, jobs)
    with pytest.raises(KeyboardInterrupt):
        run_jobs(folder, SETUP, jobs, backend, lambda _: None)
    first = list(ran)
    (folder.path / "episodes" / f".{jobs[3].name}.json.77.part").write_text('{"setup"')  # killed while writing
    ran.clear()
    again = RcFolder(tmp_path / "rc")
    again.prepare(SETUP, jobs)
    run_jobs(again, SETUP, jobs, lambda left, work: ((j, record_of(j)) for j in left if not ran.append(j.name)), print)
    assert not set(first) & set(ran) and len(first) + len(ran) == 6
    assert len(again.records()) == 6
    assert len((again.path / "jobs.jsonl").read_text().splitlines()) == 6


def test_another_configuration_is_refused_and_what_differs_is_named(tmp_path):
    jobs = make_jobs(("cubes-color",), 1, [FULL])
    folder = RcFolder(tmp_path / "rc")
    folder.prepare(SETUP, jobs)
    folder.write(jobs[0], record_of(jobs[0]))
    other = replace(SETUP, reasoner={"backend": "openai"}, code="xyz")
    with pytest.raises(ConfigError, match=r"reasoner is \{'backend': 'builtin'\} there and .*, code is 'abc' there"):
        folder.prepare(other, jobs)
    with pytest.raises(ConfigError, match="choose another --folder, or say --report-only"):
        folder.done(jobs[0], other)
    second = make_jobs(("cubes-color",), 2, [FULL])[1]
    folder.write(second, record_of(second, setup=other.as_json()))
    with pytest.raises(ConfigError, match=r"cannot be counted together: reasoner is \{'backend': 'openai'\} there"):
        folder.records()


def test_folders_and_files_of_others_are_left_alone(tmp_path):
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(ConfigError, match=r"holds other files and no setup\.json of this benchmark"):
        RcFolder(tmp_path).prepare(SETUP, ())
    with pytest.raises(ConfigError, match="has no episodes; run `replan bench rc"):
        report_on(tmp_path)
    folder = RcFolder(tmp_path / "rc")
    job = make_jobs(("cubes-color",), 1, [FULL])[0]
    folder.prepare(SETUP, [job])
    folder.episode_file(job).write_text('{"setup": {}}')
    with pytest.raises(ConfigError, match="is not an episode of this benchmark"):
        folder.done(job, SETUP)


def test_two_runners_do_not_share_a_shard(tmp_path):
    folder, other = RcFolder(tmp_path / "rc"), RcFolder(tmp_path / "rc")
    folder.prepare(SETUP, ())
    folder.claim("1/2")
    other.claim("2/2")
    with pytest.raises(ConfigError, match=r"another process is running shard 1/2"):
        other.claim("1/2")
    folder.close()
    other.claim("1/2")
    other.close()


# -- processes ---------------------------------------------------------------------------------------------------------

HANGS = """
import subprocess, sys, time
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"], start_new_session=True)
print(child.pid, flush=True)
print("waiting for the door", file=sys.stderr, flush=True)
time.sleep(600)
"""


def runs(pid: int) -> bool:
    """Whether a process runs and is not only waiting to be forgotten."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def gone(pid: int) -> bool:
    return until(lambda: not runs(pid))


def test_a_program_that_hangs_is_ended_with_everything_that_it_started(tmp_path, monkeypatch):
    ready = tmp_path / "ready"

    def clock() -> float:
        """The program's time is over as soon as its child runs and it has said what it waits for."""
        return time.monotonic() + (1000.0 if ready.exists() else 0.0)

    monkeypatch.setattr("replan.rc.isolation.time", SimpleNamespace(monotonic=clock))
    program = HANGS.replace("time.sleep(600)\n", f"open({str(ready)!r}, 'w').close()\ntime.sleep(600)\n")
    outcome = run_isolated([sys.executable, "-c", program], "", limit_s=900.0)
    assert outcome.ended == "timed_out" and "waiting for the door" in outcome.errors
    assert gone(int(outcome.out)), "its child lives in a session of its own"


def test_a_program_that_dies_is_told_from_one_that_ends():
    assert run_isolated([sys.executable, "-c", "print(input())"], "hello", 600).out == "hello\n"
    died = run_isolated([sys.executable, "-c", "import os; os.kill(os.getpid(), 9)"], "", 600)
    assert (died.ended, died.code) == ("crashed", -9)


def test_an_interrupted_program_is_ended():
    stop = threading.Event()
    threading.Timer(0.6, stop.set).start()
    with pytest.raises(Interrupted):
        run_isolated([sys.executable, "-c", HANGS], "", 600, stop)


def test_an_episode_over_its_time_is_a_failed_one_with_its_cause(tmp_path):
    job = make_jobs(("cubes-color",), 1, [FULL])[0]
    record = run_job(job, replace(SETUP, time_limit_s=0.3), tmp_path)
    assert (record.ended, record.success, record.cause) == ("timed_out", False, "timed_out")
    assert record.why.startswith("not at an end after 0.3 s")


def test_an_episode_that_crashes_is_a_failed_one_with_the_last_that_it_said(tmp_path):
    job = replace(make_jobs(("cubes-color",), 1, [FULL])[0], task="no-such-task")
    record = run_job(job, SETUP, tmp_path)
    assert (record.ended, record.success, record.cause) == ("crashed", False, "crashed")
    assert "exit code 1" in record.why and "no task 'no-such-task'" in record.why


def test_an_episodes_process_ends_when_its_runner_is_killed():
    runner = (
        "import subprocess, sys, os, time\n"
        "p = subprocess.Popen([sys.executable, '-m', 'replan.rc.episode', '--parent-pid', str(os.getpid())], "
        "stdin=subprocess.PIPE, start_new_session=True)\n"
        "print(p.pid, flush=True)\ntime.sleep(600)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", runner], stdout=subprocess.PIPE, text=True, cwd=Path.cwd())
    assert process.stdout is not None
    episode = int(process.stdout.readline())
    assert runs(episode)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert gone(episode)


def test_local_workers_hand_out_every_record_and_stop_when_asked():
    jobs = make_jobs((), 1, [FULL])

    def work(job: Job, stop: threading.Event) -> EpisodeRecord:
        return record_of(job)

    assert {j.name for j, _ in local_backend(3)(jobs, work)} == {j.name for j in jobs}  # type: ignore[arg-type]
    stopped: list[bool] = []

    def slow(job: Job, stop: threading.Event) -> EpisodeRecord:
        if job == jobs[0]:
            return record_of(job)
        stopped.append(stop.wait(10))
        raise Interrupted("told to stop")

    records = local_backend(2)(jobs, slow)  # type: ignore[arg-type]
    next(records)
    records.close()  # type: ignore[attr-defined]
    assert stopped and all(stopped) and len(stopped) < len(jobs) - 1


class RayDouble:
    """A double of the module ray: runs each task when it is waited for, and notes what was asked of it."""

    def __init__(self) -> None:
        self.asked: dict = {}
        self.cancelled: list = []

    def remote(self, **options):
        self.asked = options
        double = self

        class Remote:
            def __init__(self, function) -> None:
                self.function = function

            def remote(self, *arguments):
                return partial(self.function, *arguments)

        assert double.asked
        return Remote

    def wait(self, tasks, num_returns):
        return tasks[:num_returns], tasks[num_returns:]

    def get(self, task):
        return task()

    def cancel(self, task) -> None:
        self.cancelled.append(task)


def test_a_cluster_runs_every_job_on_a_core_of_its_own_and_forgets_what_is_not_wanted_any_more():
    jobs, ray = make_jobs((), 1, [FULL]), RayDouble()
    assert {j.name for j, r in ray_backend(ray)(jobs, record_of) if r.success} == {j.name for j in jobs}
    assert ray.asked == {"num_cpus": 1, "max_retries": 2} and not ray.cancelled
    records = ray_backend(ray)(jobs, record_of)
    next(records)
    records.close()  # type: ignore[attr-defined]
    assert len(ray.cancelled) == len(jobs) - 1


# -- counts and the page -----------------------------------------------------------------------------------------------


def ten_episodes(successes: int) -> list[EpisodeRecord]:
    jobs = make_jobs(("cabinet-closed",), 10, [FULL])
    return [record_of(job, success=k < successes) for k, job in enumerate(jobs)]


# Wilson 95 % intervals of k out of 10, computed from the closed formula with z = 1.959964.
@pytest.mark.parametrize(
    ("successes", "low", "high"), [(10, 0.7225, 1.0), (9, 0.5958, 0.9821), (5, 0.2366, 0.7634), (0, 0.0, 0.2775)]
)
def test_rates_come_with_wilson_intervals(successes, low, high):
    (result,) = summarise(ten_episodes(successes))
    task = result.as_json()["tasks"]["cabinet-closed"]
    assert (task["runs"], task["success"]) == (10, successes)
    assert task["success_interval"] == pytest.approx([low, high], abs=1e-4)
    assert task["causes"] == ({"locked": 10 - successes} if successes < 10 else {})
    assert (task["questions_mean"], task["tokens_mean"], task["cost_mean"]) == (12, 2000, 0.25)
    assert task["planner_s_per_step_median"] == pytest.approx(0.25), "half a second over two actions"


def test_the_average_is_over_tasks_and_claims_are_counted_apart():
    claimed = record_of(make_jobs(("cubes-color",), 1, [FULL])[0], success=False, claimed=True, cause="claimed_wrongly")
    (result,) = summarise([*ten_episodes(8), claimed])
    assert result.average == pytest.approx(0.4)
    assert result.tasks["cubes-color"].as_json()["claimed"] == 1
    text = results_text([result])
    assert "8/10" in text and "average of 2 tasks" in text and "claimed_wrongly 1" in text
    assert "Cabinet-Closed" in text and "49..94" in text


def test_an_episode_that_was_killed_counts_as_failed_and_has_no_say_in_times_by_part():
    job = make_jobs(("cabinet-closed",), 11, [FULL])[-1]
    killed = EpisodeRecord(setup=SETUP.as_json(), job=job.as_json(), ended="timed_out", cause="timed_out", wall_s=60.0)
    (result,) = summarise([*ten_episodes(10), killed])
    task = result.tasks["cabinet-closed"]
    assert (task.runs, task.success, task.causes) == (11, 10, {"timed_out": 1})
    assert task.seconds_by_part["planning"] == pytest.approx(0.5)


def test_the_page_shows_every_episode_and_reaches_for_nothing_beside_its_folder(tmp_path):
    import cv2

    jobs = make_jobs(("cabinet-closed", "cubes-color"), 2, [FULL, variant_from("no-replan")])
    folder = RcFolder(tmp_path / "rc")
    folder.prepare(SETUP, jobs)
    for k, job in enumerate(jobs):
        run = folder.runs_dir(job) / "2026"
        run.mkdir(parents=True)
        cv2.imwrite(str(run / "strip.png"), np.full((300, 1920, 3), 30 * k, np.uint8))
        folder.write(job, record_of(job, success=k != 1, folder=run.relative_to(folder.path).as_posix()))
    report = report_on(folder.path)
    page = report.page.read_text()
    assert page.count("<h3>") == len(jobs) and page.count('class="card failed"') == 1
    assert "the door is &lt;locked&gt;" in page and "100 %" in page and "Cabinet-Closed" in page
    links = {part.split('"')[0] for tag in ('src="', 'href="') for part in page.split(tag)[1:]}
    links = {link for link in links if not link.startswith("#")}
    assert len(links) == 2 * len(jobs) and all((folder.path / link).exists() for link in links)
    assert json.loads((folder.path / "results.json").read_text())["variants"][0]["tasks"]["cubes-color"]["runs"] == 2


def test_every_second_belongs_to_one_part():
    now = [0.0]
    watch = Stopwatch(lambda: now[0])

    def passes(seconds: float) -> None:
        now[0] += seconds

    passes(1.0)
    with watch.part("search"):
        passes(2.0)
        with watch.part("verdict"):
            passes(4.0)
        passes(8.0)
    passes(16.0)
    seconds = watch.seconds
    assert (seconds["planning"], seconds["search"], seconds["verdict"]) == (17.0, 10.0, 4.0)
    assert sum(seconds.values()) == now[0]


def test_episodes_do_not_write_into_one_cassette(tmp_path):
    recording = ReasonerOptions(record_cassette=tmp_path / "all.jsonl")
    options = RcOptions(1, ("cubes-color",), (FULL,), tmp_path / "rc", reasoner=recording)
    with pytest.raises(ConfigError, match=r"cannot share --record-cassette; the events.jsonl of each run"):
        run_benchmark(options, local_backend(1), print)
    assert not (tmp_path / "rc").exists()


def test_a_job_asks_its_run_for_what_its_variant_says(tmp_path):
    job = make_jobs(("kitchen-explore",), 4, [variant_from("no-replan+true-poses+answer-noise=0.2")])[3]
    played = replace(SETUP, reasoner={"backend": "cassette", "cassette": "a.jsonl", "noise_roles": ["planner"]})
    options = options_of(job, played, tmp_path)
    assert (options.goal, options.cell, options.seed, options.speed) == ("find the green apple", job.task, 3, 0.0)
    assert (options.without, options.poses, options.score, options.video) == (("replan",), "true", True, False)
    assert options.reasoner == ReasonerOptions(
        "cassette", cassette=Path("a.jsonl"), noise=0.2, noise_roles=("planner",)
    )
