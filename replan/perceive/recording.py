"""Perception alone, on recorded frames: objects.json, pictures, point clouds and one page to look at."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from control.errors import ConfigError
from perception.errors import FrameError
from perception.evaluation.scoring import Scores
from perception.geometry.ply import write_ply
from perception.pictures import overlay
from perception.recordings.opening import Skipped
from perception.scene_file import LookRecord
from perception.tracking.tracker import Tracker
from replan.perceive.frame_stream import FrameStream, KeyedFrame
from replan.perceive.looking import FramePerception
from replan.perceive.options import PerceiveOptions, ReadingOptions
from replan.perceive.report import PerceiveReport
from replan.perceive.result_file import ResultFile
from replan.perceive.tally import Tally
from replan.progress import Progress

FEW = 20  # frames of a recording whose point clouds are written unless it is said otherwise


def perceive_recording(
    recording: Path,
    options: PerceiveOptions,
    reading: ReadingOptions | None = None,
    say: Callable[[str], None] = lambda text: None,
    quiet: bool = False,
) -> PerceiveReport:
    """Run perception on the frames of a recording, one after the other.

    A frame that cannot be used is skipped and named. When the program is interrupted (KeyboardInterrupt) what was done
    so far is kept, page included.

    Args:
        recording: Folder of PNG pairs, BOP scene, MCAP or .npz file, see `perception.recordings.opening`.
        options: What to look for and what to write.
        reading: Which frames; None for all.
        say: Progress for people, one line a call.
        quiet: Whether to draw no bar on a terminal; `say` gets lines then.

    Raises:
        FrameError: The recording, or every single frame of it, cannot be used; or boxes or masks are not valid.
        ConfigError: The output folder cannot be written.
        ModelUnavailableError, UnknownPhraseError: As `perception.pipeline.Perception.perceive` raises them.
    """
    return _Run(FrameStream(recording, reading or ReadingOptions()), options, say, quiet).report()


class _Run:
    """One recording as it goes through; holds what adds up, and one frame."""

    def __init__(self, stream: FrameStream, options: PerceiveOptions, say: Callable[[str], None], quiet: bool) -> None:
        self._stream, self._options, self._say, self._quiet = stream, options, say, quiet
        self._perception = FramePerception(options, stream.keys)
        self._clouds = options.clouds
        if self._clouds is None:
            self._clouds = stream.total is not None and stream.total <= FEW
        self._tracker, self._scores = Tracker(), Scores()
        self._skipped: list[Skipped] = []
        self._tally = Tally(self._perception.names)
        self._scored = False

    def report(self) -> PerceiveReport:
        """Go through the recording and write everything."""
        from replan.perceive.page import PerceivePage

        out, stream = self._options.out, self._stream
        try:
            out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigError(f"cannot write to {out}: {error.strerror}; choose another folder with --out") from error
        for note in stream.recording.notes:
            self._say(note)
        page = PerceivePage() if self._options.page else None
        interrupted: KeyboardInterrupt | None = None
        with ResultFile(out / "objects.json", self._perception.source, out) as file:
            try:
                with Progress("frame", stream.total, self._say, self._quiet) as progress:
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
            self._perception.source,
            self._tally,
            tuple(self._skipped),
            interrupted is None,
            metrics,
            self._tracker.tracks,
            out,
            out / "report.html" if page is not None and self._tally.frames else None,
            self._notes(),
        )
        if page is not None and report.page is not None:
            page.write(report, stream.recording.name, report.page)
        if interrupted is not None:
            self._say(f"stopped after {self._tally.frames} frames; they are in {out}")
            raise interrupted
        return report

    def _take_in(self, item: KeyedFrame, file: ResultFile, page: Any, progress: Progress) -> None:
        """Look at one frame and write what was found."""
        frame = item.frame
        self._note_unreadable(file)
        started = time.perf_counter()
        try:
            scene, detector = self._perception.look(item)
        except FrameError as error:
            self._skip(Skipped(f"frame {item.key}", str(error)), file)
            progress.step(f"skipped: {error}")
            return
        seconds = time.perf_counter() - started
        tracks = self._tracker.update(scene.objects)
        if item.truth is not None:
            self._scored = True
            names, hinges = self._perception.names, self._perception.hinges_deg
            self._scores.add(scene, item.truth, detector.drawn, names, frame.camera, hinges_deg=hinges)
        stem = f"frame_{item.key}_{frame.camera}".replace("/", "_").replace(" ", "_")
        picture, drawn = self._options.out / f"{stem}.png", overlay(frame, scene)
        _write_picture(picture, drawn)
        cloud = picture.with_suffix(".ply") if self._clouds else None
        if cloud is not None:
            write_ply(frame, cloud)
        file.add(LookRecord.of(scene, frame.camera, picture, cloud, item.key, tracks))
        self._tally.add(item, scene, tracks, seconds)
        if page is not None:
            page.add(item, scene, tracks, drawn, picture)
        progress.step(f"{', '.join(scene.names) or 'nothing'} found")

    def _note_unreadable(self, file: ResultFile) -> None:
        for skipped in self._stream.newly_skipped():
            self._skip(skipped, file)

    def _skip(self, skipped: Skipped, file: ResultFile) -> None:
        self._skipped.append(skipped)
        file.skip(skipped.where, skipped.reason)

    def _notes(self) -> tuple[str, ...]:
        notes = list(self._stream.recording.notes)
        if not self._clouds and self._options.clouds is None:
            known = self._stream.total is not None
            why = f"there are more than {FEW} frames" if known else "such a recording may be of any length"
            notes.append(f"no point clouds were written, as {why}; --clouds writes them")
        if self._perception.given is not None and self._stream.keys is None:
            notes.append("frames are numbered as they were read, from 0; boxes and masks go by these numbers")
        return tuple(notes)


def _write_picture(path: Path, picture: Any) -> None:
    import cv2

    if not cv2.imwrite(str(path), picture[:, :, ::-1]):
        raise ConfigError(f"cannot write the picture {path}; is there room, and may the folder be written to?")
