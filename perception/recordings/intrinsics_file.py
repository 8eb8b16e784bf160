"""Intrinsics files: what a lens is, in YAML or JSON, for recordings whose pictures do not say.

width: 640            # or xres
height: 480           # or yres
fx: 610.0
fy: 610.0
cx: 319.5
cy: 239.5
depth_scale: 0.001    # metres per unit of a 16-bit depth picture; 0 in the picture means unknown
camera: static        # optional
world_T_camera: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]   # optional, for all frames
frames:               # optional, by the depth file's name without .png
  "000002-depth": {stamp: 0.0, world_T_camera: [...]}
"""

import json
from pathlib import Path

import yaml
from pydantic import AliasChoices, BaseModel, ConfigDict, Field, ValidationError

from perception.errors import FrameError
from perception.frames import CameraIntrinsics

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
    depth_scale: float | None = Field(default=None, gt=0)
    camera: str = Field(default="camera", validation_alias=AliasChoices("camera", "camera_name"))
    world_T_camera: Matrix | None = None
    frames: dict[str, FrameNotes] = Field(default_factory=dict)

    @property
    def intrinsics(self) -> CameraIntrinsics:
        """As the frame type wants them."""
        return CameraIntrinsics(self.width, self.height, self.fx, self.fy, self.cx, self.cy)


def find_intrinsics(folder: Path) -> Path:
    """The only intrinsics file of a folder.

    Raises:
        FrameError: There is none, or more than one.
    """
    files = sorted(f for f in folder.iterdir() if f.suffix.lower() in (".yaml", ".yml", ".json"))
    if len(files) != 1:
        found = ", ".join(f.name for f in files) or "none"
        raise FrameError(
            f"the folder '{folder}' needs exactly one intrinsics file (.yaml or .json with width, height, fx, fy, cx, "
            f"cy, depth_scale); found {found}; add one or name it with --intrinsics"
        )
    return files[0]


def read_intrinsics(file: Path) -> IntrinsicsFile:
    """Read an intrinsics file.

    Raises:
        FrameError: It cannot be read or is not valid (names the key).
    """
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
