"""The benchmark's folder on disk: list of jobs, one file an episode, whole at every moment.

setup.json                 configuration that all episodes share
jobs.jsonl                 the list of jobs, one a line
episodes/JOB.json          one record an episode, written at once or not at all
runs/JOB/...               folders of the runs
results.json, report.html  made of the records
"""

import fcntl
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from control.errors import ConfigError
from replan.rc.jobs import Job, jobs_text
from replan.rc.records import EpisodeRecord, Setup, differences


class RcFolder:
    """A benchmark's folder.

    Args:
        path: Where it is; made by `prepare`.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._locks: list[int] = []

    def prepare(self, setup: Setup, jobs: Sequence[Job]) -> None:
        """Make the folder, or take up one of the same configuration; writes the list of jobs.

        Raises:
            ConfigError: It holds something else, another configuration, or cannot be written.
        """
        known = self.path / "setup.json"
        try:
            if not known.exists():
                if self.path.exists() and any(self.path.iterdir()):
                    raise ConfigError(
                        f"{self.path} holds other files and no setup.json of this benchmark; choose an empty --folder"
                    )
                (self.path / "episodes").mkdir(parents=True, exist_ok=True)
                write_whole(known, json.dumps(setup.as_json(), indent=1) + "\n")
            self._require_same(known, self._json(known), setup)
            write_whole(self.path / "jobs.jsonl", jobs_text(jobs))
        except OSError as error:
            raise ConfigError(f"cannot write {self.path}: {error.strerror}; choose another --folder") from error

    def claim(self, shard: str) -> None:
        """Keep others from running the same shard of this folder at the same time; held until this process ends.

        Raises:
            ConfigError: Somebody does.
        """
        name = self.path / f".running-{shard.replace('/', '-of-')}"
        lock = os.open(name, os.O_WRONLY | os.O_CREAT, 0o644)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(lock)
            raise ConfigError(
                f"another process is running shard {shard} of {self.path}; wait for it, or choose another --folder"
            ) from None
        self._locks.append(lock)

    def close(self) -> None:
        """Let others run what was claimed."""
        while self._locks:
            os.close(self._locks.pop())

    def episode_file(self, job: Job) -> Path:
        """Where a job's record is."""
        return self.path / "episodes" / f"{job.name}.json"

    def runs_dir(self, job: Job) -> Path:
        """Where a job's run makes its folder."""
        return self.path / "runs" / job.name

    def write(self, job: Job, record: EpisodeRecord) -> None:
        """Write a record at once: a reader sees all of it or nothing."""
        write_whole(self.episode_file(job), record.model_dump_json(indent=1) + "\n")

    def done(self, job: Job, setup: Setup) -> bool:
        """Whether a job has been run with this configuration.

        Raises:
            ConfigError: It was run with another one.
        """
        file = self.episode_file(job)
        if not file.exists():
            return False
        self._require_same(file, self._record(file).setup, setup)
        return True

    def records(self) -> tuple[EpisodeRecord, ...]:
        """Every episode of the folder, in the order of its names.

        Raises:
            ConfigError: There is none, a file is none of ours, or they are of several configurations.
        """
        files = sorted((self.path / "episodes").glob("*.json"))
        if not files:
            raise ConfigError(f"{self.path} has no episodes; run `replan bench rc --folder {self.path}` first")
        records = tuple(self._record(file) for file in files)
        for file, record in zip(files, records, strict=True):
            other = differences(record.setup, records[0].setup)
            if other:
                raise ConfigError(f"{files[0]} and {file} cannot be counted together: {other}; remove one of them")
        return records

    def _require_same(self, file: Path, found: dict[str, Any], setup: Setup) -> None:
        other = differences(found, setup.as_json())
        if other:
            raise ConfigError(
                f"{file} is of another configuration: {other}; choose another --folder, or say --report-only to look "
                "at what is there"
            )

    def _record(self, file: Path) -> EpisodeRecord:
        try:
            return EpisodeRecord.model_validate_json(file.read_bytes())
        except (OSError, ValidationError) as error:
            first = str(error).splitlines()[0]
            raise ConfigError(f"{file} is not an episode of this benchmark ({first}); remove it") from error

    def _json(self, file: Path) -> dict[str, Any]:
        try:
            found = json.loads(file.read_text(encoding="utf-8"))
        except ValueError as error:
            raise ConfigError(f"{file} is not JSON ({error}); choose another --folder") from error
        if not isinstance(found, dict):
            raise ConfigError(f"{file} is not this benchmark's; choose another --folder")
        return found


def write_whole(path: Path, text: str) -> None:
    """Write a file that is whole at every moment, even if the machine loses power."""
    partial = path.with_name(f".{path.name}.{os.getpid()}.part")
    with partial.open("w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    os.replace(partial, path)
