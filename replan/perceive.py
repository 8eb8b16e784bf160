"""Perception alone, on recorded frames: objects.json, an overlay picture and a coloured point cloud a frame."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from control.errors import ConfigError
from perception.estimates import SceneEstimate
from perception.options import PerceptionOptions
from perception.pictures import overlay
from perception.pipeline import perception_from_options
from perception.ply import write_ply
from perception.recordings import open_recording
from perception.scene_file import LookRecord, PerceptionResult
from replan.errors import DONE, NOT_REACHED


@dataclass(frozen=True)
class FrameReport:
    """What was found in one frame."""

    camera: str
    stamp: float
    scene: SceneEstimate
    picture: Path
    cloud: Path

    def as_json(self) -> dict[str, Any]:
        """As one JSON object, in the form of `perception.scene_file`."""
        return self.record.model_dump(mode="json")

    @property
    def record(self) -> LookRecord:
        """As it stands in objects.json."""
        return LookRecord.of(self.scene, self.camera, self.picture, self.cloud)


@dataclass(frozen=True)
class PerceiveReport:
    """What was found in a recording.

    Attributes:
        source: Which detector and segmenter, plainly named.
        frames: One report a frame.
        out: Folder of the pictures and objects.json.
    """

    source: str
    frames: tuple[FrameReport, ...]
    out: Path

    @property
    def exit_code(self) -> int:
        """0 when anything was found, else 3."""
        return DONE if any(f.scene.objects for f in self.frames) else NOT_REACHED

    def as_json(self) -> dict[str, Any]:
        """As one JSON object."""
        return {"source": self.source, "out": str(self.out), "frames": [f.as_json() for f in self.frames]}

    def as_text(self) -> str:
        """For people: one line an object and frame."""
        lines = [f"perception: {self.source}"]
        for f in self.frames:
            lines.append(f"frame at {f.stamp:.3f} s of camera '{f.camera}' -> {f.picture}")
            for o in f.scene.objects:
                x, y, z = o.position
                size = " x ".join(f"{1000 * e:.0f}" for e in o.extents)
                lines.append(f"  {o.name:16} {o.shape:8} at ({x:.3f}, {y:.3f}, {z:.3f}) m, {size} mm, {o.score:.2f}")
            lines += [f"  {u.name:16} not found: {u.reason}" for u in f.scene.unseen]
        return "\n".join(lines)


def perceive_recording(
    recording: Path,
    names: Sequence[str],
    out: Path,
    detector: str,
    segmenter: str,
    options: PerceptionOptions,
    say: Callable[[str], None],
    intrinsics: Path | None = None,
) -> PerceiveReport:
    """Run perception on every frame of a recording.

    Args:
        recording: Folder of PNG pairs or .npz file, see `perception.recordings`.
        names: What to look for.
        out: Folder for pictures and objects.json; made when absent.
        detector, segmenter, options: As in `perception.pipeline.perception_from_options`.
        say: Progress.
        intrinsics: Intrinsics file of a folder that holds none.

    Raises:
        FrameError: The recording or one of its frames cannot be used (names the file).
        ConfigError: No name given, or the output folder cannot be written.
    """
    import cv2

    if not names:
        raise ConfigError("no name given to look for; say --names red_cube crate")
    perception = perception_from_options(detector, segmenter, options)
    frames = open_recording(recording, intrinsics)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"cannot write to {out}: {error.strerror}; choose another folder with --out") from error
    reports = []
    for k, frame in enumerate(frames):
        scene = perception.perceive([frame], names)
        picture = out / f"frame_{k:04d}_{frame.camera}.png"
        cv2.imwrite(str(picture), overlay(frame, scene)[:, :, ::-1])
        cloud = picture.with_suffix(".ply")
        write_ply(frame, cloud)
        reports.append(FrameReport(frame.camera, frame.stamp, scene, picture, cloud))
        say(f"frame {k + 1}: {', '.join(scene.names) or 'nothing'} found")
    report = PerceiveReport(perception.name, tuple(reports), out)
    records = tuple(f.record for f in report.frames)
    PerceptionResult(source=report.source, out=str(out), frames=records).write(out / "objects.json")
    return report
