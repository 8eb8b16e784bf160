"""Which estimate of one frame is the same thing as which of the frames before: stable names, and quieter poses.

Estimates x of one phrase with spreads s are assigned to known things of that phrase (Hungarian method), the dearest
pair first ruled out by a gate on the squared Mahalanobis distance

    d^2 = sum over axes of (x_i - m_i)^2 / (s_i^2 + p_i^2 + 2 e^2) <= 16.27       (99.9 % of chi^2 with 3 degrees)

where m, p are the thing's filtered place and its spread and e = `least_std`, for what errors of frames of one camera
have in common. While a thing stands still its place is the running mean weighted by 1 / s^2, p^2 = 1 / sum(1 / s^2),
in which what came before never weighs more than `memory` times the newest estimate.

Estimates and things that are left over are paired by distance within `reach`: the thing was moved, and its filter
starts anew from there. An estimate that is left over then is a new thing. A thing that is not seen keeps its name and
place and is taken up again when it reappears.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from perception.estimates import ObjectEstimate
from perception.tracking.instances import instance_name
from perception.tracking.merging import turned_like

FAR = 1e9  # cost of a pair that is ruled out


@dataclass(frozen=True)
class TrackSettings:
    """How things are followed.

    Attributes:
        gate: Largest squared Mahalanobis distance of a thing that stood still.
        least_std: Spread in [m] below which no mean falls: what errors of many frames have in common.
        memory: How many times the newest estimate all earlier ones weigh at most, so that small shifts show in time.
        reach: How far a thing may have been moved between two frames in [m].
        forget_after: Frames after which a thing that was seen once only is forgotten; it was a mistake.
    """

    gate: float = 16.27
    least_std: float = 0.002
    memory: float = 30.0
    reach: float = 0.5
    forget_after: int = 30


@dataclass(frozen=True)
class Track:
    """One thing as followed through frames.

    Attributes:
        name: Its name for good: the phrase with underscores, then with _2, _3, ...
        estimate: Its last estimate, with pose, extents and spreads filtered since it was moved last.
        seen: Frames in which it was seen, in all.
        weight: Sum of 1 / spread^2 of those frames along the world's axes in [1/m^2], shape (3,).
        yaw_weight: The same of the yaw in [1/rad^2]; 0 where yaw has no meaning.
        still: Frames that the filtered pose is a mean of.
        moves: How often it was found elsewhere.
        missed: Frames since it was seen last.
    """

    name: str
    estimate: ObjectEstimate
    weight: NDArray[np.float64]
    yaw_weight: float
    seen: int = 1
    still: int = 1
    moves: int = 0
    missed: int = 0


class Tracker:
    """Follows things; feed it the estimates of one frame after the other."""

    def __init__(self, settings: TrackSettings | None = None) -> None:
        """Nothing is known yet."""
        self.settings = settings or TrackSettings()
        self._tracks: list[Track] = []

    @property
    def tracks(self) -> tuple[Track, ...]:
        """All things that are known, in the order in which they turned up."""
        return tuple(self._tracks)

    def update(self, objects: Sequence[ObjectEstimate]) -> tuple[Track, ...]:
        """Take in the estimates of the next frame.

        Args:
            objects: Of one frame, in the same world as all before.

        Returns:
            The thing that each estimate is of, in their order.
        """
        chosen: dict[int, int] = {}  # estimate to track
        moved: set[int] = set()
        for phrase in dict.fromkeys(o.phrase for o in objects):
            new = [i for i, o in enumerate(objects) if o.phrase == phrase]
            old = [j for j, t in enumerate(self._tracks) if t.estimate.phrase == phrase]
            stood = self._assign(objects, new, old, self._mahalanobis, self.settings.gate)
            chosen |= stood
            left = [i for i in new if i not in stood], [j for j in old if j not in stood.values()]
            elsewhere = self._assign(objects, *left, _distance, self.settings.reach)
            chosen |= elsewhere
            moved |= set(elsewhere)
        self._tracks = [replace(t, missed=t.missed + 1) for t in self._tracks]
        for i, o in enumerate(objects):
            if i not in chosen:
                chosen[i] = len(self._tracks)
                name = instance_name(o.phrase.replace(" ", "_"), {t.name for t in self._tracks})
                self._tracks.append(Track(name, replace(o, name=name), *_weights(o)))
            else:
                self._tracks[chosen[i]] = self._updated(self._tracks[chosen[i]], o, i in moved)
        result = tuple(self._tracks[chosen[i]] for i in range(len(objects)))
        self._tracks = [t for t in self._tracks if t.seen > 1 or t.missed < self.settings.forget_after]
        return result

    def _assign(self, objects, new: list[int], old: list[int], cost, most: float) -> dict[int, int]:
        """Pairs of least total cost, none above `most`."""
        if not new or not old:
            return {}
        costs = np.array([[cost(self._tracks[j].estimate, objects[i]) for j in old] for i in new])
        rows, columns = linear_sum_assignment(np.where(costs <= most, costs, FAR))
        return {new[r]: old[c] for r, c in zip(rows, columns, strict=True) if costs[r, c] <= most}

    def _mahalanobis(self, known: ObjectEstimate, seen: ObjectEstimate) -> float:
        variance = known.position_std**2 + seen.position_std**2 + 2 * self.settings.least_std**2
        return float(np.sum((known.position - seen.position) ** 2 / variance))

    def _updated(self, track: Track, seen: ObjectEstimate, moved: bool) -> Track:
        if moved or seen.shape != track.estimate.shape:
            fresh = Track(track.name, replace(seen, name=track.name), *_weights(seen))
            return replace(fresh, seen=track.seen + 1, moves=track.moves + moved)
        return _averaged(track, seen, self.settings)


def _weights(o: ObjectEstimate) -> tuple[np.ndarray, float]:
    return o.position_std**-2.0, o.yaw_std**-2.0 if np.isfinite(o.yaw_std) else 0.0


def _averaged(track: Track, seen: ObjectEstimate, settings: TrackSettings) -> Track:
    """The track with one more estimate of the same place: place, yaw and sizes are means."""
    known, seen = track.estimate, turned_like(seen, track.estimate.yaw)
    new, new_yaw = _weights(seen)
    old = np.minimum(track.weight, settings.memory * new)
    old_yaw = min(track.yaw_weight, settings.memory * new_yaw)
    pose = np.array(seen.world_T_object)
    pose[:3, 3] = (old * known.position + new * seen.position) / (old + new)
    yaw_std = seen.yaw_std
    if seen.shape == "box" and old_yaw > 0.0 and new_yaw > 0.0:
        back = np.angle(np.exp(1j * (known.yaw - seen.yaw))) * old_yaw / (old_yaw + new_yaw)
        c, s = np.cos(back), np.sin(back)
        pose[:3, :3] = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ pose[:3, :3]
        yaw_std = float((old_yaw + new_yaw) ** -0.5)
    count = min(track.still, settings.memory)
    mean = replace(
        seen,
        name=track.name,
        world_T_object=pose,
        extents=(count * known.extents + seen.extents) / (count + 1),
        position_std=np.maximum((old + new) ** -0.5, np.minimum(settings.least_std, seen.position_std)),
        yaw_std=yaw_std,
    )
    return Track(track.name, mean, old + new, old_yaw + new_yaw, track.seen + 1, track.still + 1, track.moves)


def _distance(known: ObjectEstimate, seen: ObjectEstimate) -> float:
    return float(np.linalg.norm(known.position - seen.position))
