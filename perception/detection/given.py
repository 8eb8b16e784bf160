"""Boxes or masks that a person drew, in the place of a detector and a segmenter; `name` says that they were given.

A file of boxes is YAML or JSON. Corners are (x0, y0, x1, y1) in [px]; x1 and y1 are just outside of the last pixel:

    boxes:                                   # in every frame
      crate: [203, 287, 335, 450]
    frames:                                  # in single frames, by their key; in the place of those above
      "000002": {sugar_box: [10, 20, 90, 60], can: [[5, 5, 40, 50], [60, 5, 95, 50]]}

A folder of masks holds pictures (PNG) of the frames' size:

    <name>.png              in every frame: pixels that are not 0 are the thing's
    <frame>_<name>.png      the same in one frame
    labels.png              in every frame: each pixel's number says whose it is; 0 is nobody's
    <frame>_labels.png      the same in one frame
    labels.yaml             what the numbers mean: {1: sugar_box, 2: can}

A name in one frame's files takes the place of the same name for every frame. Names are lower case with underscores.
Keys of frames are those of the recording (`perception.recordings.frame_keys`).
"""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import yaml
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from perception.errors import FrameError
from perception.frames import RgbdFrame
from perception.ground_truth import box_around
from perception.interfaces import Detection

NAME = r"[a-z][a-z0-9_]*"
LABELS = "labels"

Corners = tuple[float, float, float, float]
# "sugar box" is as good as sugar_box, as on the command line.
Name = Annotated[str, BeforeValidator(lambda n: n.strip().lower().replace(" ", "_")), Field(pattern=f"^{NAME}$")]


class BoxFile(BaseModel):
    """A file of boxes as it stands in this module's docstring."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)
    boxes: dict[Name, Corners | tuple[Corners, ...]] = Field(default_factory=dict)
    frames: dict[str, dict[Name, Corners | tuple[Corners, ...]]] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _boxes_have_an_inside(self) -> "BoxFile":
        for where in ({"boxes": self.boxes}, self.frames):
            for key, named in where.items():
                for name, given in named.items():
                    for box in _as_boxes(given):
                        if not (box[0] < box[2] and box[1] < box[3]):
                            raise ValueError(f"the box of '{name}' in {key} needs x0 < x1 and y0 < y1")
        return self


@dataclass(frozen=True)
class GivenBoxes:
    """A detector for one frame that answers with boxes drawn by hand, each of score 1.

    Attributes:
        boxes: By name, each of shape (n, 4) in [px].
    """

    boxes: Mapping[str, np.ndarray]
    name: str = "boxes given by hand"

    def detect(self, frame: RgbdFrame, phrases: Sequence[str]) -> list[Detection]:
        """The boxes given for the phrases, cut at the picture's border."""
        k = frame.intrinsics
        found = []
        for phrase in phrases:
            for box in self.boxes.get(phrase.replace(" ", "_"), ()):
                inside = np.clip(box, 0.0, [k.width, k.height, k.width, k.height])
                if np.all(inside[2:] - inside[:2] >= 1.0):
                    found.append(Detection(phrase, inside, 1.0))
        return found


@dataclass(frozen=True)
class GivenMasks:
    """A detector and segmenter for one frame that answers with masks drawn by hand.

    Attributes:
        masks: By name, bool, of the frame's shape (height, width).
    """

    masks: Mapping[str, np.ndarray]
    name: str = "masks given by hand"

    def detect(self, frame: RgbdFrame, phrases: Sequence[str]) -> list[Detection]:
        """A box around each mask, which is handed on as the seed.

        Raises:
            FrameError: A mask is of another size than the frame.
        """
        found = []
        for phrase in phrases:
            mask = self.masks.get(phrase.replace(" ", "_"))
            if mask is None:
                continue
            if mask.shape != frame.depth.shape:
                raise FrameError(
                    f"the mask of '{phrase}' is {mask.shape[1]}x{mask.shape[0]}; the frame is "
                    f"{frame.intrinsics.width}x{frame.intrinsics.height}: draw masks in the size of the colour picture"
                )
            if mask.any():
                found.append(Detection(phrase, box_around(mask), 1.0, mask))
        return found

    def segment(self, frame: RgbdFrame, box_px: np.ndarray, seed: np.ndarray | None = None) -> np.ndarray:
        """The seed, which is the mask; nothing without one."""
        return np.zeros(frame.depth.shape, bool) if seed is None else seed

    def segment_all(
        self, frame: RgbdFrame, boxes_px: np.ndarray, seeds: Sequence[np.ndarray | None] = ()
    ) -> np.ndarray:
        """The seeds of several boxes, bool, shape (n, height, width)."""
        masks = [self.segment(frame, box, seed) for box, seed in zip(boxes_px, seeds, strict=True)]
        return np.array(masks, bool).reshape(-1, *frame.depth.shape)


class BoxesByFrame:
    """A file of boxes, read and checked.

    Args:
        path: YAML or JSON, see this module's docstring.
        keys: Keys of the recording's frames; None where they cannot be known before.

    Raises:
        FrameError: The file is missing or not valid, or names a frame that the recording does not have.
    """

    def __init__(self, path: Path, keys: Sequence[str] | None) -> None:
        try:
            text = path.read_text(encoding="utf-8")
            content = json.loads(text) if path.suffix.lower() == ".json" else yaml.safe_load(text)
        except (OSError, UnicodeDecodeError, json.JSONDecodeError, yaml.YAMLError) as error:
            raise FrameError(f"the file of boxes '{path}' cannot be read: {error}") from error
        try:
            self._file = BoxFile.model_validate(content)
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(str(part) for part in first["loc"][:3]) or "the whole"
            raise FrameError(
                f"the file of boxes '{path}' is not valid at {where}: {first['msg'].removeprefix('Value error, ')}; "
                "it says `boxes: {name: [x0, y0, x1, y1]}` for every frame and `frames: {'key': {name: [...]}}` for "
                "one, keys in quotes"
            ) from error
        for key in self._file.frames:
            _check_key(key, keys, f"the file of boxes '{path}'")

    @property
    def names(self) -> tuple[str, ...]:
        """All names that have a box somewhere."""
        return tuple(dict.fromkeys(n for part in (self._file.boxes, *self._file.frames.values()) for n in part))

    def of(self, key: str) -> GivenBoxes:
        """The boxes of one frame."""
        named = {**self._file.boxes, **self._file.frames.get(key, {})}
        return GivenBoxes({name: np.array(_as_boxes(given), float) for name, given in named.items()})


class MasksByFrame:
    """A folder of masks, looked through and checked; pictures are read when their frame comes.

    Args:
        folder: See this module's docstring.
        keys: Keys of the recording's frames; None where they cannot be known before.

    Raises:
        FrameError: There is no such folder, no mask in it, a file named for no frame, labels without meaning.
    """

    def __init__(self, folder: Path, keys: Sequence[str] | None) -> None:
        if not folder.is_dir():
            raise FrameError(f"there is no folder of masks '{folder}'; it holds <name>.png or <frame>_<name>.png")
        self._folder = folder
        self._files: dict[tuple[str | None, str], Path] = {}
        for file in sorted(f for f in folder.iterdir() if f.suffix.lower() == ".png"):
            self._files[_whose(file, keys)] = file
        if not self._files:
            raise FrameError(
                f"the folder of masks '{folder}' holds no .png; name them <name>.png or <frame>_<name>.png"
            )
        self._labels = self._read_meanings() if any(name == LABELS for _, name in self._files) else {}

    @property
    def names(self) -> tuple[str, ...]:
        """All names that have a mask somewhere."""
        return tuple(dict.fromkeys([*(n for _, n in self._files if n != LABELS), *self._labels.values()]))

    def of(self, key: str) -> GivenMasks:
        """The masks of one frame.

        Raises:
            FrameError: A picture cannot be read or is no mask.
        """
        masks: dict[str, np.ndarray] = {}
        for scope in (None, key):
            labels = self._files.get((scope, LABELS))
            if labels is not None:
                numbers = _read_mask(labels)
                unknown = sorted(set(np.unique(numbers).tolist()) - {0} - set(self._labels))
                if unknown:
                    raise FrameError(
                        f"the label picture '{labels}' holds the numbers {unknown}, which labels.yaml does not "
                        f"explain; it has {sorted(self._labels)}"
                    )
                masks.update({name: numbers == number for number, name in self._labels.items() if number in numbers})
            for (frame, name), file in self._files.items():
                if frame == scope and name != LABELS:
                    masks[name] = _read_mask(file) != 0
        return GivenMasks(masks)

    def _read_meanings(self) -> dict[int, str]:
        file = self._folder / "labels.yaml"
        try:
            content = yaml.safe_load(file.read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
            raise FrameError(f"'{file}' must say what the numbers of the label pictures mean: {error}") from error
        right = isinstance(content, dict) and all(
            isinstance(k, int) and k > 0 and isinstance(v, str) and re.fullmatch(NAME, v) for k, v in content.items()
        )
        if not right:
            raise FrameError(f"'{file}' must be of the form {{1: sugar_box, 2: can}}: numbers above 0 and names")
        return content


def _as_boxes(given: Corners | tuple[Corners, ...]) -> list[Corners]:
    return [given] if given and not isinstance(given[0], tuple) else list(given)  # type: ignore[list-item]


def _check_key(key: str, keys: Sequence[str] | None, where: str) -> None:
    if keys is not None and key not in keys:
        shown = ", ".join(keys[:12]) + (f", ... ({len(keys)} in all)" if len(keys) > 12 else "")
        raise FrameError(f"{where} names the frame '{key}', which the recording does not have; its frames are {shown}")


def _whose(file: Path, keys: Sequence[str] | None) -> tuple[str | None, str]:
    """Frame (None for all) and name of a mask file."""
    stem = file.stem
    for key in sorted(keys or (), key=len, reverse=True):
        if stem.startswith(f"{key}_") and re.fullmatch(NAME, stem[len(key) + 1 :]):
            return key, stem[len(key) + 1 :]
    if re.fullmatch(NAME, stem):
        return None, stem
    key, _, name = stem.partition("_")
    if keys is None and re.fullmatch(NAME, name):
        return key, name
    _check_key(key, keys, f"the mask '{file}'")
    raise FrameError(
        f"the mask '{file}' is named for nothing: name it <name>.png or <frame>_<name>.png, names in lower case with "
        "underscores"
    )


def _read_mask(file: Path) -> np.ndarray:
    """Numbers of a mask's pixels, shape (height, width); of a picture of several channels the largest."""
    picture = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
    if picture is None:
        raise FrameError(f"the mask '{file}' cannot be read as a picture")
    if picture.ndim == 3:
        # A fourth channel is opacity, which says nothing about whose a pixel is.
        picture = picture[:, :, :3].max(2)
    return picture
