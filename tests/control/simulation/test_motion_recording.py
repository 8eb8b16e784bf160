"""What residuals read of a replayed motion is what MuJoCo says of each of its states."""

import mujoco
import numpy as np
import pytest

from benchmarks.scenes.tabletop_twins import cubes
from control.safety.zones import RobotPoints
from control.simulation.motion_recording import FORCE_FLOOR, Purpose, contact_names, record_motion
from control.simulation.rollouts import Commands, roll_out
from control.twin_model import ARM_BODIES, FINGER_BODIES, HAND_BODY

STRIDE = 5


@pytest.fixture(scope="module")
def pressed():
    """The arm sinks with the gripper open until it presses on what is in its way."""
    twin = cubes()
    count = 400
    arm = np.tile(twin.q, (count, 1))
    arm[:, 1] += np.minimum(np.linspace(0.0, 2.4, count), 1.8)
    speed = np.gradient(arm, twin.model.opt.timestep, axis=0)
    (rollout,), _ = roll_out([twin], [Commands(arm, speed, np.full(count, 0.04), ())], nthread=1)
    return twin, rollout


def test_forces_are_those_of_each_contact_of_each_state(pressed):
    twin, rollout = pressed
    purpose = Purpose(handled=frozenset({"red_cube"}))
    motion = record_motion(rollout, twin, purpose, STRIDE)
    acting = {*ARM_BODIES, HAND_BODY, *FINGER_BODIES, "red_cube"}
    names = contact_names(rollout.model, frozenset(o.name for o in twin.objects))
    data, force, expected = mujoco.MjData(rollout.model), np.zeros(6), []
    for step, time in enumerate(motion.time):
        row = int(np.argmin(np.abs(rollout.time - time)))
        data.qpos[:], data.qvel[:], data.ctrl[:] = rollout.qpos[row], rollout.qvel[row], rollout.ctrl[row]
        mujoco.mj_forward(rollout.model, data)
        for i, contact in enumerate(data.contact):
            pair = tuple(names[g] for g in contact.geom)
            mujoco.mj_contactForce(rollout.model, data, i, force)
            size = float(np.linalg.norm(force[:3]))
            if pair[0] != pair[1] and acting & {*pair} and size > FORCE_FLOOR:
                expected.append((step, pair, size))
    c = motion.contacts
    assert [(s, c.pairs[p]) for s, p in zip(c.step, c.pair, strict=True)] == [e[:2] for e in expected]
    assert c.force == pytest.approx([e[2] for e in expected])
    robot = {*ARM_BODIES, HAND_BODY, *FINGER_BODIES}
    assert any(robot & {*pair} for pair in c.pairs)  # the arm did press on something
    assert ("crate", "blue_cube") not in c.pairs  # nobody's business


def test_points_of_the_robot_over_time_are_those_of_each_state(pressed):
    twin, rollout = pressed
    motion = record_motion(rollout, twin, Purpose(), STRIDE)
    assert motion.robot is not None
    data = mujoco.MjData(rollout.model)
    for row in (0, len(rollout.time) - 1):
        data.qpos[:] = rollout.qpos[row]
        mujoco.mj_kinematics(rollout.model, data)
        at = int(np.argmin(np.abs(motion.time - rollout.time[row])))
        assert motion.robot.points[at] == pytest.approx(RobotPoints(rollout.model).at(data), abs=1e-12)
