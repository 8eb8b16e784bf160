"""The simulated cell: physics that follows, grips, feels and drops, behind the same messages."""

from collections.abc import Iterator
from dataclasses import replace
from typing import cast

import mujoco
import numpy as np
import pytest

from benchmarks.robot_side.perfect_robot import certificate, gate, swing
from control.errors import ConfigError, RobotGoneError
from control.robot.limits import REST_Q
from control.trajectory.samples import SAMPLE_TIME, GripperCommand, Trajectory
from hw_interface.cell.client import CellClient
from hw_interface.cell.driver import Driver
from hw_interface.cell.node import RobotNode
from hw_interface.cell.pacing import Leash, run_loop
from hw_interface.cell.process import SimProcess
from hw_interface.simulated.sim_backend import SimBackend
from tests.support.robot_side.hw_sim_world import CubeWorld
from tests.support.robot_side.hw_support import joined, robot_process

GRASP_HEIGHT = 0.02  # of the tool centre point over the table in [m]


@pytest.fixture(scope="module")
def pick() -> Trajectory:
    """Down to the cube, grasp, 12 cm up, down again, release, up."""
    world = CubeWorld()
    above, down = (world.reach(np.array([0.45, 0.0, z])) for z in (0.14, GRASP_HEIGHT))
    return joined(
        np.array([REST_Q, above, down, above, down, above]),
        [None, GripperCommand("grasp", 0.04, 40.0), None, GripperCommand("move", 0.08), None],
        seconds=1.6,
        held=(None, None, "red_cube", "red_cube", None),
    )


@pytest.fixture(scope="module")
def robot() -> Iterator[SimProcess]:
    with robot_process("simulated", speed=0.0) as process:
        yield process


def test_a_cube_is_picked_up_and_put_down_over_the_wire(robot: SimProcess, pick: Trajectory):
    with CellClient.connect(robot.endpoint) as client:
        before = client.truth().poses["red_cube"][:3, 3]
        heights: list[float] = []
        report = client.execute(
            pick, certificate(pick), lambda _: heights.append(client.truth().poses["red_cube"][2, 3])
        )
        assert report.completed, report.detail
        after = client.truth().poses["red_cube"][:3, 3]
        assert max(heights) > before[2] + 0.10
        np.testing.assert_allclose(after, before, atol=0.005)
        assert not report.final_state.grasped
        assert report.final_state.gripper_width == pytest.approx(0.08, abs=0.002)
        held = report.gripper_width[np.searchsorted(report.times, 4.5)]
        assert held == pytest.approx(0.04, abs=0.003), "the pads stop at the cube's width"


class Waits:
    """In the place of a node: notes how long a loop may wait for requests, and ends it once the arm rests."""

    state_period, waiting, simulated = 0.02, False, True

    def __init__(self, driver: Driver, leash: Leash) -> None:
        self._driver, self._leash = driver, leash
        self.seconds: list[float] = []

    def serve(self, wait: float = 0.0) -> float:
        """Answer nothing."""
        self.seconds.append(wait)
        if not self._driver.moving:
            self._leash.end()
        return 0.0


def test_a_simulation_without_pace_waits_for_nothing_in_a_motion():
    driver, leash = simulated(CubeWorld())[0], Leash()
    motion = swing(0.5, 0.1)
    driver.submit(motion, certificate(motion))
    waits = Waits(driver, leash)
    run_loop(driver, cast(RobotNode, waits), leash, 0.0)
    assert len(waits.seconds) > 20 and set(waits.seconds[1:]) == {0.0}
    assert driver.state().progress == len(motion.q)


def test_the_truth_exists_only_where_a_scorer_was_announced():
    with robot_process("unscored", speed=0.0) as process, CellClient.connect(process.endpoint) as client:
        assert not client.info.scored
        with pytest.raises(RobotGoneError, match="does not offer it"):
            client.truth()


def simulated(world: CubeWorld) -> tuple[Driver, SimBackend]:
    backend = SimBackend(world.model, world.data)
    return Driver(backend, gate(), "test"), backend


def test_the_simulated_arm_follows_within_a_milliradian():
    driver, backend = simulated(CubeWorld())
    motion = swing(1.0, 0.3)
    serial = driver.submit(motion, certificate(motion)).serial
    while driver.moving:
        driver.tick()
    assert driver.result(serial).max_tracking_error < 1e-3
    # Samples are played at robot time: one step of a millisecond each, and one tick that finds the motion over.
    assert backend.time == pytest.approx((len(motion.q) + 1) * SAMPLE_TIME)


def test_at_rest_the_torques_carry_the_arm():
    world = CubeWorld()
    driver, backend = simulated(world)
    for _ in range(200):
        driver.tick()
    mujoco.mj_forward(world.model, world.data)
    columns = world.model.jnt_dofadr[[world.model.joint(f"panda_joint{i}").id for i in range(1, 8)]]
    np.testing.assert_allclose(backend.read().tau, world.data.qfrc_bias[columns], atol=0.05)


def test_a_wall_that_nobody_saw_stops_the_arm_before_it_is_pushed_hard():
    driver, backend = simulated(CubeWorld(wall=True))
    motion = swing(2.0, 1.2)
    serial = driver.submit(motion, certificate(motion)).serial
    forces = []
    while driver.moving:
        driver.tick()
        forces.append(backend.read().contact_force or 0.0)
    result = driver.result(serial)
    assert result.outcome == "reflex" and result.trouble is not None
    assert result.trouble.code == "contact"
    # A hit at 0.6 m/s peaks at 140 N before it is felt; the servos alone would push until their limits of 87 Nm.
    assert 30.0 < max(forces) < 200.0
    assert result.played < len(motion.q)
    for _ in range(500):
        driver.tick()
    assert driver.mode == "reflex"


def test_closing_on_nothing_is_a_missed_grasp(pick: Trajectory):
    world = CubeWorld()
    world.data.joint(world.model.body("red_cube").jntadr[0]).qpos[:2] = (0.6, 0.3)
    driver, _ = simulated(world)
    serial = driver.submit(pick, certificate(pick)).serial
    while driver.moving:
        driver.tick()
    trouble = driver.result(serial).trouble
    assert trouble is not None and trouble.code == "missed_grasp" and "holds nothing" in trouble.reason


def test_a_cube_torn_out_of_the_hand_is_a_lost_grasp(pick: Trajectory):
    world = CubeWorld()
    driver, backend = simulated(world)
    serial = driver.submit(pick, certificate(pick)).serial
    while driver.moving and backend.time < 4.5:
        driver.tick()
    assert driver.state().grasped
    world.data.joint(world.model.body("red_cube").jntadr[0]).qpos[:3] = (0.6, 0.4, 0.02)
    while driver.moving:
        driver.tick()
    trouble = driver.result(serial).trouble
    assert trouble is not None and trouble.code == "lost_grasp" and "red_cube slipped" in trouble.reason


def test_the_gripper_needs_time_to_close():
    driver, backend = simulated(CubeWorld())
    backend.gripper(GripperCommand("move", 0.0))
    steps = 0
    while backend.read().gripper_busy:
        driver.tick()
        steps += 1
        assert steps < 2000
    # 80 mm at 0.2 m/s a finger take 0.2 s at least.
    assert 200 <= steps <= 600
    assert backend.read().gripper_width < 0.002


@pytest.mark.parametrize("newtons", [15.0, 40.0])
def test_each_pad_presses_with_the_force_that_was_asked_for(pick: Trajectory, newtons: float):
    world = CubeWorld()
    event = pick.gripper[0]
    softer = replace(pick, gripper=(replace(event, command=GripperCommand("grasp", 0.04, newtons)), *pick.gripper[1:]))
    driver, backend = simulated(world)
    driver.submit(softer, certificate(softer))
    while backend.time < event.time + 0.9 * event.dwell:
        driver.tick()
    assert driver.state().grasped
    pads = [world.model.geom(name).id for name in ("left_pad", "right_pad")]
    force = np.zeros(6)
    pressing = dict.fromkeys(pads, 0.0)
    for i, contact in enumerate(world.data.contact):
        for pad in set(pads) & set(contact.geom.tolist()):
            mujoco.mj_contactForce(world.model, world.data, i, force)
            pressing[pad] += force[0]
    # The fingers' dry friction and the coupling's softness are what is left between asked and felt.
    assert list(pressing.values()) == pytest.approx([newtons, newtons], rel=0.15)


def test_a_world_without_the_names_of_the_robot_is_refused():
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    with pytest.raises(ConfigError, match="no actuator 'panda_joint1'"):
        SimBackend(model, mujoco.MjData(model))
