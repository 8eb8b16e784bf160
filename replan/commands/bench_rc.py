"""`replan bench rc`: the paper's eight tasks."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from perception.options import PerceptionModels
from replan.commands.reasoner_flags import ReasonerFlags

if TYPE_CHECKING:
    from replan.console import Console
    from replan.rc.runner import Backend


@dataclass(frozen=True, kw_only=True)
class BenchRc(PerceptionModels):
    """The paper's eight tasks in seeded cells, by variant of the method, scored on the cells' truth.

    Every episode runs in a process of its own and leaves one file. After an interruption of any kind the same command
    goes on where it ended. docs/rc-benchmark.md says what is scored and how it compares with the paper.
    """

    runs: int = 10
    """Runs of each task and variant, with seeds 0, 1, 2, ..."""
    tasks: tuple[str, ...] = ()
    """Names of the tasks; default all eight (an unknown name lists them)."""
    variants: tuple[str, ...] = ("full",)
    """full, no-verifier, no-perceiver, no-replan, language-to-rewards, one-shot-plan, pddl, task-and-motion; each may
    be followed by +true-poses and +answer-noise=SHARE."""
    poses: Literal["seen", "true"] = "seen"
    """Where poses come from: perception, or the truth of what the cameras show; for all variants."""
    language: tyro.conf.OmitArgPrefixes[ReasonerFlags] = field(default_factory=ReasonerFlags)
    """Who answers; --answer-noise holds for all variants that do not say it themselves."""
    jobs: int = 1
    """Episodes at a time on this machine; each wants about one core."""
    backend: Literal["local", "ray"] = "local"
    """Where episodes run: on this machine, or on a Ray cluster (RAY_ADDRESS, or a new one on this machine)."""
    shard: str = "1/1"
    """K/N: the Kth of N equal parts of the list, for N machines that do not know of each other."""
    folder: Path = Path("runs/rc")
    """Where everything is kept."""
    time_limit: float = 900.0
    """Longest wall time of one episode in seconds; a longer one is ended and counts as failed."""
    report_only: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Run nothing; count what the folder holds and write its report."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Run what is missing, then report."""
        from replan.rc.bench import RcOptions, report_on, run_benchmark
        from replan.rc.variants import variant_from

        if self.report_only:
            report = report_on(self.folder)
        else:
            options = RcOptions(
                runs=self.runs,
                tasks=self.tasks,
                variants=tuple(variant_from(v, self.poses, self.language.noise) for v in self.variants),
                folder=self.folder,
                shard=self.shard,
                reasoner=self.language.options(offline=False),
                detector=self.detector,
                segmenter=self.segmenter,
                time_limit_s=self.time_limit,
            )
            report = run_benchmark(options, self._backend(), console.note)
        console.result(report.as_json(), report.as_text())
        return 0

    def _backend(self) -> Backend:
        from control.errors import ConfigError

        if self.jobs < 1:
            raise ConfigError(f"--jobs must be at least 1, not {self.jobs}")
        if self.backend == "ray":
            from replan.rc.ray_backend import ray_backend

            return ray_backend()
        from replan.rc.runner import local_backend

        return local_backend(self.jobs)
