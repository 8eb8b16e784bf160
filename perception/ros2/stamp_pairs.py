"""Which colour picture and which depth picture belong together, by their stamps, while both stream by."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

PATIENCE = 1_000_000_000  # [ns]; messages of two topics arrive out of step by less
MOST_WAITING = 60  # pictures of a topic that wait for partners; two seconds of a fast camera


@dataclass(frozen=True)
class Stamped:
    """A picture with its moment of exposure in [ns]."""

    stamp: int
    what: Any


@dataclass(frozen=True)
class Pair:
    """Two pictures that belong together."""

    colour: Any
    depth: Any


@dataclass(frozen=True)
class Lonely:
    """A picture for which none of the other topic was near.

    Attributes:
        what: The picture.
        is_depth: Which topic it is of.
        nearest: How far the nearest of the other topic seen with it was in [ns]; None where none was.
    """

    what: Any
    is_depth: bool
    nearest: int | None


class StampPairs:
    """Pairs the pictures of one camera.

    Two pictures make a pair when their stamps differ by at most the tolerance and neither has a nearer partner. A
    picture waits until a later one of the other topic shows that no nearer can come, at most `PATIENCE`.

    Args:
        tolerance: Largest difference in [ns].
    """

    def __init__(self, tolerance: int) -> None:
        self._tolerance = tolerance
        self._waiting: tuple[list[Stamped], list[Stamped]] = ([], [])  # colour, depth

    def add(self, picture: Stamped, is_depth: bool) -> Iterator[Pair | Lonely]:
        """Take in a picture; gives what is decided by it."""
        queue = self._waiting[is_depth]
        queue.append(picture)
        queue.sort(key=lambda s: s.stamp)
        yield from self._decide(False)
        for side in (0, 1):
            late = self._waiting[side]
            while late and (picture.stamp - late[0].stamp > PATIENCE or len(late) > MOST_WAITING):
                yield self._lonely(side)
            while late and late[-1].stamp - picture.stamp > PATIENCE:  # the clock was set back
                yield self._lonely(side, -1)

    def finish(self) -> Iterator[Pair | Lonely]:
        """What is left when nothing comes any more."""
        yield from self._decide(True)
        for side in (0, 1):
            while self._waiting[side]:
                yield self._lonely(side)

    def _decide(self, ended: bool) -> Iterator[Pair | Lonely]:
        while self._waiting[0] and self._waiting[1]:
            early = 0 if self._waiting[0][0].stamp <= self._waiting[1][0].stamp else 1
            own, other = self._waiting[early], self._waiting[1 - early]
            apart = other[0].stamp - own[0].stamp
            if apart > self._tolerance:
                yield self._lonely(early)
                continue
            # A later one of its own topic may be nearer to the other; if it was not seen yet it could still come.
            if apart and len(own) < 2 and not ended:
                return
            if len(own) > 1 and abs(own[1].stamp - other[0].stamp) < apart:
                yield self._lonely(early)
                continue
            colour, depth = self._waiting[0].pop(0), self._waiting[1].pop(0)
            yield Pair(colour.what, depth.what)

    def _lonely(self, side: int, which: int = 0) -> Lonely:
        picture = self._waiting[side].pop(which)
        gaps = [abs(other.stamp - picture.stamp) for other in self._waiting[1 - side]]
        return Lonely(picture.what, bool(side), min(gaps, default=None))
