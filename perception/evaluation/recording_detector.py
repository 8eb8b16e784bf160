"""A detector whose boxes are remembered until it looks again, for whoever measures it."""

from collections.abc import Sequence

from perception.detection.nms import suppress
from perception.frames import RgbdFrame
from perception.interfaces import Detection, Detector
from perception.options import PerceptionOptions


class RecordingDetector:
    """Asks another detector and keeps its answer.

    Attributes:
        drawn: Boxes of the last look without those that a better one made needless, also those below the threshold.
    """

    def __init__(self, detector: Detector, threshold: float = 0.0, options: PerceptionOptions | None = None) -> None:
        """Nothing was drawn yet.

        Args:
            detector: Whom to ask.
            threshold: Lowest score of a box that is handed on, 0..1.
            options: Which boxes that overlap are kept, and how many; as for whom the boxes are meant.
        """
        self._options = options or PerceptionOptions()
        self._detector, self._threshold = detector, threshold
        self.drawn: tuple[Detection, ...] = ()

    @property
    def name(self) -> str:
        """Of the detector that is asked."""
        return self._detector.name

    def detect(self, frame: RgbdFrame, phrases: Sequence[str]) -> list[Detection]:
        """What the detector answers, from the threshold on."""
        options = self._options
        self.drawn = tuple(
            suppress(
                self._detector.detect(frame, phrases),
                options.same_phrase_iou,
                options.other_phrase_iou,
                options.most_per_phrase,
            )
        )
        return [box for box in self.drawn if box.score >= self._threshold]
