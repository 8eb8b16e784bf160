"""A detector whose boxes are remembered until it looks again, for whoever measures it."""

from collections.abc import Sequence

from perception.frames import RgbdFrame
from perception.interfaces import Detection, Detector


class OverheardDetector:
    """Asks another detector and keeps its answer.

    Attributes:
        drawn: All boxes of the last look, before any of them is suppressed or left out for its score.
    """

    def __init__(self, detector: Detector, threshold: float = 0.0) -> None:
        """Nothing was drawn yet.

        Args:
            detector: Whom to ask.
            threshold: Lowest score of a box that is handed on, 0..1.
        """
        self._detector, self._threshold = detector, threshold
        self.drawn: tuple[Detection, ...] = ()

    @property
    def name(self) -> str:
        """Of the detector that is asked."""
        return self._detector.name

    def detect(self, frame: RgbdFrame, phrases: Sequence[str]) -> list[Detection]:
        """What the detector answers, from the threshold on."""
        self.drawn = tuple(self._detector.detect(frame, phrases))
        return [box for box in self.drawn if box.score >= self._threshold]
