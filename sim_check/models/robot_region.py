"""Where the robot is: the distance of points in the world to its collision bodies at measured joints.

A depth picture shows the robot wherever it is in view, and nothing else may be taken for it. The bodies are those of
the collision model, which enclose its visual meshes, so depth of the robot lies at or inside their surface up to the
noise of camera and calibration.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from control.errors import ConfigError
from control.twin_model import ARM_BODIES, ARM_JOINTS, FINGER_BODIES, FINGER_JOINTS, HAND_BODY
from perception.unexplained.regions import PlacedSolid, SolidKind, SolidsRegion
from sim_check.cells.cell_config import CameraConfig, RobotConfig
from sim_check.models.panda_mjcf import COLLISION_GROUP, panda_spec
from sim_check.models.scene_mjcf import place_robot, pose_of
from sim_check.objects.solids import SolidShape

_KINDS: dict[int, SolidKind] = {
    int(mujoco.mjtGeom.mjGEOM_BOX): "box",
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): "capsule",
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): "cylinder",
    int(mujoco.mjtGeom.mjGEOM_SPHERE): "sphere",
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): "ellipsoid",
}
# Half sizes of a box around a wrist camera's optical centre in [m], in its optical frame: housings of small stereo
# cameras are up to 125 mm wide, and the optical centre is that of one eye.
_HOUSING = (0.095, 0.025, 0.03)


@dataclass(frozen=True)
class InTheHand:
    """What the hand holds.

    Attributes:
        solids: Its collision body, in its own frame.
        hand_T_object: Its pose in the hand's frame, shape (4, 4).
    """

    solids: tuple[SolidShape, ...]
    hand_T_object: NDArray[np.float64]


class RobotRegions:
    """Makes the region that the robot fills, for any joints. Not for several threads at once.

    Args:
        robot: Which robot, its gripper, and where it stands.
        cameras: Of the cell; a housing is added for each that rides on the hand.

    Raises:
        ConfigError: As `sim_check.models.panda_mjcf.panda_spec` does.
    """

    def __init__(self, robot: RobotConfig, cameras: Sequence[CameraConfig] = ()) -> None:
        spec = panda_spec(meshes=False, gripper=robot.gripper_model)
        place_robot(spec, robot)
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        self._opening = robot.gripper_model.opening
        self._arm = [int(self._model.joint(name).qposadr[0]) for name in ARM_JOINTS]
        self._fingers = [int(self._model.joint(name).qposadr[0]) for name in FINGER_JOINTS]
        self._geoms = [int(g) for g in np.flatnonzero(self._model.geom_group == COLLISION_GROUP)]
        self._hand = self._model.body(HAND_BODY).id
        self._housings = [camera.mount_T_camera for camera in cameras if camera.mounting == "wrist"]

    def at(self, q: Sequence[float] | np.ndarray, width: float, held: InTheHand | None = None) -> SolidsRegion:
        """The region at measured joints.

        Args:
            q: Arm joints in [rad], shape (7,).
            width: Distance between the pads in [m].
            held: What the hand holds, or None.

        Raises:
            ConfigError: `q` has another shape, or is not finite.
        """
        q = np.asarray(q, float)
        if q.shape != (7,) or not (np.all(np.isfinite(q)) and np.isfinite(width)):
            raise ConfigError(f"a robot's region needs 7 finite joints in rad and a finite width, not {q} and {width}")
        self._data.qpos[self._arm] = q
        self._data.qpos[self._fingers] = np.clip(width, 0.0, self._opening) / 2
        mujoco.mj_kinematics(self._model, self._data)
        hand = self._hand_pose()
        solids = [_solid(self._model, self._data, geom) for geom in self._geoms]
        solids += [PlacedSolid("box", np.array(_HOUSING), hand @ camera) for camera in self._housings]
        if held is not None:
            world_T_object = hand @ held.hand_T_object
            solids += [PlacedSolid(s.kind, s.half, world_T_object @ pose_of(s.position, s.quat)) for s in held.solids]
        return SolidsRegion(tuple(solids))

    def hand_T(self, q: Sequence[float] | np.ndarray, world_T_object: np.ndarray) -> np.ndarray:
        """Pose of a thing in the hand's frame at arm joints in [rad], shape (4, 4)."""
        self._data.qpos[self._arm] = np.asarray(q, float)
        mujoco.mj_kinematics(self._model, self._data)
        return np.linalg.inv(self._hand_pose()) @ world_T_object

    def _hand_pose(self) -> np.ndarray:
        pose = np.eye(4)
        pose[:3, :3] = self._data.xmat[self._hand].reshape(3, 3)
        pose[:3, 3] = self._data.xpos[self._hand]
        return pose


def solids_of(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[tuple[PlacedSolid, ...], tuple[PlacedSolid, ...]]:
    """Everything in a model that can touch anything, planes and meshes apart: the robot, and the rest.

    Args:
        model, data: With up-to-date kinematics.
    """
    own = {model.body(name).id for name in (*ARM_BODIES, HAND_BODY, *FINGER_BODIES)}
    robot, others = [], []
    for geom in range(model.ngeom):
        touches = model.geom_contype[geom] or model.geom_conaffinity[geom]
        if touches and int(model.geom_type[geom]) in _KINDS:
            (robot if int(model.geom_bodyid[geom]) in own else others).append(_solid(model, data, geom))
    return tuple(robot), tuple(others)


def _solid(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> PlacedSolid:
    kind = _KINDS[int(model.geom_type[geom])]
    size = model.geom_size[geom]
    half = np.array([size[0], size[0], size[1]]) if kind in ("capsule", "cylinder") else size.copy()
    pose = np.eye(4)
    pose[:3, :3] = data.geom_xmat[geom].reshape(3, 3)
    pose[:3, 3] = data.geom_xpos[geom]
    return PlacedSolid(kind, half, pose)
