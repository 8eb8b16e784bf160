"""A small world for tests of the simulated cell: the Panda, a table top at z = 0, and one cube below its hand."""

from types import SimpleNamespace

import mujoco
import numpy as np

from control.robot.limits import REST_Q
from control.twin_model import ARM_ACTUATORS, ARM_JOINTS, FINGER_JOINTS, GRIPPER_ACTUATOR, TCP_SITE
from perception.frames import CameraIntrinsics
from perception.ground_truth import CellTruth, FrameTruth, StandingThing
from sim_check.models.panda_mjcf import panda_spec

CUBE = 0.04  # edge in [m]


class CubeWorld:
    """What `run_sim_cell` asks of a world; its camera sees a wall, since nothing here needs pictures."""

    cameras = (SimpleNamespace(name="front"),)

    def __init__(self, wall: bool = False) -> None:
        spec = panda_spec(meshes=False)
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[2, 2, 0.1])
        cube = spec.worldbody.add_body(name="red_cube", pos=[0.45, 0.0, CUBE / 2])
        cube.add_freejoint()
        cube.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[CUBE / 2] * 3, mass=0.06)
        if wall:
            spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.3, 0.01, 0.5], pos=[0.4, 0.2, 0.5])
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        for joint, servo, angle in zip(ARM_JOINTS, ARM_ACTUATORS, REST_Q, strict=True):
            self.data.joint(joint).qpos = angle
            self.data.actuator(servo).ctrl = angle
        for finger in FINGER_JOINTS:
            self.data.joint(finger).qpos = 0.04
        self.data.actuator(GRIPPER_ACTUATOR).ctrl = 0.04
        mujoco.mj_forward(self.model, self.data)

    def render(self, camera_name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, CameraIntrinsics]:
        """A wall."""
        lens = CameraIntrinsics(32, 24, 30.0, 30.0, 15.5, 11.5)
        return np.zeros((24, 32, 3), np.uint8), np.ones((24, 32), np.float32), np.eye(4), lens

    def truth(self) -> CellTruth:
        """The cube, as if it were at rest."""
        pose = np.eye(4)
        pose[:3, 3] = self.data.body("red_cube").xpos
        pose[:3, :3] = self.data.body("red_cube").xmat.reshape(3, 3)
        return CellTruth({"red_cube": StandingThing("red_cube", pose, np.full(3, CUBE), np.zeros(6), False)}, {})

    def frame_truth(self, camera_name: str) -> FrameTruth:
        """Nothing: the wall hides it."""
        return FrameTruth(())

    def reach(self, position: np.ndarray) -> np.ndarray:
        """Joints in [rad] that bring the tool centre point to a position in [m], hand pointing down as at REST_Q."""
        model, data = self.model, mujoco.MjData(self.model)
        data.qpos[:] = self.data.qpos
        site = model.site(TCP_SITE).id
        columns = [model.joint(j).dofadr[0] for j in ARM_JOINTS]
        rows = [model.joint(j).qposadr[0] for j in ARM_JOINTS]
        mujoco.mj_kinematics(model, data)
        upright = data.site_xmat[site].reshape(3, 3).copy()
        error = np.full(6, np.inf)
        for _ in range(200):
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            turn = upright @ data.site_xmat[site].reshape(3, 3).T
            turn = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
            error = np.concatenate([position - data.site_xpos[site], turn])
            jacobian = np.zeros((6, model.nv))
            mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], site)
            data.qpos[rows] += 0.5 * np.linalg.pinv(jacobian[:, columns]) @ error
        assert np.abs(error).max() < 1e-6
        return data.qpos[rows].copy()
