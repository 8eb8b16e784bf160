"""The list of episodes to run: one line of JSON each, which any number of machines can share out."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from control.errors import ConfigError
from replan.rc.tasks import TASKS, task_named
from replan.rc.variants import Variant


@dataclass(frozen=True)
class Job:
    """One episode to run."""

    task: str
    seed: int
    variant: Variant

    @property
    def name(self) -> str:
        """Unique in a list, and fit for file names."""
        return f"{self.variant.name}_{self.task}_{self.seed:04d}"

    def as_json(self) -> dict[str, Any]:
        """As one JSON object."""
        return {"task": self.task, "seed": self.seed, "variant": self.variant.as_json()}

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> "Job":
        """What `as_json` wrote."""
        return cls(data["task"], data["seed"], Variant.from_json(data["variant"]))


def make_jobs(tasks: Sequence[str], runs: int, variants: Sequence[Variant]) -> tuple[Job, ...]:
    """All episodes, the first seed of every task and variant first, so that an early look sees all of them.

    Args:
        tasks: Names; empty for all.
        runs: Seeds 0 .. runs - 1.
        variants: At least one.

    Raises:
        ConfigError: An unknown task, nothing to run, or something twice.
    """
    names = tuple(task_named(n).name for n in tasks) or tuple(TASKS)
    if runs < 1:
        raise ConfigError(f"--runs must be at least 1, not {runs}")
    if not variants:
        raise ConfigError("there is no variant to run; say --variants full")
    for what, words in (("task", names), ("variant", tuple(v.name for v in variants))):
        twice = [w for w in words if words.count(w) > 1]
        if twice:
            raise ConfigError(f"{what} '{twice[0]}' is named twice; name it once")
    return tuple(Job(task, seed, v) for seed in range(runs) for v in variants for task in names)


def shard_of(jobs: Sequence[Job], shard: str) -> tuple[Job, ...]:
    """The jobs of one machine out of n, in the list's order; every job belongs to exactly one.

    Jobs are dealt out in the order of a hash of their names, so that no machine gets all of the slow task.

    Args:
        jobs: The whole list, the same on every machine.
        shard: "K/N", the Kth of N, from 1.

    Raises:
        ConfigError: Not of that form.
    """
    number, _, count = shard.partition("/")
    if not (number.isdecimal() and count.isdecimal() and 1 <= int(number) <= int(count)):
        raise ConfigError(f"--shard '{shard}' is not K/N with K from 1 to N, for instance 2/8")
    dealt = sorted(jobs, key=lambda job: hashlib.sha256(job.name.encode()).hexdigest())
    mine = set(dealt[int(number) - 1 :: int(count)])
    return tuple(job for job in jobs if job in mine)


def jobs_text(jobs: Sequence[Job]) -> str:
    """A list file's text, one line a job."""
    return "".join(json.dumps(job.as_json()) + "\n" for job in jobs)
