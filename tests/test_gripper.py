"""The gripper is one table of numbers that planning, the twin and the robot's side all read."""

from dataclasses import replace

import numpy as np

from control.grasps import grasps
from control.gripper import PANDA_HAND
from control.rollouts import gripper_ramp
from control.safety import SafetyLimits
from control.subtasks import posed_objects
from control.trajectory import GripperCommand
from tests.motion_scenes import cubes

SAFETY = SafetyLimits()


def test_a_gripper_that_opens_less_offers_fewer_grasps():
    twin = cubes()
    cube = posed_objects(twin, twin.start())["red_cube"]
    narrow = replace(PANDA_HAND, opening=cube.extents.min() + 2 * SAFETY.finger_clearance - 1e-3)
    assert grasps(cube, SAFETY, twin.support_height)
    assert not grasps(cube, SAFETY, twin.support_height, gripper=narrow)


def test_a_twin_plays_a_gripper_command_at_its_own_grippers_pace():
    twin = cubes()
    slow = replace(twin, gripper=replace(twin.gripper, planned_speed=twin.gripper.planned_speed / 2))
    close = GripperCommand("move", 0.0)
    usual, slowed = (gripper_ramp(t, 0.04, close, 0.004) for t in (twin, slow))
    assert len(slowed) == 2 * len(usual)
    np.testing.assert_allclose(slowed[-1], usual[-1])
