"""Options of perception that several commands share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from perception.options import PerceptionOptions


@dataclass(frozen=True)
class PerceptionFlags:
    """How things are found in pictures; see docs/models.md."""

    detector: str = "default"
    """`colour` (embedded, nothing learned; this is `default`), `bundled` (the project's own small weights), or a
    GroundingDINO or MM-GroundingDINO: local folder or hub name."""
    segmenter: str = "default"
    """`grabcut` (embedded, nothing learned; this is `default`), `bundled` (the project's own small weights), or a SAM
    or SAM 2: local folder or hub name."""
    threshold: float | None = None
    """Lowest score of a box, 0 to 1. Default: the detector's own."""
    same_phrase_iou: float = 0.5
    """Of two boxes of one name that overlap by more than this (intersection over union, 0 to 1) the better stays."""
    other_phrase_iou: float = 0.75
    """The same for boxes of different names."""
    most_per_phrase: int = 20
    """At most so many boxes of one name."""
    device: str = "auto"
    """Where learned models run: auto (CUDA if there is any), cpu, cuda or cuda:1."""
    precision: Literal["auto", "half", "single"] = "auto"
    """Arithmetic of learned models; auto is half on CUDA and single on a CPU."""
    offline: bool = False
    """Never ask a model hub; use local files only."""

    def options(self) -> PerceptionOptions:
        """All but the two names, checked.

        Raises:
            OptionError: A value outside of its range.
        """
        from perception.options import PerceptionOptions

        return PerceptionOptions(
            threshold=self.threshold,
            same_phrase_iou=self.same_phrase_iou,
            other_phrase_iou=self.other_phrase_iou,
            most_per_phrase=self.most_per_phrase,
            device=self.device,
            precision=self.precision,
            offline=self.offline,
        )
