"""The model library that the simulated control box hands out, as the real libfranka loads it, against Pinocchio."""

import os
import shutil
from collections.abc import Iterator
from typing import Any

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
import pytest

from benchmarks.robot_side.libfranka_motions import robot_at
from control.errors import MachineError
from control.robot.description import FLANGE_FRAME
from control.robot.description_files import panda_urdf
from hw_interface.fci_simulator.arm import Arm, RigidLoad
from hw_interface.fci_simulator.model_library import build_library, library_source
from hw_interface.fci_simulator.process import ControlBoxProcess
from tests.support.robot_side.control_boxes import control_box

libfranka = pytest.importorskip("panda_py", reason="loads the library with libfranka").libfranka
# A client that waits for ever inside libfranka can be ended by nothing but the end of its process.
pytestmark = pytest.mark.timeout(method="thread")

LOAD = RigidLoad(1.2, np.array([0.02, -0.01, 0.15]), np.diag([0.004, 0.005, 0.006]) + 0.001 * (1 - np.eye(3)))
F_T_EE = pin.SE3(pin.rpy.rpyToMatrix(0.2, -0.3, -0.8), np.array([0.01, 0.02, 0.1]))
EE_T_K = pin.SE3(pin.rpy.rpyToMatrix(-0.1, 0.4, 0.3), np.array([0.0, -0.03, 0.05]))
EXACT = 1e-12  # in units of each quantity; both compute in double precision


@pytest.fixture(scope="module")
def box() -> Iterator[ControlBoxProcess]:
    with control_box() as process:
        yield process


@pytest.fixture(scope="module")
def model(box: ControlBoxProcess) -> Any:
    return robot_at(box.address).load_model()


@pytest.fixture(scope="module")
def loaded() -> Any:
    """Pinocchio's arm with the load at its flange."""
    arm = Arm()
    whole = arm.model.copy()
    flange = whole.frames[whole.getFrameId(FLANGE_FRAME)].placement
    whole.inertias[7] += flange.act(pin.Inertia(LOAD.mass, LOAD.com, LOAD.inertia))
    return whole


def poses() -> list[tuple[np.ndarray, np.ndarray]]:
    rng = np.random.default_rng(5)
    return [(rng.uniform(-1.7, 1.7, 7), rng.uniform(-2.0, 2.0, 7)) for _ in range(5)]


@pytest.mark.parametrize(("q", "dq"), poses())
def test_dynamics_with_a_load_are_those_of_pinocchio(model: Any, loaded: Any, q: np.ndarray, dq: np.ndarray):
    data = loaded.createData()
    inertia = LOAD.inertia.T.ravel().tolist()
    mass = np.array(model.mass(q, inertia, LOAD.mass, LOAD.com)).reshape(7, 7).T
    upper = np.triu(pin.crba(loaded, data, q))
    np.testing.assert_allclose(mass, upper + np.triu(upper, 1).T, atol=EXACT)
    gravity = pin.computeGeneralizedGravity(loaded, data, q).copy()
    np.testing.assert_allclose(model.gravity(q, LOAD.mass, LOAD.com, [0.0, 0.0, -9.81]), gravity, atol=100 * EXACT)
    coriolis = pin.nonLinearEffects(loaded, data, q, dq) - gravity
    np.testing.assert_allclose(model.coriolis(q, dq, inertia, LOAD.mass, LOAD.com), coriolis, atol=100 * EXACT)


FRAMES = ["kJoint1", "kJoint2", "kJoint3", "kJoint4", "kJoint5", "kJoint6", "kJoint7"]


def frames(arm: Any, data: Any, q: np.ndarray) -> dict[str, tuple[Any, int]]:
    """Placement of every frame of libfranka in the base, and how many joints move it."""
    pin.forwardKinematics(arm, data, q)
    flange = data.oMi[7] * arm.frames[arm.getFrameId(FLANGE_FRAME)].placement
    known = {name: (data.oMi[i + 1].copy(), i + 1) for i, name in enumerate(FRAMES)}
    return {
        **known,
        "kFlange": (flange, 7),
        "kEndEffector": (flange * F_T_EE, 7),
        "kStiffness": (flange * F_T_EE * EE_T_K, 7),
    }


@pytest.mark.parametrize(("q", "_dq"), poses())
def test_poses_and_jacobians_of_all_frames_are_those_of_pinocchio(model: Any, q: np.ndarray, _dq: np.ndarray):
    arm = Arm().model
    data = arm.createData()
    given = (F_T_EE.homogeneous.T.ravel().tolist(), EE_T_K.homogeneous.T.ravel().tolist())
    for name, (placement, moving) in frames(arm, data, q).items():
        frame = getattr(libfranka.Frame, name)
        pose = np.array(model.pose(frame, q, *given)).reshape(4, 4).T
        np.testing.assert_allclose(pose, placement.homogeneous, atol=EXACT, err_msg=name)
        wanted = pin.computeJointJacobians(arm, data, q)
        # Pinocchio's columns are twists at the base's origin: moved to the frame's own origin they are geometric.
        shifted = pin.SE3(np.eye(3), placement.translation).toActionMatrixInverse() @ wanted
        shifted[:, moving:] = 0.0
        jacobian = np.array(model.zero_jacobian(frame, q, *given)).reshape(7, 6).T
        if name == "kJoint1":  # q is not passed for it: its axis does not depend on q
            np.testing.assert_allclose(jacobian[:, 0], (0, 0, 0, 0, 0, 1), atol=EXACT)
        np.testing.assert_allclose(jacobian, shifted, atol=EXACT, err_msg=name)
        own = np.vstack([placement.rotation.T @ shifted[:3], placement.rotation.T @ shifted[3:]])
        body = np.array(model.body_jacobian(frame, q, *given)).reshape(7, 6).T
        np.testing.assert_allclose(body, own, atol=EXACT, err_msg=name)


def test_the_hand_is_told_apart_from_the_arm_without_losing_mass_or_leverage():
    arm = Arm()
    whole = pin.buildModelFromUrdf(str(panda_urdf()))
    q = np.array([0.3, -0.5, 0.2, -1.9, 0.4, 1.2, 0.5])
    locked = pin.buildReducedModel(
        whole,
        [whole.getJointId(n) for n in whole.names if "finger" in n],
        np.concatenate([pin.neutral(whole)[:7], [0.04, 0.04]]),
    )
    alone = arm.model.copy()
    flange = alone.frames[alone.getFrameId(FLANGE_FRAME)].placement
    alone.inertias[7] += flange.act(pin.Inertia(arm.hand.mass, arm.hand.com, arm.hand.inertia))
    zero = np.zeros(7)
    np.testing.assert_allclose(
        pin.rnea(alone, alone.createData(), q, zero, q), pin.rnea(locked, locked.createData(), q, zero, q), atol=1e-9
    )


def test_without_a_compiler_the_box_says_what_to_install(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("PATH", os.devnull)
    with pytest.raises(MachineError, match=r"no C compiler 'cc'.*everything else works.*apt install gcc libc6-dev"):
        build_library(Arm().model)


def test_a_box_without_a_library_answers_with_an_error_and_moves_all_the_same():
    with control_box("no-library") as box:
        robot = robot_at(box.address)
        with pytest.raises(Exception, match="Server reports error when loading model library"):
            robot.load_model()
        assert robot.read_once().robot_mode == libfranka.RobotMode.kIdle


def test_the_library_is_plain_c_without_anything_of_this_machine():
    source = library_source(Arm().model)
    assert source.count("void O_T_J") == source.count("void O_J_J") == source.count("void Ji_J_J") == 9
    assert not any(word in source for word in (os.path.sep + "home", os.getcwd(), str(shutil.which("cc"))))
