"""The region that the robot fills holds its visible surface, its fingers and what it holds, at any joints."""

import mujoco
import numpy as np
import pytest

from control.errors import ConfigError
from control.robot.limits import REST_Q
from control.twin_model import ARM_JOINTS, FINGER_JOINTS, TCP_SITE
from sim_check.cells.loading import load_cell
from sim_check.models.panda_mjcf import PICTURE_GROUP, panda_spec
from sim_check.models.robot_region import InTheHand, RobotRegions
from sim_check.models.scene_mjcf import place_robot
from sim_check.objects.solids import SolidShape

BENT = np.array([0.6, 0.2, -0.4, -1.9, 0.3, 2.0, 0.5])


def posed(robot, q, width, meshes=False):
    spec = panda_spec(meshes=meshes, gripper=robot.gripper_model)
    place_robot(spec, robot)
    model = spec.compile()
    data = mujoco.MjData(model)
    for name, angle in zip(ARM_JOINTS, q, strict=True):
        data.qpos[model.joint(name).qposadr[0]] = angle
    for name in FINGER_JOINTS:
        data.qpos[model.joint(name).qposadr[0]] = width / 2
    mujoco.mj_forward(model, data)
    return model, data


@pytest.fixture(scope="module")
def cell():
    return load_cell("cubes")


@pytest.mark.parametrize(("gripper", "q"), [("panda_hand", REST_Q), ("robotiq_2f85", BENT)])
def test_all_that_cameras_see_of_the_robot_lies_in_its_region(cell, gripper, q):
    robot = cell.robot.model_copy(update={"gripper": gripper, "position": (0.1, -0.2, 0.05), "yaw_deg": 30.0})
    model, data = posed(robot, q, 0.04, meshes=True)
    seen = []
    for geom in np.flatnonzero(model.geom_group == PICTURE_GROUP):
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
            mesh = model.geom_dataid[geom]
            first = model.mesh_vertadr[mesh]
            vertices = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
        else:
            vertices = np.zeros((1, 3))
        seen.append(vertices @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])
    points = np.concatenate(seen)
    distance = RobotRegions(robot).at(q, 0.04).distance(points)
    assert len(points) > 40
    assert distance.max() < 0.004  # what rounds the fingers off sticks out of their boxes by that


def test_the_space_between_open_fingers_is_not_the_robots(cell):
    regions = RobotRegions(cell.robot)
    _, data = posed(cell.robot, BENT, 0.08)
    between = data.site(TCP_SITE).xpos[None]
    assert regions.at(BENT, 0.08).distance(between)[0] > 0.03
    assert regions.at(BENT, 0.0).distance(between)[0] < 0.001


def test_what_the_hand_holds_and_the_camera_on_it_belong_to_the_region(cell):
    regions = RobotRegions(cell.robot, cell.cameras)
    _, data = posed(cell.robot, BENT, 0.04)
    tcp = np.eye(4)
    tcp[:3, :3], tcp[:3, 3] = data.site(TCP_SITE).xmat.reshape(3, 3), data.site(TCP_SITE).xpos
    below = (tcp @ [0.0, 0.0, 0.05, 1.0])[None, :3]
    stick = InTheHand((SolidShape("box", np.array([0.01, 0.01, 0.08])),), regions.hand_T(BENT, tcp))
    assert regions.at(BENT, 0.04).distance(below)[0] > 0.03
    assert regions.at(BENT, 0.04, stick).distance(below)[0] == pytest.approx(-0.01, abs=1e-5)
    wrist = next(camera for camera in cell.cameras if camera.mounting == "wrist")
    hand = data.body("panda_hand")
    centre = hand.xmat.reshape(3, 3) @ wrist.mount_T_camera[:3, 3] + hand.xpos
    assert regions.at(BENT, 0.04).distance(centre[None])[0] < 0.0
    assert RobotRegions(cell.robot).at(BENT, 0.04).distance(centre[None])[0] > 0.0


def test_joints_that_are_none_are_refused(cell):
    with pytest.raises(ConfigError, match="7 finite joints in rad"):
        RobotRegions(cell.robot).at(np.full(7, np.nan), 0.04)
