"""Perception alone, on recorded frames: objects.json, pictures, point clouds and one page to look at."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import degrees
from pathlib import Path
from typing import Any

from control.errors import ConfigError
from perception.detection.given import BoxesByFrame, MasksByFrame
from perception.errors import FrameError
from perception.estimates import SceneEstimate, Unseen
from perception.evaluation.recording_detector import RecordingDetector
from perception.evaluation.scoring import Scores, scores_text
from perception.geometry.ply import write_ply
from perception.pictures import overlay
from perception.pipeline import Perception, perception_from_options
from perception.recordings.opening import Skipped
from perception.scene_file import LookRecord
from perception.tracking.tracker import Track, Tracker
from replan.errors import DONE, NOT_REACHED
from replan.perceive.frame_stream import FrameStream, KeyedFrame
from replan.perceive.options import Perceiving, RecordingChoice
from replan.perceive.result_file import ResultFile
from replan.perceive.tally import Tally
from replan.progress import Progress
from sim_check.cells.loading import load_cell
from sim_check.furniture.known_models import known_models
from sim_check.models.known_forms import known_forms

FEW = 20  # frames of a recording whose point clouds are written unless it is said otherwise


@dataclass(frozen=True)
class PerceiveReport:
    """What was found in a recording.

    Attributes:
        source: Which detector and segmenter, plainly named.
        tally: What the frames add up to.
        skipped: What could not be used.
        finished: Whether the recording was read to its end.
        metrics: Measured against the recording's truth; None where it has none.
        tracks: Things as they were known at the end.
        out: Folder of everything that was written.
        page: The page, or None.
        notes: How the recording was read and what was not written, for people.
    """

    source: str
    tally: Tally
    skipped: tuple[Skipped, ...]
    finished: bool
    metrics: Mapping[str, Any] | None
    tracks: tuple[Track, ...]
    out: Path
    page: Path | None
    notes: tuple[str, ...]

    @property
    def exit_code(self) -> int:
        """0 when anything was found, else 3."""
        return DONE if any(self.tally.found.values()) else NOT_REACHED


def perceive_recording(choice: RecordingChoice, how: Perceiving) -> PerceiveReport:
    """Run perception on the frames of a recording, one after the other.

    A frame that cannot be used is skipped and named. When the program is interrupted (KeyboardInterrupt) what was done
    so far is kept, page included.

    Args:
        choice: The recording and its frames.
        how: What to look for and what to write.

    Raises:
        FrameError: The recording, or every single frame of it, cannot be used; or boxes or masks are not valid.
        ConfigError: The output folder cannot be written.
        ModelUnavailableError, UnknownPhraseError: As `perception.pipeline.Perception.perceive` raises them.
    """
    return _Run(choice, how).report()


class _Run:
    """One recording as it goes through; holds what adds up, and one frame."""

    def __init__(self, choice: RecordingChoice, how: Perceiving) -> None:
        self._how = how
        self._stream = FrameStream(choice)
        self._given: BoxesByFrame | MasksByFrame | None = None
        if how.boxes is not None:
            self._given = BoxesByFrame(how.boxes, self._stream.keys)
        elif how.masks is not None:
            self._given = MasksByFrame(how.masks, self._stream.keys)
        self._names = how.names or (self._given.names if self._given else ())
        known = {} if how.cell is None else known_models(load_cell(how.cell).furniture)
        embedded = perception_from_options(how.detector, how.segmenter, how.options, known, known_forms())
        self._perception = replace(embedded, instances=how.instances)
        self._hinges_deg = {p.name: degrees(p.opened) for m in known.values() for p in m.parts if p.kind == "hinge"}
        self._source = self._perception_for(None)[0].name
        self._clouds = how.clouds
        if self._clouds is None:
            self._clouds = self._stream.total is not None and self._stream.total <= FEW
        self._tracker, self._scores = Tracker(), Scores()
        self._skipped: list[Skipped] = []
        self._tally = Tally(self._names)
        self._scored = False

    def _perception_for(self, key: str | None) -> tuple[Perception, RecordingDetector]:
        """Perception as it looks at one frame, and its detector, which tells all boxes that it drew."""
        detector, segmenter = self._perception.detector, self._perception.segmenter
        if isinstance(self._given, BoxesByFrame):
            detector = self._given.of(key or "")
        elif isinstance(self._given, MasksByFrame):
            detector = segmenter = self._given.of(key or "")
        overheard = RecordingDetector(detector, options=self._perception.options)
        return replace(self._perception, detector=overheard, segmenter=segmenter), overheard

    def report(self) -> PerceiveReport:
        """Go through the recording and write everything."""
        from replan.perceive.page import PerceivePage

        how, stream = self._how, self._stream
        try:
            how.out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigError(
                f"cannot write to {how.out}: {error.strerror}; choose another folder with --out"
            ) from error
        for note in stream.recording.notes:
            how.say(note)
        page = PerceivePage() if how.page else None
        interrupted: KeyboardInterrupt | None = None
        with ResultFile(how.out / "objects.json", self._source, how.out) as file:
            try:
                with Progress("frame", stream.total, how.say, how.quiet) as progress:
                    for item in stream:
                        self._take_in(item, file, page, progress)
            except KeyboardInterrupt as stop:
                interrupted = stop
            self._note_unreadable(file)
            metrics = self._scores.as_json() if self._scored else None
            file.finish(interrupted is None, metrics)
        if not self._tally.frames and interrupted is None:
            first = self._skipped[0]
            raise FrameError(
                f"no frame of '{stream.recording.name}' can be used ({len(self._skipped)} skipped); "
                f"first {first.where}: {first.reason}"
            )
        report = PerceiveReport(
            self._source,
            self._tally,
            tuple(self._skipped),
            interrupted is None,
            metrics,
            self._tracker.tracks,
            how.out,
            how.out / "report.html" if page is not None and self._tally.frames else None,
            self._notes(),
        )
        if page is not None and report.page is not None:
            page.write(report, stream.recording.name, report.page)
        if interrupted is not None:
            how.say(f"stopped after {self._tally.frames} frames; they are in {how.out}")
            raise interrupted
        return report

    def _take_in(self, item: KeyedFrame, file: ResultFile, page: Any, progress: Progress) -> None:
        """Look at one frame and write what was found."""
        how, frame = self._how, item.frame
        self._note_unreadable(file)
        started = time.perf_counter()
        try:
            perception, detector = self._perception_for(item.key)
            scene = perception.perceive([frame], self._names)
        except FrameError as error:
            self._skip(Skipped(f"frame {item.key}", str(error)), file)
            progress.step(f"skipped: {error}")
            return
        seconds = time.perf_counter() - started
        scene = self._with_given_reasons(scene)
        tracks = self._tracker.update(scene.objects)
        if item.truth is not None:
            self._scored = True
            self._scores.add(scene, item.truth, detector.drawn, self._names, frame.camera, hinges_deg=self._hinges_deg)
        stem = f"frame_{item.key}_{frame.camera}".replace("/", "_").replace(" ", "_")
        picture, drawn = how.out / f"{stem}.png", overlay(frame, scene)
        _write_picture(picture, drawn)
        cloud = picture.with_suffix(".ply") if self._clouds else None
        if cloud is not None:
            write_ply(frame, cloud)
        file.add(LookRecord.of(scene, frame.camera, picture, cloud, item.key, tracks))
        self._tally.add(item, scene, tracks, seconds)
        if page is not None:
            page.add(item, scene, tracks, drawn, picture)
        progress.step(f"{', '.join(scene.names) or 'nothing'} found")

    def _with_given_reasons(self, scene: SceneEstimate) -> SceneEstimate:
        """Where boxes or masks are given, a name without one was not missed by a detector."""
        if self._given is None:
            return scene
        what = "box" if isinstance(self._given, BoxesByFrame) else "mask"
        unseen = (
            Unseen(u.name, f"no {what} was given for this frame") if u.reason == "no box above the threshold" else u
            for u in scene.unseen
        )
        return replace(scene, unseen=tuple(unseen))

    def _note_unreadable(self, file: ResultFile) -> None:
        for skipped in self._stream.newly_skipped():
            self._skip(skipped, file)

    def _skip(self, skipped: Skipped, file: ResultFile) -> None:
        self._skipped.append(skipped)
        file.skip(skipped.where, skipped.reason)

    def _notes(self) -> tuple[str, ...]:
        notes = list(self._stream.recording.notes)
        if not self._clouds and self._how.clouds is None:
            known = self._stream.total is not None
            why = f"there are more than {FEW} frames" if known else "such a recording may be of any length"
            notes.append(f"no point clouds were written, as {why}; --clouds writes them")
        if self._given is not None and self._stream.keys is None:
            notes.append("frames are numbered as they were read, from 0; boxes and masks go by these numbers")
        return tuple(notes)


def _write_picture(path: Path, picture: Any) -> None:
    import cv2

    if not cv2.imwrite(str(path), picture[:, :, ::-1]):
        raise ConfigError(f"cannot write the picture {path}; is there room, and may the folder be written to?")


def as_json(report: PerceiveReport) -> dict[str, Any]:
    """As one JSON object: what is in objects.json, and where everything was written."""
    import json

    content = json.loads((report.out / "objects.json").read_text(encoding="utf-8"))
    page = None if report.page is None else str(report.page)
    return {**content, "page": page, "notes": list(report.notes), **report.tally.as_json()}


def as_text(report: PerceiveReport) -> str:
    """For people: a line an object while there are few frames, else a line a name; what was skipped and written."""
    lines = [f"perception: {report.source}", *report.tally.as_lines()]
    if report.skipped:
        lines.append(f"{len(report.skipped)} skipped:")
        lines += [f"  {s.where}: {s.reason}" for s in report.skipped[:10]]
        if len(report.skipped) > 10:
            lines.append(f"  ... and {len(report.skipped) - 10} more, all named in {report.out / 'objects.json'}")
    if report.metrics is not None:
        lines.append(scores_text(report.metrics))
    lines += [f"note: {note}" for note in report.notes]
    lines.append(f"written: {report.page or report.out / 'objects.json'}")
    return "\n".join(lines)
