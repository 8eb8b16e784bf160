"""What a cell file may say: the robot, its cameras, the work area, objects and limits, checked strictly.

The `simulation` block says what a simulated cell holds and is read by nothing else: the stack knows of a cell what a
person would write down about a real one.
"""

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from control.errors import ConfigError
from control.safety import SafetyLimits
from perception.frames import CameraIntrinsics

Vector2 = tuple[float, float]
Vector3 = tuple[float, float, float]
Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class RobotConfig(_Strict):
    """Which robot, and where it stands.

    Attributes:
        profile: Name and interface version of its limits (`control.limits`).
        gripper: Which gripper it carries.
        position: Base in the world in [m].
        yaw_deg: Rotation of the base about the world's z in [degrees].
    """

    profile: Literal["panda/5"] = "panda/5"
    gripper: Literal["panda_hand"] = "panda_hand"
    position: Vector3 = (0.0, 0.0, 0.0)
    yaw_deg: float = 0.0

    @property
    def world_T_base(self) -> np.ndarray:
        """Pose of the base in the world, shape (4, 4)."""
        yaw = np.deg2rad(self.yaw_deg)
        pose = np.eye(4)
        pose[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
        pose[:3, 3] = self.position
        return pose


class CameraConfig(_Strict):
    """A pinhole camera that stands in the world ("static") or rides on the hand ("wrist").

    Its pose is `position` with either `look_at` and `up`, or `quaternion` from a calibration. Its focal length is
    `fx` and `fy`, or `horizontal_fov_deg`.

    Attributes:
        name: Name of the camera in frames.
        mounting: Frame of position, look_at, up and quaternion: the world, or the hand (`panda_hand`).
        position: Optical centre in [m].
        look_at: Point on the optical axis in [m].
        up: Direction that is up in the picture; not parallel to the axis.
        quaternion: (w, x, y, z) of the optical frame (x right, y down, z forward).
        width, height: Picture size in [px].
        fx, fy: Focal lengths in [px].
        horizontal_fov_deg: Horizontal field of view in [degrees].
        cx, cy: Principal point in [px], the centre of the top-left pixel being (0, 0); the middle if left out.
    """

    name: Name
    mounting: Literal["static", "wrist"]
    position: Vector3
    look_at: Vector3 | None = None
    up: Vector3 = (0.0, 0.0, 1.0)
    quaternion: tuple[float, float, float, float] | None = None
    width: Annotated[int, Field(gt=0, le=4096)] = 640
    height: Annotated[int, Field(gt=0, le=4096)] = 480
    fx: Positive | None = None
    fy: Positive | None = None
    horizontal_fov_deg: Annotated[float, Field(gt=0, lt=180)] | None = None
    cx: float | None = None
    cy: float | None = None

    @model_validator(mode="after")
    def _one_pose_one_lens(self) -> "CameraConfig":
        if (self.look_at is None) == (self.quaternion is None):
            raise ValueError("give either look_at or quaternion")
        if (self.fx is None) == (self.horizontal_fov_deg is None):
            raise ValueError("give either fx (and fy) or horizontal_fov_deg")
        if self.look_at is not None:
            forward = np.subtract(self.look_at, self.position)
            if np.linalg.norm(np.cross(forward, self.up)) < 1e-6:
                raise ValueError(
                    "look_at must differ from position, and up must not be parallel to the viewing direction"
                )
        if self.quaternion is not None and abs(np.linalg.norm(self.quaternion) - 1.0) > 1e-3:
            raise ValueError("quaternion must have length 1; order is w, x, y, z")
        return self

    @property
    def intrinsics(self) -> CameraIntrinsics:
        """Intrinsics of its colour and depth pictures."""
        if self.fx is not None:
            fx = self.fx
        else:
            fx = self.width / 2 / np.tan(np.deg2rad(self.horizontal_fov_deg or 0.0) / 2)
        return CameraIntrinsics(
            width=self.width,
            height=self.height,
            fx=float(fx),
            fy=float(fx if self.fy is None else self.fy),
            cx=(self.width - 1) / 2 if self.cx is None else self.cx,
            cy=(self.height - 1) / 2 if self.cy is None else self.cy,
        )

    @property
    def mount_T_camera(self) -> np.ndarray:
        """Pose of the optical frame in the world ("static") or in the hand ("wrist"), shape (4, 4)."""
        pose = np.eye(4)
        pose[:3, 3] = self.position
        if self.quaternion is not None:
            w, x, y, z = np.asarray(self.quaternion) / np.linalg.norm(self.quaternion)
            pose[:3, :3] = [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
            return pose
        forward = np.subtract(self.look_at or self.position, self.position)
        forward = forward / np.linalg.norm(forward)
        right = np.cross(forward, self.up)
        right = right / np.linalg.norm(right)
        pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
        return pose


class BoxConfig(_Strict):
    """A box along the world's axes.

    Attributes:
        low, high: Its corners in [m].
    """

    low: Vector3 = SafetyLimits.workspace_low
    high: Vector3 = SafetyLimits.workspace_high

    @model_validator(mode="after")
    def _has_volume(self) -> "BoxConfig":
        if not np.all(np.asarray(self.low) < np.asarray(self.high)):
            raise ValueError("each number of low must be below that of high")
        return self


class PlacementConfig(_Strict):
    """Where the simulated cell puts one object at the start.

    Attributes:
        object: Name, from the cell's objects.
        position: Centre of its range: in the world in [m] for the table; in the frame of the object that it stands on
            or lies in otherwise.
        spread: Half widths of its range in [m], uniform.
        yaw_deg: Centre of its yaw in [degrees].
        yaw_spread_deg: Half width of the yaw's range in [degrees], uniform.
        extents: Its full sizes in [m]; the library's usual ones if left out.
        size_spread: Half width of a common factor on its sizes, uniform: 0.04 makes sizes 0.96 to 1.04 of the nominal.
        stands_on: Object that it stands on, instead of the table; placed earlier in the list.
        lies_in: Container that it lies in; placed earlier in the list.
        only_if: Option of the cell that must be on for the object to be there.
    """

    object: Name
    position: Vector2 = (0.0, 0.0)
    spread: tuple[NotNegative, NotNegative] = (0.0, 0.0)
    yaw_deg: float = 0.0
    yaw_spread_deg: NotNegative = 180.0
    extents: tuple[Positive, Positive, Positive] | None = None
    size_spread: Annotated[float, Field(ge=0, lt=0.5)] = 0.0
    stands_on: Name | None = None
    lies_in: Name | None = None
    only_if: Name | None = None

    @model_validator(mode="after")
    def _one_support(self) -> "PlacementConfig":
        if self.stands_on is not None and self.lies_in is not None:
            raise ValueError("give either stands_on or lies_in, or neither for the table")
        return self


class DepthNoiseConfig(_Strict):
    """Stereo noise of the simulated cameras; the formula stands in `sim_check.depth_noise`.

    Attributes:
        baseline: Distance between the two lenses in [m]; 63 mm is a ZED Mini's.
        disparity_std_px: Root mean square of the disparity's error in [px].
        correlation_px: Width of the matching window that correlates neighbouring errors (Gaussian sigma) in [px].
        step_px: Disparity is rounded to multiples of this in [px].
        edge_disparity_px: A difference within the window that counts as a depth edge, in [px].
        flying_share, edge_dropout_share: Shares of the edge pixels that mix both sides, and that are lost, 0..1.
        blob_share: Share of all pixels lost in blobs where nothing could be matched, 0..1.
        nearest, farthest: Range of depths that can be matched in [m].
    """

    baseline: Positive = 0.063
    disparity_std_px: NotNegative = 0.25
    correlation_px: Positive = 3.0
    step_px: NotNegative = 0.0625
    edge_disparity_px: Positive = 1.5
    flying_share: Annotated[float, Field(ge=0, le=1)] = 0.3
    edge_dropout_share: Annotated[float, Field(ge=0, le=1)] = 0.25
    blob_share: Annotated[float, Field(ge=0, le=0.5)] = 0.014
    nearest: Positive = 0.15
    farthest: Positive = 8.0

    @model_validator(mode="after")
    def _consistent(self) -> "DepthNoiseConfig":
        if self.nearest >= self.farthest:
            raise ValueError("nearest must be below farthest")
        if self.flying_share + self.edge_dropout_share > 1:
            raise ValueError("flying_share and edge_dropout_share cannot add up to more than 1")
        return self


class SimulationConfig(_Strict):
    """The truth of a simulated cell; nothing but the simulated cell and its scorers may read it.

    Attributes:
        placements: What there is, and where.
        gap: Least distance between the outlines (circles around footprints) of things on the table in [m].
        mass_mismatch, friction_mismatch: Half widths of seeded factors on the library's masses and friction.
        depth_noise: Stereo noise, or null for perfect depth.
    """

    placements: tuple[PlacementConfig, ...] = ()
    gap: NotNegative = 0.04
    mass_mismatch: Annotated[float, Field(ge=0, lt=1)] = 0.1
    friction_mismatch: Annotated[float, Field(ge=0, lt=1)] = 0.1
    depth_noise: DepthNoiseConfig | None = DepthNoiseConfig()


class CellConfig(_Strict):
    """One cell.

    Attributes:
        name: Name for people and reports.
        description: One line about it.
        robot: Which robot, and where it stands.
        cameras: At least one.
        workspace: Box that the hand must stay in.
        objects: Names that can be asked for; lower case with underscores, a noun with words before it (`red_cube`).
        safety: Changes of the safety table, by the names of `control.safety.SafetyLimits`.
        options: Switches of this cell and whether they are on.
        simulation: What the simulated cell holds; null when the cell is real only.
    """

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_-]*$")]
    description: str = ""
    robot: RobotConfig = RobotConfig()
    cameras: Annotated[tuple[CameraConfig, ...], Field(min_length=1)]
    workspace: BoxConfig = BoxConfig()
    objects: Annotated[tuple[Name, ...], Field(min_length=1)]
    safety: dict[str, Any] = {}
    options: dict[Name, bool] = {}
    simulation: SimulationConfig | None = None

    @field_validator("safety")
    @classmethod
    def _known_limits(cls, value: dict[str, Any]) -> dict[str, Any]:
        valid = set(SafetyLimits.__dataclass_fields__) - {"workspace_low", "workspace_high"}
        for name, limit in value.items():
            if name in ("workspace_low", "workspace_high"):
                raise ValueError(f"{name} is not set here; the cell's `workspace` (low, high) is")
            if name not in valid:
                raise ValueError(f"there is no limit '{name}'; valid are {sorted(valid)}")
            if name != "keep_out" and (isinstance(limit, bool) or not isinstance(limit, int | float) or limit < 0):
                raise ValueError(f"{name} must be a number that is not negative, not {limit!r}")
        if "keep_out" in value:
            corners = np.asarray(value["keep_out"], float)
            if corners.ndim != 3 or corners.shape[1:] != (2, 3):
                raise ValueError("keep_out must be a list of boxes, each [[x, y, z] low, [x, y, z] high] in [m]")
        return value

    @model_validator(mode="after")
    def _names_agree(self) -> "CellConfig":
        for what, names in (("camera", [c.name for c in self.cameras]), ("object", list(self.objects))):
            for name in names:
                if names.count(name) > 1:
                    raise ValueError(f"the {what} '{name}' is named twice")
        seen: list[str] = []
        for p in self.simulation.placements if self.simulation else ():
            if p.object not in self.objects:
                raise ValueError(f"placement of '{p.object}': objects are {sorted(self.objects)}")
            if p.object in seen:
                raise ValueError(f"'{p.object}' is placed twice")
            support = p.stands_on or p.lies_in
            if support is not None and support not in seen:
                raise ValueError(f"'{p.object}' is placed on or in '{support}', which must be placed before it")
            if p.only_if is not None and p.only_if not in self.options:
                raise ValueError(f"only_if of '{p.object}': options are {sorted(self.options)}, not '{p.only_if}'")
            seen.append(p.object)
        return self

    def safety_limits(self) -> SafetyLimits:
        """The safety table with this cell's workspace and changes."""
        changes = {k: float(v) for k, v in self.safety.items() if k != "keep_out"}
        zones = tuple((tuple(low), tuple(high)) for low, high in self.safety.get("keep_out", ()))
        return SafetyLimits(
            workspace_low=self.workspace.low, workspace_high=self.workspace.high, keep_out=zones, **changes
        )

    def camera(self, name: str) -> CameraConfig:
        """The camera of this name.

        Raises:
            ConfigError: There is none.
        """
        for camera in self.cameras:
            if camera.name == name:
                return camera
        raise ConfigError(f"cell '{self.name}' has no camera '{name}'; it has {[c.name for c in self.cameras]}")
