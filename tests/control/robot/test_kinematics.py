"""The batched kinematics say what Pinocchio says, and their inverse is one."""

from functools import cache

import numpy as np
import pinocchio as pin  # type: ignore[import-not-found]
import pytest

from control.errors import ConfigError
from control.robot.description_files import panda_urdf
from control.robot.kinematics import TCP_FRAME, ArmKinematics, default_seeds
from control.robot.limits import REST_Q, panda_limits
from control.robot.rotations import rotation_exp, rotation_log, straight_poses


@cache
def arm() -> ArmKinematics:
    return ArmKinematics.from_urdf()


def configurations(count: int, seed: int, margin: float = 0.0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(arm().q_min + margin, arm().q_max - margin, (count, 7))


def table_poses(count: int, seed: int) -> np.ndarray:
    """Tool poses above a table, pointing down, any yaw."""
    rng = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, 3] = rng.uniform([0.3, -0.35, 0.02], [0.65, 0.35, 0.3], (count, 3))
    yaw = np.zeros((count, 3))
    yaw[:, 2] = rng.uniform(-np.pi, np.pi, count)
    poses[:, :3, :3] = rotation_exp(yaw) @ np.diag([1.0, -1.0, -1.0])
    return poses


def test_poses_and_jacobians_agree_with_pinocchio():
    q = configurations(1000, seed=1)
    position, rotation, jacobian = arm().jacobian(q)
    model = pin.buildModelFromUrdf(str(panda_urdf()))
    data = model.createData()
    frame = model.getFrameId(TCP_FRAME)
    for i in range(len(q)):
        pin.computeJointJacobians(model, data, np.append(q[i], [0.0, 0.0]))
        pin.updateFramePlacements(model, data)
        # Both do the same few products in double precision.
        np.testing.assert_allclose(position[i], data.oMf[frame].translation, atol=1e-12)
        np.testing.assert_allclose(rotation[i], data.oMf[frame].rotation, atol=1e-12)
        expected = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)[:, :7]
        np.testing.assert_allclose(jacobian[i], expected, atol=1e-12)


def test_transforms_hold_the_same_pose_as_forward():
    q = configurations(20, seed=2)
    position, rotation = arm().forward(q)
    poses = arm().poses(q)
    np.testing.assert_array_equal(poses[:, :3, 3], position)
    np.testing.assert_array_equal(poses[:, :3, :3], rotation)
    np.testing.assert_array_equal(poses[:, 3], np.tile([0.0, 0.0, 0.0, 1.0], (20, 1)))


def test_the_urdf_has_the_published_joint_limits():
    limits = panda_limits()
    np.testing.assert_allclose(arm().q_min, limits.q_min)
    np.testing.assert_allclose(arm().q_max, limits.q_max)


def test_a_robot_that_is_no_seven_joint_arm_is_refused(tmp_path):
    file = tmp_path / "stick.urdf"
    file.write_text('<robot name="stick"><link name="stick"/></robot>')
    with pytest.raises(ConfigError, match=r"stick.urdf must start with seven revolute joints about z"):
        ArmKinematics.from_urdf(file)


def test_every_pose_above_the_table_is_solved_within_tolerance_and_limits():
    targets = table_poses(200, seed=3)
    found = arm().solve_ik(targets)
    assert set(found.pose) == set(range(200))
    off, turned = arm().errors(found.q, targets[found.pose])
    assert off.max() <= 1e-4
    assert turned.max() <= 1e-3
    np.testing.assert_allclose(found.margin, np.minimum(found.q - arm().q_min, arm().q_max - found.q).min(axis=1))
    assert found.margin.min() >= 0.03


def test_most_poses_that_the_arm_can_take_are_found_again():
    targets = arm().poses(configurations(200, seed=4, margin=0.2))
    # Measured 95 %; random postures include the folded ones that no seed is near.
    assert len(set(arm().solve_ik(targets).pose)) >= 180


def test_solutions_of_one_pose_differ_and_are_no_more_than_asked_for():
    targets = table_poses(50, seed=5)
    found = arm().solve_ik(targets, per_pose=2)
    several = 0
    for pose in range(50):
        q = found.q[found.pose == pose]
        assert len(q) <= 2
        if len(q) == 2:
            several += 1
            assert np.abs(q[0] - q[1]).max() > 0.35
    assert several >= 40


def test_seeds_may_differ_from_pose_to_pose():
    q = configurations(30, seed=6, margin=0.3)
    found = arm().solve_ik(arm().poses(q), seeds=q[None] + 0.05, per_pose=1)
    assert len(found.pose) == 30
    # From so near a seed the solution stays in the seed's branch.
    assert np.abs(found.q - q).max() < 0.5


def test_a_pose_out_of_reach_has_no_solution():
    target = np.eye(4)[None].copy()
    target[0, :3, 3] = [1.5, 0.0, 0.5]
    found = arm().solve_ik(target)
    assert found.q.shape == (0, 7)
    assert len(found.pose) == 0


def test_arrays_that_do_not_fit_are_named_with_their_shapes():
    with pytest.raises(ValueError, match=r"need targets \(n, 4, 4\).*got \(2, 3\)"):
        arm().solve_ik(np.zeros((2, 3)))
    with pytest.raises(ValueError, match=r"need q \(n, 7\) and targets \(n, k, 4, 4\); got \(1, 6\)"):
        arm().follow(np.zeros((1, 6)), np.zeros((1, 2, 4, 4)))


def test_a_straight_lift_is_followed_without_jumps():
    q = np.array([REST_Q])
    start = arm().poses(q)
    end = start.copy()
    end[:, 2, 3] += 0.15
    targets = straight_poses(start, end, 10)
    paths, ok = arm().follow(q, targets)
    assert ok.tolist() == [True]
    position, _ = arm().forward(paths[0])
    np.testing.assert_allclose(position, targets[0, :, :3, 3], atol=1e-3)
    assert np.abs(np.diff(np.concatenate([q, paths[0]]), axis=0)).max() < 0.2


def test_a_path_that_leaves_the_workspace_is_reported():
    q = np.array([REST_Q])
    start = arm().poses(q)
    end = start.copy()
    end[:, 0, 3] += 1.0
    _, ok = arm().follow(q, straight_poses(start, end, 20))
    assert ok.tolist() == [False]


def test_seeds_respect_the_limits_and_start_with_the_rest_pose():
    seeds = default_seeds()
    assert arm().margin(seeds).min() > 0.1
    np.testing.assert_allclose(seeds[0], REST_Q)


def test_logarithm_and_exponential_undo_each_other_up_to_half_a_turn():
    rng = np.random.default_rng(7)
    axis = rng.normal(size=(400, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    angle = np.concatenate([[0.0, 1e-12, 1e-6, np.pi - 1e-2, np.pi - 1e-4, np.pi - 1e-7], rng.uniform(0, np.pi, 394)])
    vectors = axis * angle[:, None]
    # Near half a turn the axis comes from a square root of rounding errors.
    np.testing.assert_allclose(rotation_log(rotation_exp(vectors)), vectors, atol=1e-8)


def test_half_a_turn_has_length_pi_whatever_the_axis():
    for axis in np.vstack([np.eye(3), [[0.6, 0.8, 0.0], [0.48, -0.6, 0.64]]]):
        turn = rotation_log(2.0 * np.outer(axis, axis) - np.eye(3))
        np.testing.assert_allclose(np.linalg.norm(turn), np.pi)
        np.testing.assert_allclose(abs(turn @ axis), np.pi)


def test_straight_poses_end_at_the_end_and_turn_evenly():
    start, end = np.eye(4)[None], np.eye(4)[None].copy()
    end[0, :3, 3] = [0.3, 0.0, 0.6]
    end[0, :3, :3] = rotation_exp(np.array([0.0, 0.0, 1.2]))
    poses = straight_poses(start, end, 3)
    np.testing.assert_allclose(poses[0, -1], end[0], atol=1e-12)
    np.testing.assert_allclose(poses[0, 0, :3, 3], [0.1, 0.0, 0.2])
    np.testing.assert_allclose(rotation_log(poses[0, :, :3, :3])[:, 2], [0.4, 0.8, 1.2])
