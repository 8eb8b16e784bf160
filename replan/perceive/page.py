"""One self-contained HTML page about a recording that was perceived: its frames, things, times and errors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from perception.estimates import ObjectEstimate, SceneEstimate
from perception.evaluation.scoring import SCORE_NAMES
from perception.pictures import PALETTE, depth_picture
from perception.tracking.tracker import Track
from replan.perceive.frame_stream import KeyedFrame
from replan.perceive.plots import timeline_svg
from replan.reports.pages import jpeg_text, made_by, write_page

if TYPE_CHECKING:
    from replan.perceive.report import PerceiveReport

SHOWN = 48  # most frames on the page
WIDTH = 620  # [px] of a picture on the page, at most
SKIPPED_SHOWN = 200
STAGE_NAMES = {
    "detect": "draw boxes",
    "segment": "cut out masks",
    "pose": "fit solids",
    "merge": "merge cameras",
    "total": "in all",
}


@dataclass(frozen=True)
class Row:
    """One object in the table of a frame; all but the colour for people."""

    colour: str
    name: str
    thing: str
    shape: str
    position: str
    yaw: str
    extents: str
    spread: str
    score: str
    depth: str
    filtered: str
    doubts: str


@dataclass(frozen=True)
class PageCard:
    """One frame on the page; pictures are JPEG as base64 text."""

    title: str
    picture: str
    picture_file: str
    depth: str
    depth_text: str
    rows: tuple[Row, ...]
    unseen: tuple[tuple[str, str], ...]


class PerceivePage:
    """Collects what the page shows; of a long recording every 2nd, 4th, 8th, ... frame, never more than `most`."""

    def __init__(self, most: int = SHOWN) -> None:
        """Nothing is shown yet.

        Args:
            most: Frames on the page at most.
        """
        self._most = most
        self._cards: list[PageCard] = []
        self._stride, self._count = 1, 0

    @property
    def stride(self) -> int:
        """Every so many frames are shown."""
        return self._stride

    @property
    def cards(self) -> tuple[PageCard, ...]:
        """Frames that are shown."""
        return tuple(self._cards)

    def add(
        self, item: KeyedFrame, scene: SceneEstimate, tracks: Sequence[Track], drawn: np.ndarray, picture: Path
    ) -> None:
        """One frame more.

        Args:
            item: The frame.
            scene: What was found in it.
            tracks: Which thing each object is.
            drawn: Its picture with what was found drawn over it, RGB, uint8.
            picture: File of the same.
        """
        if self._count % self._stride == 0:
            if len(self._cards) == self._most:
                self._cards = self._cards[::2]
                self._stride *= 2
            if self._count % self._stride == 0:
                self._cards.append(_card(item, scene, tracks, drawn, picture))
        self._count += 1

    def write(self, report: "PerceiveReport", recording: str, path: Path) -> None:
        """Write the page.

        Args:
            report: What the recording came to.
            recording: Its name.
            path: Where to.

        Raises:
            ConfigError: The file cannot be written.
        """
        tally = report.tally
        content: dict[str, Any] = {
            "recording": recording,
            "source": report.source,
            "looked_at": tally.frames,
            "finished": report.finished,
            "found_anything": any(tally.found.values()),
            "things": len(tally.spots),
            "names": [
                {
                    "name": name,
                    "found": count,
                    "share": round(100 * count / tally.frames),
                    "why": "; ".join(f"{n} x {reason}" for reason, n in tally.reasons[name].items()),
                }
                for name, count in tally.found.items()
            ],
            "notes": report.notes,
            "metrics": [] if report.metrics is None else _metric_rows(report.metrics),
            "timeline": timeline_svg(tally.spots, tally.times) if tally.spots and tally.frames > 1 else "",
            "cards": self._cards,
            "stride": self._stride,
            "out": str(report.out),
            "skipped": [(s.where, s.reason) for s in report.skipped[:SKIPPED_SHOWN]],
            "skipped_count": len(report.skipped),
            "timings": [(STAGE_NAMES[stage], row["median"], row["p95"]) for stage, row in tally.timings().items()],
            "footer": made_by(),
        }
        write_page("perceive.html.j2", content, path)


def _card(
    item: KeyedFrame, scene: SceneEstimate, tracks: Sequence[Track], drawn: np.ndarray, picture: Path
) -> PageCard:
    depth, (near, far) = depth_picture(item.frame)
    known = float(item.frame.valid_depth.mean())
    return PageCard(
        title=f"frame {item.key}, camera {item.frame.camera}, {scene.stamp:.3f} s",
        picture=jpeg_text(_fitted(drawn)),
        picture_file=picture.name,
        depth=jpeg_text(_fitted(depth)),
        depth_text=f"depth {near:.2f} m (light) to {far:.2f} m (dark); magenta: missing, {100 * (1 - known):.0f} %; "
        f"things stand on z = {scene.support_height + 0.0:z.3f} m",
        rows=tuple(
            _row(o, t, PALETTE[i % len(PALETTE)]) for i, (o, t) in enumerate(zip(scene.objects, tracks, strict=True))
        ),
        unseen=tuple((u.name, u.reason) for u in scene.unseen),
    )


def _row(o: ObjectEstimate, track: Track, colour: tuple[int, int, int]) -> Row:
    def metres(values: np.ndarray) -> str:
        return ", ".join(f"{v:.3f}" for v in values)

    seen = o.evidence[0] if o.evidence else None
    turned = np.isfinite(o.yaw_std)
    return Row(
        colour="#{:02x}{:02x}{:02x}".format(*colour),
        name=o.name,
        thing=track.name,
        shape=o.shape,
        position=metres(o.position),
        yaw=f"{np.degrees(o.yaw):.1f} ± {np.degrees(o.yaw_std):.1f}" if turned else "",
        extents=" x ".join(f"{1e3 * e:.0f}" for e in o.extents),
        spread=", ".join(f"{1e3 * s:.1f}" for s in o.position_std),
        score=f"{o.score:.2f}",
        depth="" if seen is None else f"{100 * seen.depth_share:.0f} % of {int(seen.mask.sum())} px",
        filtered=f"{metres(track.estimate.position)} ± {1e3 * track.estimate.position_std.max():.1f} mm, "
        f"{track.still} frame{'s' if track.still > 1 else ''}" + (f", moved {track.moves} x" if track.moves else ""),
        doubts="; ".join(o.doubts),
    )


def _metric_rows(figures: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    rows = []
    for key, label in SCORE_NAMES.items():
        value = figures[key]
        if isinstance(value, Mapping):
            if value["median"] is not None:
                rows.append((label, f"{value['median']:.3g}", f"{value['p95']:.3g}"))
        elif value is not None:
            rows.append((label, f"{value:.3f}", ""))
    return rows


def _fitted(picture: np.ndarray) -> np.ndarray:
    height, width = picture.shape[:2]
    if width <= WIDTH:
        return picture
    return cv2.resize(picture, (WIDTH, round(height * WIDTH / width)), interpolation=cv2.INTER_AREA)
