"""What a cell file may say: the robot, its cameras, the work area, objects and limits, checked strictly.

The `simulation` block says what a simulated cell holds and is read by nothing else: the stack knows of a cell what a
person would write down about a real one.
"""

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from control.errors import ConfigError
from control.robot.gripper import GripperModel, gripper_model
from control.robot.limits import RobotLimits
from control.robot.profiles import load_profile
from control.safety.limits import SafetyLimits
from control.seen_volume import UnseenPolicy
from perception.frames import CameraIntrinsics
from sim_check.cells.furniture_config import FurnitureConfig
from sim_check.cells.poses_config import PoseConfig
from sim_check.cells.simulation_config import DepthNoiseConfig, PlacementConfig, SimulationConfig, check_simulation
from sim_check.strict_config import Name, Positive, Strict, Vector3

__all__ = [
    "BoxConfig",
    "CameraConfig",
    "CellConfig",
    "DepthNoiseConfig",
    "PlacementConfig",
    "RobotConfig",
    "SimulationConfig",
]


class RobotConfig(Strict):
    """Which robot, and where it stands.

    Attributes:
        profile: Its limits: a known profile (`control.robot.profiles`), or a file that looks like one (ending in .yaml
            or .yml; in a cell file, a relative path is relative to the folder of that file).
        gripper: Which gripper it carries (`control.robot.gripper`).
        position: Base in the world in [m].
        yaw_deg: Rotation of the base about the world's z in [degrees].
    """

    profile: str = "panda/5"
    gripper: Literal["panda_hand", "robotiq_2f85"] = "panda_hand"
    position: Vector3 = (0.0, 0.0, 0.0)
    yaw_deg: float = 0.0

    @property
    def gripper_model(self) -> GripperModel:
        """What the gripper is."""
        return gripper_model(self.gripper)

    def limits(self) -> RobotLimits:
        """Published limits of the robot with its gripper.

        Raises:
            ConfigError: There is no such profile, or its file is not valid.
        """
        return load_profile(self.profile, self.gripper_model)

    @property
    def world_T_base(self) -> np.ndarray:
        """Pose of the base in the world, shape (4, 4)."""
        yaw = np.deg2rad(self.yaw_deg)
        pose = np.eye(4)
        pose[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
        pose[:3, 3] = self.position
        return pose


class CameraConfig(Strict):
    """A pinhole camera that stands in the world ("static") or rides on the hand ("wrist").

    Its pose is `position` with either `look_at` and `up`, or `quaternion` from a calibration. Its focal length is
    `fx` and `fy`, or `horizontal_fov_deg`.

    Attributes:
        name: Name of the camera in frames.
        mounting: Frame of position, look_at, up and quaternion: the world, or the hand (`panda_hand`), a
            frame at the flange that is the same for every gripper (`control.robot.gripper`).
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


class BoxConfig(Strict):
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


class CellConfig(Strict):
    """One cell.

    Attributes:
        name: Name for people and reports.
        description: One line about it.
        robot: Which robot, and where it stands.
        cameras: At least one.
        workspace: Box that the hand must stay in.
        objects: Names that can be asked for; lower case with underscores, a noun with words before it (`red_cube`).
        furniture: What stands fixed, by name: kind and sizes. Where it stands and how far it is open is perceived.
        poses: Where things stand as a person measured them, for validating motions without a camera.
        unseen: What becomes of ways through space that no camera has seen: "allow" takes no notice of it, "avoid"
            prefers ways through space that was seen to be free, "refuse" plays no motion whose way has more unseen
            space than `safety` allows (`unseen_volume`, `unseen_overhead`).
        safety: Changes of the safety table, by the names of `control.safety.limits.SafetyLimits`.
        options: Switches of this cell and whether they are on.
        simulation: What the simulated cell holds; null when the cell is real only.
    """

    name: Annotated[str, Field(pattern=r"^[a-z][a-z0-9_-]*$")]
    description: str = ""
    robot: RobotConfig = RobotConfig()
    cameras: Annotated[tuple[CameraConfig, ...], Field(min_length=1)]
    workspace: BoxConfig = BoxConfig()
    unseen: UnseenPolicy = "avoid"
    objects: Annotated[tuple[Name, ...], Field(min_length=1)]
    furniture: dict[Name, FurnitureConfig] = Field(default_factory=dict)
    poses: dict[Name, PoseConfig] = Field(default_factory=dict)
    safety: dict[str, Any] = Field(default_factory=dict)
    options: dict[Name, bool] = Field(default_factory=dict)
    simulation: SimulationConfig | None = None

    @field_validator("safety")
    @classmethod
    def _known_limits(cls, value: dict[str, Any]) -> dict[str, Any]:
        valid = set(SafetyLimits.__dataclass_fields__) - {"workspace_low", "workspace_high", "unseen"}
        for name, limit in value.items():
            if name in ("workspace_low", "workspace_high"):
                raise ValueError(f"{name} is not set here; the cell's `workspace` (low, high) is")
            if name == "unseen":
                raise ValueError("unseen is not set here; the cell's own `unseen` (allow, avoid or refuse) is")
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
        for name in self.furniture:
            if name in self.objects:
                raise ValueError(f"'{name}' is both an object and furniture; furniture is not named in objects")
        for name in self.poses:
            if name not in self.objects and name not in self.furniture:
                known = sorted({*self.objects, *self.furniture})
                raise ValueError(f"poses.{name}: this cell has no such object or furniture; it has {known}")
        if self.simulation is not None:
            check_simulation(self.simulation, self.objects, self.furniture, self.options)
        return self

    def safety_limits(self) -> SafetyLimits:
        """The safety table with this cell's workspace and changes."""
        changes = {k: float(v) for k, v in self.safety.items() if k != "keep_out"}
        zones = tuple((tuple(low), tuple(high)) for low, high in self.safety.get("keep_out", ()))
        return SafetyLimits(
            workspace_low=self.workspace.low,
            workspace_high=self.workspace.high,
            keep_out=zones,
            unseen=self.unseen,
            **changes,
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
