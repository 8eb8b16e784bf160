"""What a detector and a segmenter are. Needs numpy only."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from perception.frames import RgbdFrame


@dataclass(frozen=True)
class Detection:
    """One box that a detector drew for one phrase.

    Attributes:
        phrase: The phrase that was asked for.
        box_px: (x0, y0, x1, y1) in [px], float, shape (4,); x1 and y1 are just outside of the last pixel.
        score: Confidence, 0..1.
        seed: Pixels by which the detector knew the object, bool, shape (height, width), or None when it has only
            a box. A segmenter may start from it.
        behind: Pixels between its pieces where something nearer hides it, bool, same shape, or None.
        rest: Pixels of what stands on it or carries it and looks the same, bool, same shape, or None. A mask can tell
            the two apart by nothing but these pixels and its own.
    """

    phrase: str
    box_px: NDArray[np.float64]
    score: float
    seed: NDArray[np.bool_] | None = None
    behind: np.ndarray | None = None
    rest: NDArray[np.bool_] | None = None


class Detector(Protocol):
    """Finds things that phrases name in a colour picture (and may use its depth)."""

    @property
    def name(self) -> str:
        """For people to read: what it is, and whether it is a learned model."""
        ...

    def detect(self, frame: RgbdFrame, phrases: Sequence[str]) -> list[Detection]:
        """All boxes above the detector's threshold, any number per phrase, best first.

        Raises:
            UnknownPhraseError: A phrase that this detector has no way to look for.
            ModelUnavailableError: Its weights or packages are not on this machine.
        """
        ...


@runtime_checkable
class ShapeDetector(Detector, Protocol):
    """A detector that tells round from angular by outlines."""

    def other_shape(self, phrase: str) -> str | None:
        """The phrase for the same colour in the other shape, or None for a phrase that says neither."""
        ...


class Segmenter(Protocol):
    """Turns a box into the pixels of the object inside it."""

    @property
    def name(self) -> str:
        """For people to read: what it is, and whether it is a learned model."""
        ...

    def segment(self, frame: RgbdFrame, box_px: np.ndarray, seed: np.ndarray | None = None) -> np.ndarray:
        """Pixels of the object, bool, shape (height, width); all False when nothing stands out in the box.

        Args:
            frame: Picture to cut from.
            box_px: (x0, y0, x1, y1) in [px], shape (4,).
            seed: `Detection.seed`; segmenters that need no start ignore it.
        """
        ...

    def segment_all(
        self, frame: RgbdFrame, boxes_px: np.ndarray, seeds: Sequence[np.ndarray | None] = ()
    ) -> np.ndarray:
        """The same for several boxes of one picture, bool, shape (n, height, width).

        Args:
            frame: Picture to cut from.
            boxes_px: (x0, y0, x1, y1) in [px], shape (n, 4).
            seeds: One entry a box, or none at all.
        """
        ...
