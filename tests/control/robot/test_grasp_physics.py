"""A cube in the simulated hand stays there, however the arm shakes, until the hand opens."""

from dataclasses import dataclass

import mujoco
import numpy as np
import pytest

from control.robot.dynamics import RobotModel
from control.robot.gripper import GRIPPERS, PANDA_HAND, GripperModel
from control.robot.limits import REST_Q
from control.twin_model import FINGER_JOINTS, GRIPPER_ACTUATOR, TCP_SITE
from sim_check.models.panda_mjcf import PAD_NAMES, SERVO_LEAD, panda_spec

OPEN = 0.04  # half width in [m]
FINGER_SPEED = 0.1  # of one finger in [m/s]: half of the rated 0.2 m/s of the URDF


@dataclass
class Hand:
    """The arm at REST_Q with a cube between the open fingers, on a small stand."""

    model: mujoco.MjModel
    data: mujoco.MjData

    def step(self, seconds: float) -> None:
        for _ in range(round(seconds / self.model.opt.timestep)):
            mujoco.mj_step(self.model, self.data)

    def close(self, seconds: float = 0.8) -> None:
        """Close at the real hand's speed; afterwards the servo keeps squeezing."""
        grip = self.model.actuator(GRIPPER_ACTUATOR).id
        for i in range(round(seconds / self.model.opt.timestep)):
            self.data.ctrl[grip] = max(0.0, OPEN - FINGER_SPEED * i * self.model.opt.timestep)
            mujoco.mj_step(self.model, self.data)

    def cube_in_hand(self) -> np.ndarray:
        """Cube centre in the tool's frame in [m]."""
        site = self.data.site(TCP_SITE)
        return site.xmat.reshape(3, 3).T @ (self.data.body("cube").xpos - site.xpos)

    def pad_force(self, pad: str) -> float:
        """Sum of normal forces at a pad in [N]."""
        total, force = 0.0, np.zeros(6)
        for i, contact in enumerate(self.data.contact):
            if self.model.geom(pad).id in contact.geom:
                mujoco.mj_contactForce(self.model, self.data, i, force)
                total += force[0]
        return total

    def shake(self, seconds: float = 4.0, frequency: float = 1.5, amplitude: float = 0.2) -> tuple[float, float]:
        """All joints swing; returns the cube's farthest slip in [m] and the hand's peak acceleration in [m/s^2]."""
        step = self.model.opt.timestep
        swing = amplitude * np.array([1.0, 0.6, 0.8, 0.6, 1.0, 1.0, 1.5])
        phase, omega = 0.9 * np.arange(7), 2 * np.pi * frequency
        before, slip, path = self.cube_in_hand(), 0.0, []
        for i in range(round(seconds / step)):
            t = i * step
            s = min(t, 1.0)
            ramp = s**3 * (10 - 15 * s + 6 * s * s)
            wanted = REST_Q + swing * ramp * np.sin(omega * t + phase)
            self.data.ctrl[:7] = wanted + SERVO_LEAD * swing * ramp * omega * np.cos(omega * t + phase)
            mujoco.mj_step(self.model, self.data)
            slip = max(slip, float(np.linalg.norm(self.cube_in_hand() - before)))
            path.append(self.data.site(TCP_SITE).xpos.copy())
        return slip, float(np.linalg.norm(np.diff(path, 2, axis=0), axis=1).max()) / step**2


def hand_with_cube(
    step: float = 0.002,
    half: float = 0.025,
    mass: float = 0.15,
    aside: float = 0.0,
    pad_friction: float | None = None,
    gripper: GripperModel = PANDA_HAND,
) -> Hand:
    spec = panda_spec(meshes=False, gripper=gripper)
    spec.option.timestep = step
    tool = RobotModel.panda(gripper=gripper).tcp_pose(np.array(REST_Q))[:3, 3]
    spec.worldbody.add_geom(
        name="stand", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.02, 0.02, 0.01], pos=tool - [0.0, 0.0, half + 0.01]
    )
    cube = spec.worldbody.add_body(name="cube", pos=[tool[0], tool[1] + aside, tool[2]])
    cube.add_freejoint()
    cube.add_geom(name="cube", type=mujoco.mjtGeom.mjGEOM_BOX, size=[half] * 3, mass=mass)
    if pad_friction is not None:
        for pad in PAD_NAMES:
            spec.geom(pad).friction = [pad_friction, 0.0, 0.0]
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:7] = REST_Q
    data.ctrl[:7] = REST_Q
    for finger in FINGER_JOINTS:
        data.joint(finger).qpos[:] = OPEN
    data.ctrl[7] = OPEN
    mujoco.mj_forward(model, data)
    return Hand(model, data)


def take_away_the_stand(hand: Hand) -> None:
    hand.model.geom("stand").contype[:] = 0
    hand.model.geom("stand").conaffinity[:] = 0


@pytest.mark.parametrize("gripper", GRIPPERS.values(), ids=GRIPPERS)
def test_both_pads_press_with_the_grasp_force(gripper):
    hand = hand_with_cube(gripper=gripper)
    hand.close()
    for pad in PAD_NAMES:
        assert hand.pad_force(pad) == pytest.approx(gripper.pad_force, rel=0.05)
    # The pads do not sink into a stiff cube.
    assert np.abs(hand.data.qpos[7:9] - 0.025).max() < 3e-4


# The drift is that of the integrator, it grows with the step: 4.7 mm and 10.7 mm measured.
@pytest.mark.parametrize("gripper", GRIPPERS.values(), ids=GRIPPERS)
@pytest.mark.parametrize(("step", "most"), [(0.002, 0.007), (0.004, 0.015)])
def test_a_gripped_cube_survives_a_violent_shake(step, most, gripper):
    hand = hand_with_cube(step, gripper=gripper)
    hand.close()
    take_away_the_stand(hand)
    slip, acceleration = hand.shake()
    assert acceleration > 10.0  # beyond what any admitted motion does
    assert slip < most


def test_a_held_cube_does_not_sink():
    hand = hand_with_cube()
    hand.close()
    take_away_the_stand(hand)
    before = hand.cube_in_hand()
    hand.step(4.0)
    assert np.linalg.norm(hand.cube_in_hand() - before) < 5e-4


def test_slippery_pads_lose_the_cube():
    # The other tests would be worthless if something else than friction held the cube.
    hand = hand_with_cube(pad_friction=0.01)
    hand.close()
    take_away_the_stand(hand)
    hand.step(1.0)
    assert np.linalg.norm(hand.cube_in_hand()) > 0.2


def test_opening_the_hand_lets_the_cube_fall():
    hand = hand_with_cube()
    hand.close()
    take_away_the_stand(hand)
    height = hand.data.body("cube").xpos[2]
    hand.data.ctrl[7] = OPEN
    hand.step(0.4)
    assert hand.data.qpos[7] == pytest.approx(OPEN, abs=1e-3)
    # Free fall for 0.3 s is 0.44 m.
    assert hand.data.body("cube").xpos[2] < height - 0.3


@pytest.mark.parametrize("step", [0.002, 0.004])
def test_a_cube_aside_is_pulled_to_the_middle(step):
    hand = hand_with_cube(step, aside=0.008)
    hand.close()
    assert abs(hand.cube_in_hand()[1]) < 1.5e-3


@pytest.mark.parametrize("step", [0.002, 0.004])
def test_slamming_the_fingers_shut_does_not_throw_the_cube(step):
    hand = hand_with_cube(step, aside=0.008)
    hand.data.ctrl[7] = 0.0
    hand.step(1.0)
    assert np.linalg.norm(hand.cube_in_hand()) < 3e-3


def test_the_fingers_move_together():
    hand = hand_with_cube(half=0.01)
    hand.close()
    take_away_the_stand(hand)
    hand.shake(2.0)
    assert abs(hand.data.qpos[7] - hand.data.qpos[8]) < 5e-4
