"""The record of one episode, and the configuration that it was run with."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

from planning.reasoners.options import ReasonerOptions
from replan_base import __version__

FORMAT = 1  # of tasks, scoring and records; results of different ones are never mixed
ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("perception", "control", "hw_interface", "sim_check", "planning", "prompts", "replan")
REPORTING = ("replan/reports/", "replan/rc/report", "replan/rc/results", "replan/rc/paper", "replan/rc/text")


@dataclass(frozen=True)
class Setup:
    """What all episodes of a folder have in common; episodes of another one are never counted with them.

    Attributes:
        format: `FORMAT`.
        version: Of this program.
        code: Hash of everything that an episode runs on: sources, prompts, cells.
        reasoner: Its backend and those options that are not the default ones,
            `planning.reasoners.options.ReasonerOptions`; the share of mistakes made on purpose belongs to the variant.
        detector, segmenter: As in `replan run`.
        time_limit_s: Longest wall time of an episode in [s].
    """

    reasoner: dict[str, Any]
    detector: str
    segmenter: str
    time_limit_s: float
    format: int = FORMAT
    version: str = ""
    code: str = ""

    def as_json(self) -> dict[str, Any]:
        """As one JSON object."""
        return asdict(self)


def setup_now(reasoner: ReasonerOptions, detector: str, segmenter: str, time_limit_s: float) -> Setup:
    """The configuration with this program as it is now."""
    usual = asdict(ReasonerOptions())
    chosen = {k: v for k, v in asdict(replace(reasoner, noise=0.0)).items() if v != usual[k] or k == "backend"}
    return Setup(
        json.loads(json.dumps(chosen, default=str)),
        detector,
        segmenter,
        time_limit_s,
        FORMAT,
        __version__,
        code_hash(),
    )


def differences(found: Mapping[str, Any], wanted: Mapping[str, Any]) -> str:
    """What two configurations differ in, for people; "" where they do not."""
    keys = [k for k in (*wanted, *(f for f in found if f not in wanted)) if found.get(k) != wanted.get(k)]
    return ", ".join(f"{k} is {found.get(k)!r} there and {wanted.get(k)!r} here" for k in keys)


@cache
def code_hash() -> str:
    """The first digits of a SHA-256 over every file that an episode runs on; what only makes reports is left out."""
    digest = hashlib.sha256()
    for folder in FOLDERS:
        for file in sorted((ROOT / folder).rglob("*")):
            name = file.relative_to(ROOT).as_posix()
            if file.suffix in (".py", ".yaml", ".j2", ".json") and not name.startswith(REPORTING):
                digest.update(name.encode() + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


class EpisodeAction(BaseModel):
    """One step that was tried.

    Attributes:
        action: As the plan has it.
        kind: Whether it asked for observer or executor.
        ok: Whether it was achieved, as seen afterwards.
        cause: Kind of its failure, or None.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    action: str
    kind: str
    ok: bool
    cause: str | None


class EpisodeRecord(BaseModel):
    """What became of one episode.

    Attributes:
        setup, job: What it was run with.
        ended: Whether it came to an end by itself.
        success: Whether the goal was truly reached and nothing came to harm.
        claimed: Whether the run says that it reached its goal.
        cause: Why not, in one word that can be counted; "" for a success.
        why: The same in a sentence.
        reason: What the run itself says at its end.
        harmed: What came to harm.
        plans: Steps of every plan, replans included.
        actions: Every step that was tried.
        motions, replans, simulated_steps: As in `replan.run.report.RunReport`.
        seconds: Wall time of the run in [s], without starting its cell.
        seconds_by_part: The same by `replan.run.stopwatch.PARTS`.
        wall_s: Wall time of the whole episode's process in [s].
        questions: Questions that the reasoner answered.
        tokens: Of questions and answers; 0 for a reasoner without tokens.
        cost: Of the answers, in the currency of the prices that were given.
        reasoner, perception: Which backends answered and saw, plainly named.
        commit: Of this program's repository, where known.
        folder: The run's folder, relative to the benchmark's; "" where there is none.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    setup: dict[str, Any]
    job: dict[str, Any]
    ended: Literal["done", "timed_out", "crashed"] = "done"
    success: bool = False
    claimed: bool = False
    cause: str = ""
    why: str = ""
    reason: str = ""
    harmed: tuple[str, ...] = ()
    plans: tuple[tuple[str, ...], ...] = ()
    actions: tuple[EpisodeAction, ...] = ()
    motions: int = 0
    replans: int = 0
    simulated_steps: int = 0
    seconds: float = 0.0
    seconds_by_part: dict[str, float] = {}
    wall_s: float = 0.0
    questions: int = 0
    tokens: int = 0
    cost: float = 0.0
    reasoner: str = ""
    perception: str = ""
    commit: str | None = None
    folder: str = ""
