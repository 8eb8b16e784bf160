"""Recorded RGB-D frames from files: folders of PNG pairs with an intrinsics file, and the project's own .npz.

A folder holds pairs of a colour picture (PNG or JPEG) and a 16-bit depth PNG registered to it, found by name:

    <prefix>depth<anything>.png   with   <prefix>(color|colour|rgb)<anything>.(png|jpg|jpeg)
    depth/<stem>.png              with   (color|colour|rgb)/<stem>.(png|jpg|jpeg)

and an intrinsics file, YAML or JSON, the only such file of the folder or given by path:

    width: 640            # or xres
    height: 480           # or yres
    fx: 610.0
    fy: 610.0
    cx: 319.5
    cy: 239.5
    depth_scale: 0.001    # metres per unit of the depth picture; 0 means unknown
    camera: static        # optional
    world_T_camera: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]   # optional, for all frames
    frames:               # optional, by the depth file's name without .png
      "000002-depth": {stamp: 0.0, world_T_camera: [...]}

Without world_T_camera the plane that things stand on becomes the world's z = 0 (`perception.levelling`).
"""

import json
import re
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from pydantic import AliasChoices, BaseModel, ConfigDict, Field, ValidationError

from perception.errors import FrameError
from perception.frames import CameraIntrinsics, RgbdFrame
from perception.levelling import camera_above_plane

COLOUR_WORDS = ("color", "colour", "rgb")
COLOUR_ENDINGS = (".png", ".jpg", ".jpeg")
NPZ_FORMAT = "rgbd-frames-1"

Row = tuple[float, float, float, float]
Matrix = tuple[Row, Row, Row, Row]


class FrameNotes(BaseModel):
    """What the intrinsics file may say about one frame."""

    model_config = ConfigDict(extra="forbid")
    stamp: float | None = None
    world_T_camera: Matrix | None = None


class IntrinsicsFile(BaseModel):
    """An intrinsics file; units stand in this module's docstring."""

    model_config = ConfigDict(extra="forbid")
    width: int = Field(gt=0, validation_alias=AliasChoices("width", "xres"))
    height: int = Field(gt=0, validation_alias=AliasChoices("height", "yres"))
    fx: float = Field(gt=0)
    fy: float = Field(gt=0)
    cx: float
    cy: float
    depth_scale: float = Field(default=0.001, gt=0)
    camera: str = Field(default="camera", validation_alias=AliasChoices("camera", "camera_name"))
    world_T_camera: Matrix | None = None
    frames: dict[str, FrameNotes] = Field(default_factory=dict)

    @property
    def intrinsics(self) -> CameraIntrinsics:
        """As the frame type wants them."""
        return CameraIntrinsics(self.width, self.height, self.fx, self.fy, self.cx, self.cy)


@dataclass(frozen=True)
class PngFolder:
    """Pairs of a folder; iterating reads one frame after the other.

    Attributes:
        pairs: (colour file, depth file) in the order of their names.
        notes: Intrinsics file.
    """

    pairs: tuple[tuple[Path, Path], ...]
    notes: IntrinsicsFile

    def __len__(self) -> int:
        return len(self.pairs)

    def __iter__(self) -> Iterator[RgbdFrame]:
        for i, (colour, depth) in enumerate(self.pairs):
            yield self._read(i, colour, depth)

    def _read(self, index: int, colour_file: Path, depth_file: Path) -> RgbdFrame:
        colour = self._picture("colour", colour_file, cv2.IMREAD_COLOR)
        depth = self._picture("depth", depth_file, cv2.IMREAD_UNCHANGED)
        if depth.ndim != 2 or depth.dtype != np.uint16:
            raise FrameError(
                f"the depth picture '{depth_file}' is {depth.dtype} of shape {depth.shape}; "
                "it must be a 16-bit picture of one channel (metres = value x depth_scale, 0 = unknown)"
            )
        metres = np.where(depth > 0, depth * np.float32(self.notes.depth_scale), np.nan).astype(np.float32)
        note = self.notes.frames.get(depth_file.stem, FrameNotes())
        pose = note.world_T_camera or self.notes.world_T_camera
        if pose is not None:
            world_T_camera = np.array(pose, float)
        else:
            world_T_camera = camera_above_plane(metres, self.notes.intrinsics)
        return RgbdFrame(
            cv2.cvtColor(colour, cv2.COLOR_BGR2RGB),
            metres,
            self.notes.intrinsics,
            world_T_camera,
            float(index) if note.stamp is None else note.stamp,
            self.notes.camera,
        )

    def _picture(self, what: str, file: Path, flag: int) -> np.ndarray:
        picture = cv2.imread(str(file), flag)
        if picture is None:
            raise FrameError(f"the {what} picture '{file}' cannot be read as a picture")
        if picture.shape[:2] != (self.notes.height, self.notes.width):
            raise FrameError(
                f"the {what} picture '{file}' is {picture.shape[1]}x{picture.shape[0]}; the intrinsics file says "
                f"{self.notes.width}x{self.notes.height}: register depth to colour, or correct the file"
            )
        return picture


@dataclass(frozen=True)
class NpzRecording:
    """Frames of the project's own .npz file.

    Attributes:
        path: The file.
        count: Number of frames.
    """

    path: Path
    count: int

    def __len__(self) -> int:
        return self.count

    def __iter__(self) -> Iterator[RgbdFrame]:
        with np.load(self.path, allow_pickle=False) as data:
            for i in range(self.count):
                try:
                    k = data[f"{i}/intrinsics"]
                    yield RgbdFrame(
                        data[f"{i}/colour"],
                        data[f"{i}/depth"],
                        CameraIntrinsics(int(k[0]), int(k[1]), *(float(x) for x in k[2:6])),
                        data[f"{i}/world_T_camera"],
                        float(data[f"{i}/stamp"]),
                        str(data[f"{i}/camera"]),
                    )
                except (KeyError, ValueError, IndexError, TypeError, zipfile.BadZipFile) as error:
                    raise FrameError(f"frame {i} of '{self.path}' is damaged: {error}") from error


def save_npz(path: Path, frames: Sequence[RgbdFrame]) -> None:
    """Write frames to the project's own .npz file; `open_recording` reads it.

    Args:
        path: File to write, ending in .npz.
        frames: Any number, of any cameras.
    """
    arrays: dict[str, Any] = {"format": np.array(NPZ_FORMAT), "count": np.array(len(frames))}
    for i, frame in enumerate(frames):
        k = frame.intrinsics
        arrays[f"{i}/colour"], arrays[f"{i}/depth"] = frame.colour, frame.depth
        arrays[f"{i}/intrinsics"] = np.array([k.width, k.height, k.fx, k.fy, k.cx, k.cy], float)
        arrays[f"{i}/world_T_camera"] = frame.world_T_camera
        arrays[f"{i}/stamp"], arrays[f"{i}/camera"] = np.array(frame.stamp), np.array(frame.camera)
    np.savez_compressed(path, **arrays)


def open_recording(path: Path | str, intrinsics: Path | str | None = None) -> PngFolder | NpzRecording:
    """Open recorded frames; iterate over the answer to read them.

    Args:
        path: A folder of PNG pairs, or an .npz file written by `save_npz`.
        intrinsics: Intrinsics file of a folder, where it is not the only one inside.

    Raises:
        FrameError: Nothing there, no pairs, a picture without its partner, or an intrinsics file that is missing or
            not valid. Reading a frame later raises it for wrong sizes and types.
    """
    path = Path(path)
    if path.is_dir():
        notes = _read_intrinsics(Path(intrinsics) if intrinsics else _find_intrinsics(path))
        return PngFolder(_find_pairs(path), notes)
    if not path.exists():
        raise FrameError(f"there is no recording '{path}'; give a folder of PNG pairs or an .npz file")
    if path.suffix.lower() != ".npz":
        raise FrameError(f"'{path}' is neither a folder of PNG pairs nor an .npz file")
    try:
        with np.load(path, allow_pickle=False) as data:
            if "format" not in data or str(data["format"]) != NPZ_FORMAT:
                raise FrameError(f"'{path}' is not a dump of frames: its 'format' is not '{NPZ_FORMAT}'")
            return NpzRecording(path, int(data["count"]))
    except (ValueError, OSError, KeyError, zipfile.BadZipFile) as error:
        raise FrameError(f"'{path}' cannot be read as an .npz file: {error}") from error


def _find_intrinsics(folder: Path) -> Path:
    files = sorted(f for f in folder.iterdir() if f.suffix.lower() in (".yaml", ".yml", ".json"))
    if len(files) != 1:
        found = ", ".join(f.name for f in files) or "none"
        raise FrameError(
            f"the folder '{folder}' needs exactly one intrinsics file (.yaml or .json with width, height, fx, fy, cx, "
            f"cy, depth_scale); found {found}; add one or name it"
        )
    return files[0]


def _read_intrinsics(file: Path) -> IntrinsicsFile:
    try:
        text = file.read_text(encoding="utf-8")
        data = json.loads(text) if file.suffix.lower() == ".json" else yaml.safe_load(text)
    except (OSError, UnicodeDecodeError, json.JSONDecodeError, yaml.YAMLError) as error:
        raise FrameError(f"the intrinsics file '{file}' cannot be read: {error}") from error
    try:
        return IntrinsicsFile.model_validate(data)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "file"
        raise FrameError(
            f"the intrinsics file '{file}' is not valid: {where}: {first['msg']}; valid keys are "
            f"{sorted(IntrinsicsFile.model_fields)}"
        ) from error


def _find_pairs(folder: Path) -> tuple[tuple[Path, Path], ...]:
    """Colour and depth files by name.

    Raises:
        FrameError: No depth picture, or a depth picture without its colour picture, or the other way round.
    """
    pairs = []
    colours = {f for f in _pictures(folder) if any(w in f.name.lower() for w in COLOUR_WORDS)}
    used = set()
    for depth in sorted(f for f in _pictures(folder) if "depth" in f.name.lower() and f.suffix.lower() == ".png"):
        prefix = re.split("depth", depth.name, flags=re.IGNORECASE)[0]
        fits = sorted(c for c in colours if c.name.startswith(prefix) and _begins_with_colour(c.name[len(prefix) :]))
        if len(fits) != 1:
            names = ", ".join(f.name for f in fits) or "none"
            raise FrameError(
                f"the depth picture '{depth}' needs one colour picture '{prefix}color*.png' "
                f"(or colour, rgb; or .jpg) beside it; found {names}"
            )
        pairs.append((fits[0], depth))
        used.add(fits[0])
    lonely = sorted(c for c in colours - used if "mask" not in c.name.lower())
    if (folder / "depth").is_dir():
        beside = next((folder / w for w in COLOUR_WORDS if (folder / w).is_dir()), folder / "rgb")
        for depth in sorted(f for f in _pictures(folder / "depth") if f.suffix.lower() == ".png"):
            fit = next(
                (beside / (depth.stem + e) for e in COLOUR_ENDINGS if (beside / (depth.stem + e)).is_file()), None
            )
            if fit is None:
                raise FrameError(f"the depth picture '{depth}' has no colour picture '{beside / depth.stem}.png'")
            pairs.append((fit, depth))
    if lonely:
        raise FrameError(f"the colour picture '{lonely[0]}' has no depth picture beside it")
    if not pairs:
        raise FrameError(
            f"the folder '{folder}' holds no pairs: name them '<prefix>color.png' and '<prefix>depth.png', "
            "or put them into 'rgb/' and 'depth/' under equal names"
        )
    return tuple(pairs)


def _pictures(folder: Path) -> list[Path]:
    return [f for f in folder.iterdir() if f.is_file() and f.suffix.lower() in COLOUR_ENDINGS]


def _begins_with_colour(rest: str) -> bool:
    return rest.lower().startswith(COLOUR_WORDS)
