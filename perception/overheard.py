"""A detector whose boxes are remembered until it looks again, for whoever measures it."""

from collections.abc import Sequence

from perception.frames import RgbdFrame
from perception.interfaces import Detection, Detector


class OverheardDetector:
    """Asks another detector and keeps its answer.

    Attributes:
        drawn: All boxes of the last look, before any of them is suppressed.
    """

    def __init__(self, detector: Detector) -> None:
        """Nothing was drawn yet."""
        self._detector = detector
        self.drawn: tuple[Detection, ...] = ()

    @property
    def name(self) -> str:
        """Of the detector that is asked."""
        return self._detector.name

    def detect(self, frame: RgbdFrame, phrases: Sequence[str]) -> list[Detection]:
        """What the detector answers."""
        found = self._detector.detect(frame, phrases)
        self.drawn = tuple(found)
        return found
