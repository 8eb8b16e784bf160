"""Perception alone, on recorded frames: objects.json, an overlay picture and a coloured point cloud a frame."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from control.errors import ConfigError
from perception.estimates import SceneEstimate
from perception.pictures import overlay
from perception.pipeline import perception_from_options
from perception.ply import write_ply
from perception.recordings import open_recording
from replan.episode import plain
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
        """As one JSON object; poses as world_T_object, lengths in [m]."""
        return {
            "camera": self.camera,
            "stamp": self.stamp,
            "picture": str(self.picture),
            "cloud": str(self.cloud),
            "objects": [
                {
                    "name": o.name,
                    "shape": o.shape,
                    "world_T_object": plain(o.world_T_object),
                    "extents": plain(o.extents),
                    "position_std": plain(o.position_std),
                    "yaw_std": plain(o.yaw_std),
                    "score": round(o.score, 3),
                    "box_px": plain(o.evidence[0].box_px) if o.evidence else None,
                    "depth_share": round(o.evidence[0].depth_share, 3) if o.evidence else None,
                }
                for o in self.scene.objects
            ],
            "unseen": plain(self.scene.unseen),
        }


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
    offline: bool,
    say: Callable[[str], None],
    intrinsics: Path | None = None,
) -> PerceiveReport:
    """Run perception on every frame of a recording.

    Args:
        recording: Folder of PNG pairs or .npz file, see `perception.recordings`.
        names: What to look for.
        out: Folder for pictures and objects.json; made when absent.
        detector, segmenter, offline: As in `perception.pipeline.perception_from_options`.
        say: Progress.
        intrinsics: Intrinsics file of a folder that holds none.

    Raises:
        FrameError: The recording or one of its frames cannot be used (names the file).
        ConfigError: No name given, or the output folder cannot be written.
    """
    import cv2

    if not names:
        raise ConfigError("no name given to look for; say --names red_cube crate")
    perception = perception_from_options(detector, segmenter, offline=offline)
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
    (out / "objects.json").write_text(json.dumps(report.as_json(), indent=1))
    return report
