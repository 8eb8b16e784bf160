"""Perception on held-out pictures of random cells: boxes, masks, poses, times, by detector and segmenter.

Every frame is a picture of seeded random things, clutter, lights and surfaces at 0.5, 0.7 or 1.0 m with stereo noise.
All things that clearly show are asked for, and three that are not there. Rows:

    default                    what `replan run` and `replan perceive` use when nothing is said
    DETECTOR+SEGMENTER         any two that these commands take, for instance colour+grabcut
    bundled                    the project's own weights for both
    given boxes                the true boxes, and the default segmenter: what is lost to segmenter and geometry
    given masks                the true masks: what is lost to geometry alone
    known furniture            furniture of known shape, found by its shape without a detector: place, turn and doors

    python -m benchmarks.looking.perception --frames 300
    python -m benchmarks.looking.perception --detectors default "given masks" --frames 60 --json
    python -m benchmarks.looking.perception --condition dropout:0.3
    python -m benchmarks.looking.perception --full-size

Furniture is asked for like everything else, but its pose counts in the row "known furniture" only: nobody can tell the
size of a cabinet, or which way its doors turn, from one side of it.

Spreads are held against errors: how often an error lies within the 68 % and the 95 % interval that the estimate claims,
over what is offered; what is doubted or not seen counts as refused.

The measures stand in `perception.evaluation.metrics` and `perception.evaluation.scoring`. AP50 takes boxes down to a
score of 0.05, everything else those from the detector's own threshold on. A phrase that a detector refuses counts as
not found.
"""

import argparse
import json
import multiprocessing
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from benchmarks.looking.conditions import under_condition
from benchmarks.looking.held_out import CHUNK, HeldOutFrame, held_out_frames
from perception.catalogue.phrases import parse_phrase
from perception.detection.bundled import BundledDetector
from perception.detection.colour_shape import ColourShapeDetector
from perception.detection.detector_router import DetectorRouter
from perception.detection.given import GivenBoxes, GivenMasks
from perception.errors import ModelUnavailableError, UnknownPhraseError
from perception.evaluation.coverage import coverage_table
from perception.evaluation.recording_detector import RecordingDetector
from perception.evaluation.scoring import Scores
from perception.frames import CameraIntrinsics, RgbdFrame
from perception.interfaces import Detection, Detector
from perception.options import PerceptionOptions
from perception.pipeline import STAGES, Perception, perception_from_options

LOWEST_SCORE = 0.05  # of boxes that AP50 counts
GIVEN_BOXES, GIVEN_MASKS, KNOWN = "given boxes", "given masks", "known furniture"
ROWS = ("default", "colour+grabcut", "bundled", GIVEN_BOXES, GIVEN_MASKS, KNOWN)


@dataclass(frozen=True)
class Chunk:
    """A piece of work: some frames, through every kind of perception.

    Attributes:
        rows: Names of the kinds.
        seed, number: Which frames.
        frames: How many.
        condition: What is done to their depth, as `benchmarks.looking.conditions` names it.
    """

    rows: tuple[str, ...]
    seed: int
    number: int
    frames: int
    condition: str = "plain"


@dataclass
class Measured:
    """What one kind of perception came to.

    Attributes:
        name: Detector and segmenter.
        scores: Against the truth.
        seconds: Time of each stage and of the whole in each frame in [s].
    """

    name: str
    scores: Scores
    seconds: dict[str, list[float]] = field(default_factory=lambda: {stage: [] for stage in (*STAGES, "total")})

    def extend(self, other: "Measured") -> None:
        """Take in more frames of the same kind."""
        self.scores.extend(other.scores)
        for stage, values in other.seconds.items():
            self.seconds[stage] += values

    def as_json(self) -> dict[str, Any]:
        """All figures."""
        figures = self.scores.as_json()
        for value in figures.values():
            if isinstance(value, dict) and "by_group" in value:
                value["by_distance"] = value.pop("by_group")
        ms = {stage: round(1e3 * float(np.median(v)), 1) for stage, v in self.seconds.items() if v}
        return {"name": self.name, **figures, "ms": ms}


class Looker:
    """One kind of perception, ready to look at frame after frame.

    Args:
        row: Its name in the table.

    Raises:
        ModelUnavailableError: This package came without the weights.
    """

    def __init__(self, row: str) -> None:
        self.row = row
        parts = {"default": ("default", "default"), "bundled": ("bundled", "bundled")}.get(row)
        if row in (GIVEN_BOXES, GIVEN_MASKS, KNOWN):
            parts = ("default", "default")
        elif parts is None:
            detector, plus, segmenter = row.partition("+")
            parts = (detector, segmenter if plus else "default")
        usual = perception_from_options(*parts)
        self.threshold = operating_threshold(usual.detector)
        self._perception = perception_from_options(*parts, PerceptionOptions(threshold=LOWEST_SCORE))
        # Two rows of one name are the same: it says which detector and which segmenter.
        given = {
            GIVEN_BOXES: f"true boxes + {usual.segmenter.name}",
            GIVEN_MASKS: "true masks",
            KNOWN: "known shapes in depth",
        }
        self.name = given.get(row, usual.name)

    def load(self) -> None:
        """Look at an empty frame, so that weights are in memory before time is taken.

        Raises:
            ModelUnavailableError: They are not on this machine.
        """
        lens = CameraIntrinsics(64, 48, 60.0, 60.0, 31.5, 23.5)
        colour, depth = np.zeros((48, 64, 3), np.uint8), np.ones((48, 64), np.float32)
        frame = RgbdFrame(colour, depth, lens, np.eye(4), 0.0)
        self._perception.detector.detect(frame, ["red cube"])
        self._perception.segmenter.segment(frame, np.array([8.0, 8.0, 40.0, 40.0]))

    def look(self, item: HeldOutFrame, measured: Measured) -> None:
        """Look at one frame and add what came of it."""
        names = tuple(item.known) if self.row == KNOWN else item.names
        if not names:
            return
        perception, recorder = self._for(item)
        started = time.perf_counter()
        scene = perception.perceive([item.frame], names)
        measured.seconds["total"].append(time.perf_counter() - started)
        for stage in STAGES:
            measured.seconds[stage].append(scene.seconds[stage])
        drawn = None if self.row == KNOWN else recorder.drawn
        furniture = () if self.row == KNOWN else tuple(item.known)
        measured.scores.add(scene, item.truth, drawn, names, item.frame.camera, item.group, item.hinges_deg, furniture)

    def _for(self, item: HeldOutFrame) -> tuple[Perception, RecordingDetector]:
        detector, segmenter = self._perception.detector, self._perception.segmenter
        if self.row == GIVEN_BOXES:
            detector = GivenBoxes({o.name: o.box_px[None] for o in item.truth.objects if o.box_px is not None})
        elif self.row == GIVEN_MASKS:
            detector = segmenter = GivenMasks({o.name: o.mask for o in item.truth.objects if o.mask is not None})
        recorder = RecordingDetector(KnownPhrases(detector), self.threshold, self._perception.options)
        known = item.known if self.row == KNOWN else {}
        return replace(self._perception, detector=recorder, segmenter=segmenter, known=known), recorder


def operating_threshold(detector: Detector) -> float:
    """Lowest score of the boxes that a detector gives when nothing is said, 0..1.

    Of two detectors that share the phrases it is the one of colour and shape, which most phrases go to.
    """
    if isinstance(detector, DetectorRouter):
        detector = detector.by_colour
    if isinstance(detector, ColourShapeDetector):
        return detector.settings.threshold
    if isinstance(detector, BundledDetector):
        return detector.card.threshold
    return float(getattr(detector, "threshold", 0.0))


@dataclass(frozen=True)
class KnownPhrases:
    """A detector that is asked only what it has a way to look for; the rest it does not find."""

    detector: Detector

    @property
    def name(self) -> str:
        """Of the detector."""
        return self.detector.name

    def detect(self, frame: RgbdFrame, phrases: Sequence[str]) -> list[Detection]:
        """What the detector finds of the phrases that it knows."""
        return self.detector.detect(frame, [p for p in phrases if self._knows(p)])

    def _knows(self, phrase: str) -> bool:
        try:
            if isinstance(self.detector, ColourShapeDetector):
                parse_phrase(phrase)
            elif isinstance(self.detector, BundledDetector):
                self.detector.known_words(phrase)
            elif isinstance(self.detector, DetectorRouter):
                self.detector.is_for_learned(phrase)
        except UnknownPhraseError:
            return False
        return True


def run_chunk(chunk: Chunk) -> dict[str, Measured]:
    """Look at a chunk's frames with every kind of perception."""
    lookers = [Looker(row) for row in chunk.rows]
    for looker in lookers:
        looker.load()
    measured = {looker.row: Measured(looker.name, Scores(looker.threshold)) for looker in lookers}
    for k, original in enumerate(held_out_frames(chunk.seed, chunk.number, chunk.frames)):
        rng = np.random.default_rng([chunk.seed, chunk.number, k])
        item = replace(original, frame=under_condition(original.frame, chunk.condition, rng))
        for looker in lookers:
            looker.look(item, measured[looker.row])
    return measured


def run_all(chunks: Sequence[Chunk], workers: int) -> Iterator[dict[str, Measured]]:
    """Do all chunks, in processes of their own where there are several workers, in order."""
    if workers == 1:
        yield from map(run_chunk, chunks)
        return
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield from pool.map(run_chunk, chunks)


def measure(
    rows: Sequence[str], frames: int, seed: int, workers: int, condition: str = "plain"
) -> dict[str, dict[str, Any]]:
    """Figures by row, the rows in the order that they are given in.

    Args:
        rows: Kinds of perception, as this module's docstring names them.
        frames: How many frames each of them looks at.
        seed: Of the frames.
        workers: Processes.
        condition: What is done to the frames' depth, as `benchmarks.looking.conditions` names it.
    """
    names: dict[str, str] = {}  # row to what it is; rows that are the same are measured once
    missing: dict[str, str] = {}
    for row in dict.fromkeys(rows):
        try:
            looker = Looker(row)
            looker.load()
            names[row] = looker.name
        except ModelUnavailableError as error:
            missing[row] = str(error)
    once = tuple({name: row for row, name in reversed(names.items())}.values())[::-1]
    chunks = [Chunk(once, seed, k, min(CHUNK, frames - k * CHUNK), condition) for k in range(-(-frames // CHUNK))]
    done: dict[str, Measured] = {}
    started = time.monotonic()
    for count, part in enumerate(run_all(chunks, workers), 1):
        for row, measured in part.items():
            if row in done:
                done[row].extend(measured)
            else:
                done[row] = measured
        seen = sum(c.frames for c in chunks[:count])
        left = (time.monotonic() - started) / count * (len(chunks) - count)
        print(f"[{seen}/{frames} frames] {left:.0f} s left", file=sys.stderr, flush=True)
    result: dict[str, dict[str, Any]] = {}
    for row in dict.fromkeys(rows):
        if row in missing:
            result[row] = {"name": row, "unavailable": missing[row]}
        else:
            same = next(r for r in once if names[r] == names[row])
            result[row] = {**done[same].as_json(), "seed": seed, "condition": condition}
    return result


def table(figures: dict[str, dict[str, Any]]) -> str:
    """The figures as text."""

    def cell(value: Any) -> str:
        if isinstance(value, dict):
            return "-" if value["median"] is None else f"{value['median']:.1f}/{value['p95']:.1f}"
        return "-" if value is None else f"{value:.3f}"

    columns = (
        ("ap50", "AP50", 7),
        ("recall", "recall", 8),
        ("absent_false_positive_rate", "absent", 8),
        ("mask_iou", "mask IoU", 10),
        ("posed", "posed", 7),
        ("position_mm", "position mm", 13),
        ("yaw_deg", "yaw deg", 11),
        ("extent_mm", "extents mm", 12),
        ("error_by_spread", "err/spread", 12),
        ("door_angle_deg", "door deg", 11),
    )
    lines = [f"{'':16}" + "".join(f"{label:>{width}}" for _, label, width in columns) + f"{'ms a frame':>12}"]
    for row, values in figures.items():
        if "unavailable" in values:
            lines.append(f"{row:16} not measured: {values['unavailable']}")
            continue
        cells = "".join(f"{cell(values[key]):>{width}}" for key, _, width in columns)
        lines.append(f"{row:16}{cells}{values['ms']['total']:>12.0f}")
        for group, at in values["position_mm"].get("by_distance", {}).items():
            near = {key: values[key]["by_distance"][group] for key in ("yaw_deg", "extent_mm", "error_by_spread")}
            cells = f"{cell(at):>{13}}" + "".join(f"{cell(near[k]):>{w}}" for k, _, w in columns if k in near)
            lines.append(f"{'  at ' + group:16}{'':40}{cells}")
    lines.append("")
    lines += [f"{row}: {values['name']}" for row, values in figures.items() if "unavailable" not in values]
    for row, values in figures.items():
        if "spreads" in values:
            lines += ["", f"{row}, spreads:", coverage_table(values["spreads"])]
    counted = next((v for v in figures.values() if "n_frames" in v), None)
    if counted is not None:
        lines.append(
            f"{counted['n_frames']} frames, {counted['n_objects']} things; absent: share of absent things answered "
            "with a box; posed: share of things that got a pose; median/95 % quantile"
        )
    return "\n".join(lines)


def main() -> int:
    """Run the benchmark; returns the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--detectors", nargs="+", default=list(ROWS), metavar="ROW", help=", ".join(ROWS))
    parser.add_argument("--frames", type=int, default=300, help="held-out frames, all through every row")
    parser.add_argument("--seed", type=int, default=0, help="of the frames")
    parser.add_argument("--condition", default="plain", help="of the depth: plain, dropout:SHARE or scale:FACTOR")
    parser.add_argument("--jobs", type=int, default=1, help="processes; times count with 1 only")
    parser.add_argument("--full-size", action="store_true", help="instead: cost of full-size models, random weights")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    args = parser.parse_args()
    if args.frames < 1 or args.jobs < 1:
        parser.error("--frames and --jobs must be at least 1")
    if args.full_size:
        from benchmarks.looking.full_size import costs, costs_table

        report = costs()
        print(json.dumps(report) if args.json else costs_table(report))
        return 0
    figures = measure(args.detectors, args.frames, args.seed, args.jobs, args.condition)
    print(json.dumps(figures) if args.json else table(figures))
    return 0


if __name__ == "__main__":
    sys.exit(main())
