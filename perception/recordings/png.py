"""Folders of pairs: a colour picture (PNG or JPEG) and a 16-bit depth PNG registered to it, found by name.

    <prefix>depth<anything>.png   with   <prefix>(color|colour|rgb)<anything>.(png|jpg|jpeg)
    depth/<stem>.png              with   (color|colour|rgb)/<stem>.(png|jpg|jpeg)

and an intrinsics file (`perception.recordings.intrinsics_file`), the only such file of the folder or given by path.
Without a pose in it the plane that things stand on becomes the world's z = 0 (`perception.geometry.gravity_alignment`).
"""

import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np

from perception.depth_units import checked_scale, depth_in_metres
from perception.errors import FrameError
from perception.frames import RgbdFrame
from perception.geometry.gravity_alignment import camera_above_plane
from perception.picture_bytes import decode_picture
from perception.recordings.base import Recording, Skipped, TruthOfFrame
from perception.recordings.intrinsics_file import FrameNotes, IntrinsicsFile, find_intrinsics, read_intrinsics

COLOUR_WORDS = ("color", "colour", "rgb")
COLOUR_ENDINGS = (".png", ".jpg", ".jpeg")


class PngFolder(Recording):
    """Pairs of a folder, in the order of their names.

    Args:
        folder: The folder.
        intrinsics: Its intrinsics file where it is not the only such file inside.
        depth_scale: Metres per unit of the depth pictures, whatever the intrinsics file says; None to go by that file.

    Raises:
        FrameError: No pairs, a picture without its partner, an intrinsics file that is missing or not valid, or depth
            in an unknown unit.
    """

    def __init__(self, folder: Path, intrinsics: Path | None = None, depth_scale: float | None = None) -> None:
        self._file = read_intrinsics(intrinsics or find_intrinsics(folder))
        self._pairs = find_pairs(folder)
        said = self._file.depth_scale if depth_scale is None else depth_scale
        first = None if said else first_depth(depth for _, depth in self._pairs)
        self._scale, note = checked_scale(said, first, f"the depth pictures of '{folder}'")
        super().__init__(folder.name, len(self._pairs), notes=(note,) if note else ())

    def _items(self, with_truth: bool) -> Iterator[TruthOfFrame | Skipped]:
        for i, (colour, depth) in enumerate(self._pairs):
            try:
                yield TruthOfFrame(self._read(i, colour, depth), None)
            except FrameError as error:
                yield Skipped(depth.name, str(error))

    def _read(self, index: int, colour_file: Path, depth_file: Path) -> RgbdFrame:
        colour = read_picture("colour", colour_file, cv2.IMREAD_COLOR)
        depth = read_picture("depth", depth_file, cv2.IMREAD_UNCHANGED)
        for what, picture, file in (("colour", colour, colour_file), ("depth", depth, depth_file)):
            self._check_size(what, picture, file)
        metres = depth_in_metres(depth, self._scale, f"the depth picture '{depth_file}'")
        note = self._file.frames.get(depth_file.stem, FrameNotes())
        pose = note.world_T_camera or self._file.world_T_camera
        if pose is not None:
            world_T_camera = np.array(pose, float)
        else:
            world_T_camera = camera_above_plane(metres, self._file.intrinsics)
        return RgbdFrame(
            np.asarray(cv2.cvtColor(colour, cv2.COLOR_BGR2RGB), np.uint8),
            metres,
            self._file.intrinsics,
            world_T_camera,
            float(index) if note.stamp is None else note.stamp,
            self._file.camera,
        )

    def _check_size(self, what: str, picture: np.ndarray, file: Path) -> None:
        lens: IntrinsicsFile = self._file
        if picture.shape[:2] != (lens.height, lens.width):
            raise FrameError(
                f"the {what} picture '{file}' is {picture.shape[1]}x{picture.shape[0]}; the intrinsics file says "
                f"{lens.width}x{lens.height}: register depth to colour, or correct the file"
            )


def read_picture(what: str, file: Path, flag: int) -> np.ndarray:
    """A picture as OpenCV reads it.

    Args:
        what: For the message, for instance "colour".
        file: PNG or JPEG.
        flag: One of OpenCV's IMREAD flags.

    Raises:
        FrameError: There is no such file, or it cannot be read as a picture.
    """
    try:
        data = file.read_bytes()
    except OSError as error:
        raise FrameError(f"the {what} picture '{file}' cannot be read: {error.strerror}") from error
    return decode_picture(data, flag, f"the {what} picture '{file}'")


def first_depth(files: Iterable[Path]) -> np.ndarray | None:
    """The first of some depth pictures that can be read; None where none can."""
    for file in files:
        with suppress(FrameError):
            return read_picture("depth", file, cv2.IMREAD_UNCHANGED)
    return None


def find_pairs(folder: Path) -> tuple[tuple[Path, Path], ...]:
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
