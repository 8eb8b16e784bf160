"""The gripper's service and a carried load, with the real libfranka and a real (simulated) cube between the pads."""

import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from benchmarks.robot_side.libfranka_motions import along, desired, play, robot_at, swing
from hw_interface.fci_simulator.process import ControlBoxProcess
from tests.support.robot_side.control_boxes import control_box, later
from tests.support.robot_side.hw_sim_world import CUBE, CubeWorld
from tests.support.waiting import until

libfranka = pytest.importorskip("panda_py", reason="drives the box with libfranka").libfranka
# A client that waits for ever inside libfranka can be ended by nothing but the end of its process.
pytestmark = pytest.mark.timeout(method="thread")

GRASP_HEIGHT = 0.02  # of the tool centre point over the table in [m]
CUBE_MASS = 0.06  # [kg]


@pytest.fixture(scope="module")
def box() -> Iterator[ControlBoxProcess]:
    with control_box() as process:
        yield process


@pytest.fixture(scope="module")
def robot(box: ControlBoxProcess) -> Any:
    return robot_at(box.address)


@pytest.fixture(scope="module")
def gripper(box: ControlBoxProcess) -> Any:
    return libfranka.Gripper(box.address)


def go_to(robot: Any, q: np.ndarray) -> None:
    here = desired(robot)
    play(robot, swing(here, q - here, 1.2))


def test_moves_reach_their_width_at_their_speed(robot: Any, gripper: Any):
    assert gripper.server_version() == 3
    assert gripper.read_once().max_width == 0.08
    assert gripper.move(0.02, 0.1)
    assert gripper.read_once().width == pytest.approx(0.02, abs=5e-4)
    begun = robot.read_once().time.to_msec()
    assert gripper.move(0.06, 0.04)
    took = robot.read_once().time.to_msec() - begun
    assert 900 < took < 3000  # 40 mm at 40 mm/s; a busy machine lets robot time go on before it asks again
    assert gripper.homing()
    assert gripper.read_once().width == pytest.approx(0.08, abs=5e-4)


def test_a_grasp_of_nothing_is_not_a_grasp(gripper: Any):
    assert not gripper.grasp(CUBE, 0.2, 20.0)
    assert not gripper.read_once().is_grasped
    assert gripper.move(0.08, 0.2)


@pytest.mark.parametrize("width", [-0.01, 0.2])
def test_a_width_that_there_is_not_fails(gripper: Any, width: float):
    with pytest.raises(RuntimeError, match="Command failed"):
        gripper.move(width, 0.1)


def test_a_stop_ends_a_move_where_the_fingers_are(robot: Any, gripper: Any):
    said: list[str] = []

    def close() -> None:
        try:
            gripper.move(0.0, 0.02)
        except RuntimeError as error:
            said.append(str(error))

    thread = threading.Thread(target=close)
    thread.start()
    assert until(lambda: gripper.read_once().width < 0.075)
    assert gripper.stop()
    thread.join()
    assert said == ["libfranka gripper: Command aborted!"]
    width = gripper.read_once().width
    assert 0.005 < width < 0.075
    later(robot, 0.2)
    assert gripper.read_once().width == pytest.approx(width, abs=1e-3)
    gripper.move(0.08, 0.2)


def test_a_cube_is_grasped_felt_announced_lifted_and_let_go(robot: Any, gripper: Any):
    world = CubeWorld()
    above, down = (world.reach(np.array([0.45, 0.0, z])) for z in (0.12, GRASP_HEIGHT))
    go_to(robot, above)
    go_to(robot, down)
    assert not gripper.grasp(0.02, 0.1, 30.0, 0.005, 0.005), "the cube is wider than that"
    assert gripper.move(0.08, 0.1)
    assert gripper.grasp(CUBE, 0.1, 30.0, 0.005, 0.005)
    state = gripper.read_once()
    assert state.is_grasped
    assert state.width == pytest.approx(CUBE, abs=1e-3)
    go_to(robot, above)
    state = later(robot, 0.3)
    weight = CUBE_MASS * 9.81
    assert state.O_F_ext_hat_K[2] == pytest.approx(weight, abs=0.05), "the robot holds the cube up"
    np.testing.assert_allclose(state.O_F_ext_hat_K[:2], 0.0, atol=0.05)
    # At the tool centre point: as far from the flange as F_T_EE says.
    tcp = np.array(state.F_T_EE).reshape(4, 4).T[:3, 3]
    robot.set_load(CUBE_MASS, tcp.tolist(), np.zeros(9).tolist())
    state = later(robot, 0.3)
    assert state.m_load == CUBE_MASS
    np.testing.assert_allclose(state.tau_ext_hat_filtered, 0.0, atol=0.02)
    np.testing.assert_allclose(state.tau_J, robot.load_model().gravity(state), atol=0.05)
    go_to(robot, down)
    robot.set_load(0.0, [0.0] * 3, [0.0] * 9)
    assert gripper.move(0.08, 0.1)
    assert not gripper.read_once().is_grasped
    go_to(robot, above)


def test_a_gripper_works_while_the_arm_moves(robot: Any, gripper: Any):
    gripper.move(0.08, 0.2)
    done: list[bool] = []
    thread = threading.Thread(target=lambda: done.append(gripper.move(0.03, 0.1)))
    thread.start()
    play(robot, swing(desired(robot), along(1, 0.2), 1.5))
    thread.join()
    assert done == [True]


def test_a_silent_gripper_keeps_its_client_waiting_and_the_robot_moving(
    box: ControlBoxProcess, robot: Any, gripper: Any
):
    box.faults.send("gripper_silent on")
    try:
        with pytest.raises(RuntimeError, match=r"(?i)timeout"):
            for _ in range(3):
                gripper.read_once()
        play(robot, swing(desired(robot), along(1, -0.1), 0.5))
    finally:
        box.faults.send("gripper_silent off")
    assert gripper.read_once().width > 0.0


def test_a_gripper_that_is_absent_refuses(box: ControlBoxProcess):
    box.faults.send("gripper off")
    with pytest.raises(Exception, match="refused"):
        libfranka.Gripper(box.address)
    box.faults.send("gripper on")
    assert libfranka.Gripper(box.address).server_version() == 3
