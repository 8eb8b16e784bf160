"""What every recording of RGB-D frames offers, whatever its format: frames one at a time, and what was left out."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass

from perception.errors import FrameError
from perception.frames import RgbdFrame
from perception.ground_truth import FrameTruth


@dataclass(frozen=True)
class Skipped:
    """One picture, message or pair that could not be used; reading went on behind it.

    Attributes:
        where: Which one, for instance "0003-color.png" or "message 12 of topic '/camera/color/image_raw'".
        reason: What is wrong with it.
    """

    where: str
    reason: str


@dataclass(frozen=True)
class TruthOfFrame:
    """A frame and what truly was in it; for scorers only."""

    frame: RgbdFrame
    truth: FrameTruth | None


class Recording(ABC):
    """Recorded frames; iterating reads one after the other and holds no more than that. Iterate as often as wanted.

    Attributes:
        name: For people: the last part of the recording's path.
        count: Frames that there are, broken ones among them; None where only reading the whole recording would tell.
        notes: How it is read, for people: the world's frame, a unit that was assumed.
        skipped: What the latest iteration left out, in order; it grows while iterating and empties when another begins.
        has_truth: Whether the recording says what truly was in its frames.
    """

    def __init__(self, name: str, count: int | None, notes: tuple[str, ...] = (), has_truth: bool = False) -> None:
        self.name = name
        self.count = count
        self.notes = notes
        self.has_truth = has_truth
        self.skipped: list[Skipped] = []

    def __iter__(self) -> Iterator[RgbdFrame]:
        """The frames that can be used.

        Raises:
            FrameError: At the end, when not one could; names the first and what was wrong with it.
        """
        for pair in self._usable(False):
            yield pair.frame

    def with_truth(self) -> Iterator[TruthOfFrame]:
        """The same frames with what truly was in them, None where the recording does not say. For scorers only.

        Raises:
            FrameError: As iterating does.
        """
        return self._usable(True)

    def _usable(self, with_truth: bool) -> Iterator[TruthOfFrame]:
        self.skipped.clear()
        read = 0
        for item in self._items(with_truth):
            if isinstance(item, Skipped):
                self.skipped.append(item)
            else:
                read += 1
                yield item
        if not read:
            first = f"; first {self.skipped[0].where}: {self.skipped[0].reason}" if self.skipped else ""
            raise FrameError(f"no frame of '{self.name}' can be used ({len(self.skipped)} left out){first}")

    @abstractmethod
    def _items(self, with_truth: bool) -> Iterator[TruthOfFrame | Skipped]:
        """Every frame or what stood in its place, in the recording's order; the truth only when it is asked for."""
