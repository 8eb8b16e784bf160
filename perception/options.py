"""Options of perception that do not depend on which detector and segmenter are chosen. Needs nothing installed."""

import re
from dataclasses import dataclass

from perception.detection.devices import Precision
from perception.errors import OptionError


@dataclass(frozen=True)
class PerceptionOptions:
    """How detectors and segmenters run and what of their answers is kept.

    Attributes:
        threshold: Lowest score of a box, 0..1; the detector's own if None.
        same_phrase_iou: Of two boxes of one phrase that overlap by more (IoU, 0..1), the better stays.
        other_phrase_iou: The same for boxes of different phrases.
        most_per_phrase: At most so many boxes per phrase.
        device: "auto" (CUDA if there is any), "cpu", "cuda" or "cuda:1".
        precision: "auto" (half on CUDA, single on a CPU), "half" or "single".
        offline: Never ask a model hub; only folders and what earlier downloads left on this machine.

    Raises:
        OptionError: On construction, for a value outside of its range.
    """

    threshold: float | None = None
    same_phrase_iou: float = 0.5
    other_phrase_iou: float = 0.75
    most_per_phrase: int = 20
    device: str = "auto"
    precision: Precision = "auto"
    offline: bool = False

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
