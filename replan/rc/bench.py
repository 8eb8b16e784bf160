"""The whole benchmark: run what is missing, count, write the report."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from control.errors import ConfigError
from perception.options import PerceptionModels
from planning.reasoners.options import ReasonerOptions
from replan.rc.folder import RcFolder, write_whole
from replan.rc.jobs import make_jobs, shard_of
from replan.rc.records import setup_now
from replan.rc.results import VariantResult, summarise
from replan.rc.runner import Backend, run_jobs
from replan.rc.variants import Variant


@dataclass(frozen=True)
class RcOptions(PerceptionModels):
    """What to run; the fields are explained by `replan bench rc --help`."""

    runs: int
    tasks: tuple[str, ...]
    variants: tuple[Variant, ...]
    folder: Path
    shard: str = "1/1"
    reasoner: ReasonerOptions = field(default_factory=ReasonerOptions)
    time_limit_s: float = 900.0


@dataclass(frozen=True)
class RcReport:
    """Everything that a folder holds, counted.

    Attributes:
        results: By variant.
        page: The report.
    """

    results: tuple[VariantResult, ...]
    page: Path

    def as_json(self) -> dict[str, Any]:
        """As one JSON object."""
        return {"variants": [r.as_json() for r in self.results], "report": str(self.page)}

    def as_text(self) -> str:
        """As tables."""
        from replan.rc.text import results_text

        return f"{results_text(self.results)}\n\nreport: {self.page}"


def run_benchmark(options: RcOptions, backend: Backend, say: Callable[[str], None]) -> RcReport:
    """Run the episodes that the folder has no record of yet, and report on all that it has.

    Args:
        options: What to run.
        backend: Where to.
        say: Progress.

    Raises:
        ConfigError: The options are not valid or not available, or the folder holds something else.
        KeyboardInterrupt: Passed on; what was run is kept, and the same command goes on from there.
    """
    setup = setup_now(options.reasoner, options.detector, options.segmenter, options.time_limit_s)
    jobs = make_jobs(options.tasks, options.runs, options.variants)
    mine = shard_of(jobs, options.shard)
    if options.reasoner.record_cassette is not None:
        raise ConfigError("episodes cannot share --record-cassette; the events.jsonl of each run is a cassette")
    _require_available(options.variants, jobs, setup)
    folder = RcFolder(options.folder)
    folder.prepare(setup, jobs)
    folder.claim(options.shard)
    try:
        run_jobs(folder, setup, mine, backend, say)
    except KeyboardInterrupt:
        done = sum(folder.episode_file(job).exists() for job in mine)
        say(f"{done} of {len(mine)} episodes are in {options.folder}; the same command again goes on from there")
        raise
    finally:
        folder.close()
    return report_on(options.folder)


def _require_available(variants: Sequence[Variant], jobs, setup) -> None:
    """Refuse at once what every episode would refuse."""
    from replan.rc.episode import options_of
    from replan.run.method_choice import check_variant

    for variant in variants:
        job = next(job for job in jobs if job.variant == variant)
        check_variant(options_of(job, setup, Path()))


def report_on(path: Path) -> RcReport:
    """Count what a folder holds, write results.json and report.html into it.

    Raises:
        ConfigError: It holds no episodes, or such of several configurations.
    """
    from replan.rc.report import write_report

    records = RcFolder(path).records()
    results = summarise(records)
    page = write_report(path, records, results)
    report = RcReport(results, page)
    write_whole(path / "results.json", json.dumps(report.as_json(), indent=1) + "\n")
    return report
