"""What the twin predicts after a motion: things and joints as it leaves them, all else as it was seen."""

from dataclasses import replace

import numpy as np
import pytest

from control.robot.limits import REST_Q
from sim_check.cells.loading import load_cell
from sim_check.twin.fixed_poses import fixed_scene
from sim_check.twin.predicted_scene import predicted_scene
from sim_check.twin.twin import build_twin


def test_moved_things_and_driven_joints_are_predicted_and_the_rest_keeps_its_estimate():
    cell = load_cell("cabinet-closed", {})
    scene = fixed_scene(cell.poses, cell.furniture, 0.0, 0.0)
    before = build_twin(cell, scene, np.array(REST_Q), 0.08)
    qpos = before.qpos.copy()
    cube = int(before.model.body("yellow_cube").jntadr[0])
    qpos[int(before.model.jnt_qposadr[cube])] -= 0.1
    door = before.joint("wooden_cabinet_left_door")
    assert door is not None
    qpos[int(before.model.joint(door.name).qposadr[0])] = door.position(0.5)
    after = predicted_scene(scene, before, replace(before, qpos=qpos))
    old, new = scene.get("yellow_cube"), after.get("yellow_cube")
    assert old is not None and new is not None
    assert new.position - old.position == pytest.approx([-0.1, 0.0, 0.0], abs=1e-6)
    cabinet = after.get("wooden_cabinet")
    assert cabinet is not None
    assert dict(cabinet.joint_fractions) == pytest.approx({"wooden_cabinet_left_door": 0.5})
    assert np.array_equal(cabinet.world_T_object, scene.objects[scene.names.index("wooden_cabinet")].world_T_object)
    assert predicted_scene(scene, before, before) == scene
