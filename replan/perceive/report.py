"""What was found in a recording, for people and for JSON."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from perception.evaluation.scoring import scores_text
from perception.recordings.opening import Skipped
from perception.tracking.tracker import Track
from replan.errors import DONE, NOT_REACHED
from replan.perceive.tally import Tally


@dataclass(frozen=True)
class PerceiveReport:
    """What was found in a recording.

    Attributes:
        source: Which detector and segmenter, plainly named.
        tally: What the frames add up to.
        skipped: What could not be used.
        finished: Whether the recording was read to its end.
        metrics: Measured against the recording's truth; None where it has none.
        tracks: Things as they were known at the end.
        out: Folder of everything that was written.
        page: The page, or None.
        notes: How the recording was read and what was not written, for people.
    """

    source: str
    tally: Tally
    skipped: tuple[Skipped, ...]
    finished: bool
    metrics: Mapping[str, Any] | None
    tracks: tuple[Track, ...]
    out: Path
    page: Path | None
    notes: tuple[str, ...]

    @property
    def exit_code(self) -> int:
        """0 when anything was found, else 3."""
        return DONE if any(self.tally.found.values()) else NOT_REACHED


def as_json(report: PerceiveReport) -> dict[str, Any]:
    """As one JSON object: what is in objects.json, and where everything was written."""
    content = json.loads((report.out / "objects.json").read_text(encoding="utf-8"))
    page = None if report.page is None else str(report.page)
    return {**content, "page": page, "notes": list(report.notes), **report.tally.as_json()}


def as_text(report: PerceiveReport) -> str:
    """For people: a line an object while there are few frames, else a line a name; what was skipped and written."""
    lines = [f"perception: {report.source}", *report.tally.as_lines()]
    if report.skipped:
        lines.append(f"{len(report.skipped)} skipped:")
        lines += [f"  {s.where}: {s.reason}" for s in report.skipped[:10]]
        if len(report.skipped) > 10:
            lines.append(f"  ... and {len(report.skipped) - 10} more, all named in {report.out / 'objects.json'}")
    if report.metrics is not None:
        lines.append(scores_text(report.metrics))
    lines += [f"note: {note}" for note in report.notes]
    lines.append(f"written: {report.page or report.out / 'objects.json'}")
    return "\n".join(lines)
