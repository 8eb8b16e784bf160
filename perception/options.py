"""Which detector and segmenter find things, and how they run. Needs nothing installed."""

import re
from dataclasses import dataclass

from perception.detection.devices import Precision
from perception.errors import OptionError


@dataclass(frozen=True, kw_only=True)
class PerceptionModels:
    """Who finds things in pictures; see docs/models.md."""

    detector: str = "default"
    """`colour` (embedded, nothing learned; this is `default`), `bundled` (the project's own small weights), or a
    GroundingDINO or MM-GroundingDINO: local folder or hub name."""
    segmenter: str = "default"
    """`grabcut` (embedded, nothing learned; this is `default`), `bundled` (the project's own small weights), or a SAM
    or SAM 2: local folder or hub name."""


@dataclass(frozen=True)
class PerceptionOptions:
    """How detectors and segmenters run and what of their answers is kept.

    Raises:
        OptionError: On construction, for a value outside of its range.
    """

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
    precision: Precision = "auto"
    """Arithmetic of learned models; auto is half on CUDA and single on a CPU."""
    offline: bool = False
    """Never ask a model hub; use local files only."""

    def __post_init__(self) -> None:
        for name in ("threshold", "same_phrase_iou", "other_phrase_iou"):
            value = getattr(self, name)
            if value is not None and not 0.0 <= value <= 1.0:
                raise OptionError(f"--{name.replace('_', '-')} {value:g} is not valid; it must be from 0 to 1")
        if self.most_per_phrase < 1:
            raise OptionError(f"--most-per-phrase {self.most_per_phrase} is not valid; it must be at least 1")
        if not re.fullmatch(r"auto|cpu|cuda(:\d+)?", self.device):
            raise OptionError(f"--device '{self.device}' is not valid; it must be auto, cpu, cuda or cuda:<number>")
        if self.precision not in ("auto", "half", "single"):
            raise OptionError(f"--precision '{self.precision}' is not valid; it must be auto, half or single")
