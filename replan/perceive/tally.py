"""What the frames of a recording add up to: how often each name was found, and how long each stage took."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from perception.estimates import SceneEstimate
from perception.pipeline import STAGES
from perception.tracking.tracker import Track
from replan.perceive.frame_stream import KeyedFrame

LISTED = 20  # frames of which every object is listed as text


@dataclass(frozen=True)
class Spot:
    """Where one thing was in one frame.

    Attributes:
        time: Of the frame in [s].
        seen: Position as this frame alone says, in the world in [m].
        filtered: The same as all frames say since it was moved last.
    """

    time: float
    seen: tuple[float, float, float]
    filtered: tuple[float, float, float]


class Tally:
    """Adds up frames; keeps numbers only.

    Attributes:
        names: What was looked for.
        frames: How many were looked at.
        found: In how many of them each name was found; unnamed things as they are called.
        spots: Where each thing was, by its name as followed.
        seconds: Time of each stage and of the whole in each frame in [s].
        times: Stamp of each frame in [s].
        reasons: By name, how often each reason for not being found was given.
    """

    def __init__(self, names: Sequence[str]) -> None:
        """Nothing was looked at."""
        self.names = tuple(dict.fromkeys(n.strip().lower().replace(" ", "_") for n in names))
        self.frames = 0
        self.found: dict[str, int] = dict.fromkeys(self.names, 0)
        self.spots: dict[str, list[Spot]] = {}
        self.seconds: dict[str, list[float]] = {stage: [] for stage in (*STAGES, "total")}
        self.times: list[float] = []
        self.reasons: dict[str, dict[str, int]] = {name: {} for name in self.names}
        self._lines: list[str] = []

    def add(self, item: KeyedFrame, scene: SceneEstimate, tracks: Sequence[Track], seconds: float) -> None:
        """One frame more.

        Args:
            item: The frame.
            scene: What was found in it.
            tracks: Which thing each object is.
            seconds: How long perception took in all in [s].
        """
        self.frames += 1
        self.times.append(scene.stamp)
        for name in dict.fromkeys(o.phrase.replace(" ", "_") for o in scene.objects):
            self.found[name] = self.found.get(name, 0) + 1
        for u in scene.unseen:
            reason = u.reason.partition(" (")[0]
            self.reasons[u.name][reason] = self.reasons[u.name].get(reason, 0) + 1
        for o, track in zip(scene.objects, tracks, strict=True):
            spot = Spot(scene.stamp, tuple(o.position.tolist()), tuple(track.estimate.position.tolist()))
            self.spots.setdefault(track.name, []).append(spot)
        for stage in STAGES:
            self.seconds[stage].append(scene.seconds.get(stage, 0.0))
        self.seconds["total"].append(seconds)
        if self.frames <= LISTED:
            self._lines += _lines(item, scene, tracks)

    def timings(self) -> dict[str, dict[str, float]]:
        """Median and 95 % quantile of each stage and of the whole in [ms]."""
        return {
            stage: {
                "median": round(1e3 * float(np.median(values)), 1),
                "p95": round(1e3 * float(np.quantile(values, 0.95)), 1),
            }
            for stage, values in self.seconds.items()
            if values
        }

    def as_json(self) -> dict[str, Any]:
        """Counts and times."""
        return {"looked_at": self.frames, "found_in": self.found, "ms": self.timings()}

    def as_lines(self) -> list[str]:
        """For people."""
        if self.frames <= LISTED:
            return self._lines
        lines = [f"{self.frames} frames"]
        for name in self.names:
            why = sorted(self.reasons[name].items(), key=lambda pair: -pair[1])
            said = "; ".join(f"{count} x {reason}" for reason, count in why)
            lines.append(f"  {name:16} found in {self.found[name]}" + (f" (else {said})" if said else ""))
        for name, spots in self.spots.items():
            x, y, z = np.median([s.seen for s in spots], axis=0)
            lines.append(f"  thing {name:16} in {len(spots)} frames, in the middle at ({x:.3f}, {y:.3f}, {z:.3f}) m")
        return lines


def _lines(item: KeyedFrame, scene: SceneEstimate, tracks: Sequence[Track]) -> list[str]:
    lines = [f"frame {item.key} at {scene.stamp:.3f} s of camera '{item.frame.camera}'"]
    for o, track in zip(scene.objects, tracks, strict=True):
        x, y, z = o.position
        size = " x ".join(f"{1000 * e:.0f}" for e in o.extents)
        line = f"  {o.name:16} {o.shape:8} at ({x:.3f}, {y:.3f}, {z:.3f}) m, {size} mm, {o.score:.2f}"
        lines.append(line + (f", followed as {track.name}" if track.name != o.name else ""))
    return lines + [f"  {u.name:16} not found: {u.reason}" for u in scene.unseen]
