"""What was perceived, as a file: written by `replan perceive` and by every look of a run, read where a scene is needed.

    {"source": ..., "frames": [{"camera", "stamp", "support_height", "objects": [...], "unseen": [...]}, ...],
     "skipped": [{"where", "reason"}, ...], "finished": true, "metrics": null}

Poses are world_T_object, lengths in [m], angles in [rad]. Pictures are named beside them and not read back.
"""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, field_validator

from perception.catalogue.catalogue import builtin_catalogue
from perception.errors import FrameError
from perception.estimates import ObjectEstimate, SceneEstimate, Shape, Unseen
from perception.tracking.tracker import Track

Row4 = tuple[float, float, float, float]
ORTHONORMAL = 1e-3  # largest fault of a rotation matrix: numbers in files are rounded


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


def _pose(value: tuple[Row4, ...]) -> tuple[Row4, ...]:
    pose = np.asarray(value)
    turn = pose[:3, :3]
    fault = float(np.abs(turn @ turn.T - np.eye(3)).max())
    if fault > ORTHONORMAL or np.linalg.det(turn) < 0 or not np.allclose(pose[3], (0, 0, 0, 1)):
        raise ValueError("not a pose: the upper left 3 x 3 must be a rotation and the last row 0 0 0 1")
    return value


Pose = Annotated[tuple[Row4, Row4, Row4, Row4], AfterValidator(_pose)]


class TrackRecord(_Strict):
    """The thing that an object of one frame is, as followed through the frames before (`perception.tracking.tracker`).

    Attributes:
        id: Its name for good; with several of a kind red_cube, red_cube_2, ...
        world_T_object, extents, position_std, yaw_std: Means over the frames since it was moved last.
        frames: How many these are.
        moves: How often it was found elsewhere than before.
    """

    id: str
    world_T_object: Pose
    extents: tuple[float, float, float]
    position_std: tuple[float, float, float]
    yaw_std: float | None = None
    frames: int
    moves: int = 0

    @classmethod
    def of(cls, track: Track):
        """The record of a track as it stands."""
        o = track.estimate
        return cls(
            id=track.name,
            world_T_object=_rows(o.world_T_object),
            extents=tuple(np.asarray(o.extents).tolist()),
            position_std=tuple(np.asarray(o.position_std).tolist()),
            yaw_std=o.yaw_std if math.isfinite(o.yaw_std) else None,
            frames=track.still,
            moves=track.moves,
        )


class ObjectRecord(_Strict):
    """One object.

    Attributes:
        name, shape, world_T_object, extents, position_std, score: As in `perception.estimates.ObjectEstimate`.
        yaw_std: In [rad], or null where a yaw has no meaning.
        joint_fractions: How far its joints are open, 0..1.
        joint_stds: Spreads of these.
        extents_std: Spread of the extents in [m], or null where nobody says.
        colour: Its colour in a word, or null where it is undecided or nobody says; older files do not have it.
        doubts: What speaks against it; older files do not have it.
        named: Whether somebody named it; older files hold named things only.
        box_px: (x0, y0, x1, y1) in the picture in [px], or null.
        depth_share: Share of its pixels with depth, or null.
        track: The thing that it is, where frames were followed.
    """

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
    shape: Shape
    world_T_object: Pose
    extents: tuple[float, float, float]
    position_std: tuple[float, float, float]
    yaw_std: float | None = None
    score: float = 1.0
    joint_fractions: dict[str, Annotated[float, Field(ge=0, le=1)]] = Field(default_factory=dict)
    joint_stds: dict[str, Annotated[float, Field(ge=0)]] = Field(default_factory=dict)
    extents_std: tuple[float, float, float] | None = None
    colour: str | None = None
    doubts: tuple[str, ...] = ()
    named: bool = True
    box_px: tuple[float, float, float, float] | None = None
    depth_share: float | None = None
    track: TrackRecord | None = None

    @field_validator("extents")
    @classmethod
    def _has_size(cls, value: tuple[float, float, float]) -> tuple[float, float, float]:
        if min(value) <= 0:
            raise ValueError("sizes are in metres and above 0")
        return value

    @field_validator("colour")
    @classmethod
    def _is_a_colour_word(cls, value: str | None) -> str | None:
        colours = builtin_catalogue().colours
        if value is not None and value not in colours:
            raise ValueError(f"'{value}' is no colour word; it must be null or one of {', '.join(colours)}")
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
        key: Which frame of the recording it is, or null for looks of a run.
        seconds: Time spent in each stage in [s].
    """

    camera: str
    stamp: float
    support_height: float = 0.0
    picture: str | None = None
    cloud: str | None = None
    objects: tuple[ObjectRecord, ...]
    unseen: tuple[UnseenRecord, ...] = ()
    key: str | None = None
    seconds: dict[str, float] = Field(default_factory=dict)

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
                colour=o.colour,
                doubts=o.doubts,
                named=o.named,
            )
            for o in self.objects
        )
        unseen = tuple(Unseen(u.name, u.reason) for u in self.unseen)
        return SceneEstimate(objects, unseen, self.support_height, self.stamp, source)

    @classmethod
    def of(
        cls,
        scene: SceneEstimate,
        camera: str,
        picture: Path | None = None,
        cloud: Path | None = None,
        key: str | None = None,
        tracks: Sequence[Track] = (),
    ):
        """The record of a scene; `tracks`, where there are any, are those of its objects, in their order."""
        things = tracks or [None] * len(scene.objects)
        return cls(
            camera=camera,
            stamp=scene.stamp,
            support_height=scene.support_height,
            picture=None if picture is None else str(picture),
            cloud=None if cloud is None else str(cloud),
            objects=tuple(_record(o, t) for o, t in zip(scene.objects, things, strict=True)),
            unseen=tuple(UnseenRecord(name=u.name, reason=u.reason) for u in scene.unseen),
            key=key,
            seconds={stage: round(s, 6) for stage, s in scene.seconds.items()},
        )


class SkippedRecord(_Strict):
    """A part of a recording that could not be used, and why."""

    where: str
    reason: str


class PerceptionResult(_Strict):
    """A whole file.

    Attributes:
        source: Which detector and segmenter.
        out: Folder that pictures were written to, or null.
        frames: One record a look, in order of time.
        skipped: What could not be used.
        finished: Whether the recording was read to its end; false where the program was stopped.
        metrics: Measured against the truth (`perception.evaluation.scoring`), where the recording has it.
    """

    source: str
    out: str | None = None
    frames: tuple[LookRecord, ...]
    skipped: tuple[SkippedRecord, ...] = ()
    finished: bool = True
    metrics: dict[str, Any] | None = None

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


def _rows(pose: np.ndarray) -> Any:
    return tuple(tuple(round(float(v), 9) for v in row) for row in np.asarray(pose))


def _record(o: ObjectEstimate, track: Track | None) -> ObjectRecord:
    seen = o.evidence[0] if o.evidence else None
    return ObjectRecord.model_validate(
        {
            "name": o.name,
            "shape": o.shape,
            "world_T_object": _rows(o.world_T_object),
            "extents": np.asarray(o.extents).tolist(),
            "position_std": np.asarray(o.position_std).tolist(),
            "yaw_std": o.yaw_std if math.isfinite(o.yaw_std) else None,
            "score": round(o.score, 3),
            "joint_fractions": dict(o.joint_fractions),
            "joint_stds": dict(o.joint_stds),
            "extents_std": None if o.extents_std is None else np.asarray(o.extents_std).tolist(),
            "colour": o.colour,
            "doubts": list(o.doubts),
            "named": o.named,
            "box_px": np.asarray(seen.box_px).tolist() if seen else None,
            "depth_share": round(seen.depth_share, 3) if seen else None,
            "track": TrackRecord.of(track) if track else None,
        }
    )
