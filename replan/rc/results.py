"""Episodes counted: per variant and task, with intervals."""

import statistics
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from replan.rc.records import EpisodeRecord
from replan.rc.tasks import TASKS
from replan.run.stopwatch import PARTS


@dataclass(frozen=True)
class TaskResult:
    """One task under one variant.

    Attributes:
        runs, success, claimed: Counts: of episodes, of those that truly succeeded, of those that say so.
        success_interval: 95 % Wilson interval of the success rate, as shares (low, high).
        actions_mean, actions_max: Steps tried in one episode, failed ones included.
        wall_s_median: Wall time of a run in [s], without starting its cell.
        planner_s_per_step_median: Wall time that an action cost outside perception, search, diagnosis, retiming,
            verdict and motion, in [s].
        seconds_by_part: Mean wall time of a run by part in [s].
        questions_mean, tokens_mean, cost_mean: What the reasoner answered in one episode, and what that took.
        replans_mean: How often a step or plan was made anew.
        causes: How many episodes failed for which cause.
    """

    runs: int
    success: int
    claimed: int
    success_interval: tuple[float, float]
    actions_mean: float
    actions_max: int
    wall_s_median: float
    planner_s_per_step_median: float | None
    seconds_by_part: dict[str, float]
    questions_mean: float
    tokens_mean: float
    cost_mean: float
    replans_mean: float
    causes: dict[str, int]

    @property
    def rate(self) -> float:
        """Share of episodes that succeeded."""
        return self.success / self.runs

    def as_json(self) -> dict[str, Any]:
        """As one JSON object."""
        per_step = self.planner_s_per_step_median
        return {
            "runs": self.runs,
            "success": self.success,
            "success_rate": round(self.rate, 4),
            "success_interval": [round(x, 4) for x in self.success_interval],
            "claimed": self.claimed,
            "actions_mean": round(self.actions_mean, 2),
            "actions_max": self.actions_max,
            "wall_s_median": round(self.wall_s_median, 2),
            "planner_s_per_step_median": None if per_step is None else round(per_step, 4),
            "seconds_by_part_mean": {part: round(s, 2) for part, s in self.seconds_by_part.items()},
            "questions_mean": round(self.questions_mean, 1),
            "tokens_mean": round(self.tokens_mean, 1),
            "cost_mean": round(self.cost_mean, 6),
            "replans_mean": round(self.replans_mean, 2),
            "causes": self.causes,
        }


@dataclass(frozen=True)
class VariantResult:
    """One variant of the method over the tasks that were run.

    Attributes:
        variant: Its name.
        tasks: By name, in the benchmark's order.
        reasoner, perception, commit: What the episodes name; several, joined by " / ", where they differ.
    """

    variant: str
    tasks: dict[str, TaskResult]
    reasoner: str
    perception: str
    commit: str | None

    @property
    def average(self) -> float:
        """Mean of the tasks' success rates, as the paper averages."""
        return statistics.fmean(t.rate for t in self.tasks.values())

    def as_json(self) -> dict[str, Any]:
        """As one JSON object."""
        return {
            "variant": self.variant,
            "reasoner": self.reasoner,
            "perception": self.perception,
            "commit": self.commit,
            "average": round(self.average, 4),
            "tasks": {name: task.as_json() for name, task in self.tasks.items()},
        }


def summarise(records: Sequence[EpisodeRecord]) -> tuple[VariantResult, ...]:
    """Count episodes by variant and task; `full` first, then by name."""
    by_variant: dict[str, list[EpisodeRecord]] = {}
    for record in records:
        by_variant.setdefault(record.job["variant"]["name"], []).append(record)
    names = sorted(by_variant, key=lambda name: (name != "full", name))
    return tuple(_variant(name, by_variant[name]) for name in names)


def _variant(name: str, records: Sequence[EpisodeRecord]) -> VariantResult:
    tasks = {
        task: _task(mine) for task in TASKS if (mine := [record for record in records if record.job["task"] == task])
    }
    return VariantResult(
        name,
        tasks,
        _joined(r.reasoner for r in records),
        _joined(r.perception for r in records),
        _joined(r.commit or "" for r in records) or None,
    )


def _joined(words) -> str:
    return " / ".join(dict.fromkeys(word for word in words if word))


def _task(records: Sequence[EpisodeRecord]) -> TaskResult:
    from sim_check.verdict.verdict import wilson_interval

    success = sum(r.success for r in records)
    # An episode that was killed has no times of its own.
    timed = [r for r in records if r.seconds_by_part]
    per_step = [r.seconds_by_part["planning"] / len(r.actions) for r in timed if r.actions]
    actions = [len(r.actions) for r in records]
    return TaskResult(
        runs=len(records),
        success=success,
        claimed=sum(r.claimed for r in records),
        success_interval=wilson_interval(success, len(records)),
        actions_mean=statistics.fmean(actions),
        actions_max=max(actions),
        wall_s_median=statistics.median(r.seconds or r.wall_s for r in records),
        planner_s_per_step_median=statistics.median(per_step) if per_step else None,
        seconds_by_part={p: statistics.fmean(r.seconds_by_part[p] for r in timed) for p in PARTS} if timed else {},
        questions_mean=statistics.fmean(r.questions for r in records),
        tokens_mean=statistics.fmean(r.tokens for r in records),
        cost_mean=statistics.fmean(r.cost for r in records),
        replans_mean=statistics.fmean(r.replans for r in records),
        causes=dict(Counter(r.cause for r in records if not r.success).most_common()),
    )
