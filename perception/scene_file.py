"""What was perceived, as a file: written by `replan perceive` and by every look of a run, read where a scene is needed.

    {"source": ..., "frames": [{"camera", "stamp", "support_height", "objects": [...], "unseen": [...]}, ...]}

Poses are world_T_object, lengths in [m], angles in [rad]. Pictures are named beside them and not read back.
"""

import json
import math
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from perception.errors import FrameError
from perception.estimates import ObjectEstimate, SceneEstimate, Shape, Unseen

Row4 = tuple[float, float, float, float]
ORTHONORMAL = 1e-3  # largest fault of a rotation matrix: numbers in files are rounded


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class ObjectRecord(_Strict):
    """One object.

    Attributes:
        name, shape, world_T_object, extents, position_std, score: As in `perception.estimates.ObjectEstimate`.
        yaw_std: In [rad], or null where a yaw has no meaning.
        joint_fractions: How far its joints are open, 0..1.
        joint_stds: Spreads of these.
        extents_std: Spread of the extents in [m], or null where nobody says.
        box_px: (x0, y0, x1, y1) in the picture in [px], or null.
        depth_share: Share of its pixels with depth, or null.
    """

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
    shape: Shape
    world_T_object: tuple[Row4, Row4, Row4, Row4]
    extents: tuple[float, float, float]
    position_std: tuple[float, float, float]
    yaw_std: float | None = None
    score: float = 1.0
    joint_fractions: dict[str, Annotated[float, Field(ge=0, le=1)]] = Field(default_factory=dict)
    joint_stds: dict[str, Annotated[float, Field(ge=0)]] = Field(default_factory=dict)
    extents_std: tuple[float, float, float] | None = None
    box_px: tuple[float, float, float, float] | None = None
    depth_share: float | None = None

    @field_validator("world_T_object")
    @classmethod
    def _is_a_pose(cls, value: tuple[Row4, ...]) -> tuple[Row4, ...]:
        pose = np.asarray(value)
        turn = pose[:3, :3]
        fault = float(np.abs(turn @ turn.T - np.eye(3)).max())
        if fault > ORTHONORMAL or np.linalg.det(turn) < 0 or not np.allclose(pose[3], (0, 0, 0, 1)):
            raise ValueError("not a pose: the upper left 3 x 3 must be a rotation and the last row 0 0 0 1")
        return value

    @field_validator("extents")
    @classmethod
    def _has_size(cls, value: tuple[float, float, float]) -> tuple[float, float, float]:
        if min(value) <= 0:
            raise ValueError("sizes are in metres and above 0")
        return value


class UnseenRecord(_Strict):
    """A name that was looked for in vain, and why."""

    name: str
    reason: str


class LookRecord(_Strict):
    """What was found at one time.

    Attributes:
        camera: Name of the camera, or of all of them joined by "+".
        stamp: Time of the frame in [s].
        support_height: Height of the table top in the world in [m].
        picture, cloud: Files that were written of it, or null.
        objects, unseen: What was found, and what was not.
    """

    camera: str
    stamp: float
    support_height: float = 0.0
    picture: str | None = None
    cloud: str | None = None
    objects: tuple[ObjectRecord, ...]
    unseen: tuple[UnseenRecord, ...] = ()

    def scene(self, source: str) -> SceneEstimate:
        """The scene that it describes, without pictures as evidence."""
        objects = tuple(
            ObjectEstimate(
                name=o.name,
                phrase=o.name.replace("_", " "),
                world_T_object=np.asarray(o.world_T_object),
                extents=np.asarray(o.extents),
                shape=o.shape,
                position_std=np.asarray(o.position_std),
                yaw_std=np.inf if o.yaw_std is None else o.yaw_std,
                score=o.score,
                stamp=self.stamp,
                joint_fractions=dict(o.joint_fractions),
                joint_stds=dict(o.joint_stds),
                extents_std=None if o.extents_std is None else np.asarray(o.extents_std),
            )
            for o in self.objects
        )
        unseen = tuple(Unseen(u.name, u.reason) for u in self.unseen)
        return SceneEstimate(objects, unseen, self.support_height, self.stamp, source)

    @classmethod
    def of(cls, scene: SceneEstimate, camera: str, picture: Path | None = None, cloud: Path | None = None):
        """The record of a scene."""
        return cls(
            camera=camera,
            stamp=scene.stamp,
            support_height=scene.support_height,
            picture=None if picture is None else str(picture),
            cloud=None if cloud is None else str(cloud),
            objects=tuple(_record(o) for o in scene.objects),
            unseen=tuple(UnseenRecord(name=u.name, reason=u.reason) for u in scene.unseen),
        )


class PerceptionResult(_Strict):
    """A whole file.

    Attributes:
        source: Which detector and segmenter.
        out: Folder that pictures were written to, or null.
        frames: One record a look, in order of time.
    """

    source: str
    out: str | None = None
    frames: tuple[LookRecord, ...]

    def scene(self, frame: int = -1) -> SceneEstimate:
        """The scene of one frame, the last one by default.

        Raises:
            FrameError: There is no such frame.
        """
        if not self.frames or not -len(self.frames) <= frame < len(self.frames):
            raise FrameError(f"there is no frame {frame}; the file has {len(self.frames)} frames, counted from 0")
        return self.frames[frame].scene(self.source)

    def write(self, path: Path) -> None:
        """Write it as JSON."""
        path.write_text(json.dumps(self.model_dump(mode="json"), indent=1) + "\n")


def read_perception_result(path: Path, content: Any) -> PerceptionResult:
    """A perception result from a file's content as JSON gives it.

    Args:
        path: Named in errors.
        content: What `json.load` returned.

    Raises:
        FrameError: It is not one; names the file, the place and what was wrong.
    """
    try:
        return PerceptionResult.model_validate(content)
    except ValidationError as error:
        fault = error.errors()[0]
        where = ".".join(str(part) for part in fault["loc"])
        message = fault["msg"].removeprefix("Value error, ")
        raise FrameError(f"{path}: not a perception result: {where or 'the whole'}: {message}") from None


def _record(o: ObjectEstimate) -> ObjectRecord:
    matrix = [[round(float(v), 9) for v in row] for row in np.asarray(o.world_T_object)]
    seen = o.evidence[0] if o.evidence else None
    return ObjectRecord.model_validate(
        {
            "name": o.name,
            "shape": o.shape,
            "world_T_object": matrix,
            "extents": np.asarray(o.extents).tolist(),
            "position_std": np.asarray(o.position_std).tolist(),
            "yaw_std": o.yaw_std if math.isfinite(o.yaw_std) else None,
            "score": round(o.score, 3),
            "joint_fractions": dict(o.joint_fractions),
            "joint_stds": dict(o.joint_stds),
            "extents_std": None if o.extents_std is None else np.asarray(o.extents_std).tolist(),
            "box_px": np.asarray(seen.box_px).tolist() if seen else None,
            "depth_share": round(seen.depth_share, 3) if seen else None,
        }
    )
