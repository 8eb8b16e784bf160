"""Twins of things on a table, each built once: what a good look at the built-in cells' things would give."""

from functools import cache

import numpy as np

from benchmarks.scenes.estimates import estimate, scene
from control.robot.gripper import PANDA_HAND, GripperModel
from control.robot.kinematics import ArmKinematics
from control.robot.limits import REST_Q
from control.tasks.reward_spec import RewardSpec, RewardTerm
from control.twin_model import TwinModel
from sim_check.cells.loading import CellConfig, load_cell
from sim_check.twin.twin import build_twin

CUBE, CRATE, BOWL, APPLE = (0.05, 0.05, 0.05), (0.11, 0.11, 0.06), (0.144, 0.144, 0.053), (0.069, 0.069, 0.069)
PALM_TO_CUBE = RewardTerm("minimize_l2_distance", "palm", "red_cube")


def carrying(cell: CellConfig, gripper: str) -> CellConfig:
    """A cell whose robot carries this gripper."""
    return cell.model_copy(update={"robot": cell.robot.model_copy(update={"gripper": gripper})})


def twin_of(*estimates, gripper: str = "panda_hand") -> TwinModel:
    """A settled twin with the arm at rest and the hand open."""
    cell = carrying(load_cell("cubes"), gripper)
    return build_twin(cell, scene(*estimates), np.array(REST_Q), cell.robot.gripper_model.opening)


@cache
def arm(gripper: GripperModel = PANDA_HAND) -> ArmKinematics:
    """The Panda, read once."""
    return ArmKinematics.from_urdf(gripper=gripper)


def hand_at(x: float, y: float, z: float) -> np.ndarray:
    """Joints in [rad] that bring the palm to a position in [m] with the hand pointing down."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = x, y, z
    return arm().solve_ik(pose[None], per_pose=1).q[0]


@cache
def cubes(gripper: str = "panda_hand") -> TwinModel:
    """A crate and two cubes with room around them."""
    return twin_of(
        estimate("crate", (0.50, 0.15, 0.03), CRATE, yaw=0.2),
        estimate("red_cube", (0.45, -0.15, 0.025), CUBE, yaw=0.3),
        estimate("yellow_cube", (0.58, -0.05, 0.025), CUBE, yaw=0.1),
        gripper=gripper,
    )


@cache
def blocked() -> TwinModel:
    """The crate is taken by the yellow cube; a blue one stands aside and blocks nothing."""
    return twin_of(
        estimate("crate", (0.50, 0.15, 0.03), CRATE, yaw=0.2),
        estimate("yellow_cube", (0.505, 0.148, 0.085), CUBE, yaw=0.5),
        estimate("red_cube", (0.45, -0.15, 0.025), CUBE, yaw=0.3),
        estimate("blue_cube", (0.60, -0.20, 0.025), CUBE),
    )


@cache
def fruit() -> TwinModel:
    """An apple and a bowl."""
    return twin_of(
        estimate("bowl", (0.50, 0.12, 0.0265), BOWL, "cylinder"),
        estimate("apple", (0.45, -0.15, 0.0345), APPLE, "sphere"),
    )


def ball_in_bowl(diameter: float = 0.057, aside: float = 0.012) -> TwinModel:
    """A ball on the floor of a bowl, off its middle: the walls come close to it on one side."""
    return twin_of(
        estimate("bowl", (0.50, 0.05, 0.0265), BOWL, "cylinder"),
        estimate("ball", (0.50 + aside, 0.05, 0.006 + diameter / 2), (diameter,) * 3, "sphere"),
    )


def only(kind, subject, target=None, value=None) -> RewardSpec:
    """A spec of one primary term."""
    return RewardSpec((RewardTerm(kind, subject, target, value, primary=True),))


def red_on_crate() -> RewardSpec:
    """Place the red cube on the crate; the palm goes to the cube on the way."""
    primary = RewardTerm("minimize_l2_distance", "red_cube", "crate", primary=True)
    return RewardSpec((PALM_TO_CUBE, primary))
