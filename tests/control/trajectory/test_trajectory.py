"""A trajectory is well formed, read-only, and its hash covers everything that a robot would act on."""

from dataclasses import replace

import numpy as np
import pytest

from control.errors import TrajectoryError
from control.trajectory.samples import GripperCommand, GripperEvent, Trajectory, TrajectorySegment


def some_trajectory() -> Trajectory:
    rng = np.random.default_rng(0)
    q, qd, qdd = rng.normal(size=(3, 50, 7))
    return Trajectory(
        q,
        qd,
        qdd,
        gripper=(GripperEvent(0.01, 0.02, GripperCommand("grasp", 0.04, 30.0)),),
        segments=(
            TrajectorySegment("reach", 0, 20),
            TrajectorySegment("lift", 20, 50, held="red_cube", touching=(("red_cube", "table"),)),
        ),
    )


def with_flipped_bit(trajectory: Trajectory, field: str, element: int, bit: int) -> Trajectory:
    """The same trajectory with one bit of one number turned over."""
    array = np.array(getattr(trajectory, field))
    array.view(np.uint64).reshape(-1)[element] ^= np.uint64(1) << np.uint64(bit)
    return replace(trajectory, **{field: array})


def test_equal_trajectories_have_equal_hashes():
    assert some_trajectory().content_hash() == some_trajectory().content_hash()


@pytest.mark.parametrize("field", ["q", "qd", "qdd"])
def test_a_single_flipped_bit_in_any_sample_changes_the_hash(field):
    trajectory = some_trajectory()
    rng = np.random.default_rng(1)
    hashes = {trajectory.content_hash()}
    for _ in range(50):
        # Bits above 51 belong to exponent and sign, where a flip may make a number infinite.
        element, bit = int(rng.integers(trajectory.q.size)), int(rng.integers(52))
        hashes.add(with_flipped_bit(trajectory, field, element, bit).content_hash())
    assert len(hashes) >= 48  # the original and 50 others, of which very few may coincide by chance


@pytest.mark.parametrize(
    "changes",
    [
        {"gripper": ()},
        {"gripper": (GripperEvent(0.011, 0.02, GripperCommand("grasp", 0.04, 30.0)),)},
        {"gripper": (GripperEvent(0.01, 0.03, GripperCommand("grasp", 0.04, 30.0)),)},
        {"gripper": (GripperEvent(0.01, 0.02, GripperCommand("move", 0.04, 30.0)),)},
        {"gripper": (GripperEvent(0.01, 0.02, GripperCommand("grasp", 0.05, 30.0)),)},
        {"gripper": (GripperEvent(0.01, 0.02, GripperCommand("grasp", 0.04, 31.0)),)},
        {"segments": (TrajectorySegment("reach", 0, 50),)},
        {"joint_names": tuple(f"panda_joint{k}" for k in (2, 1, 3, 4, 5, 6, 7))},
    ],
)
def test_gripper_segments_and_joint_order_are_part_of_the_hash(changes):
    trajectory = some_trajectory()
    assert replace(trajectory, **changes).content_hash() != trajectory.content_hash()


def test_what_is_held_and_what_may_touch_are_part_of_the_hash():
    trajectory = some_trajectory()
    reach, lift = trajectory.segments
    for other in (replace(lift, held=None), replace(lift, touching=())):
        assert replace(trajectory, segments=(reach, other)).content_hash() != trajectory.content_hash()


def test_samples_cannot_be_written_to():
    with pytest.raises(ValueError, match="read-only"):
        some_trajectory().q[0, 0] = 1.0


def test_duration_counts_the_steps_between_samples():
    assert some_trajectory().duration == pytest.approx(0.049)


@pytest.mark.parametrize("field", ["q", "qd", "qdd"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite_are_refused_by_row_and_joint(field, value):
    trajectory = some_trajectory()
    array = np.array(getattr(trajectory, field))
    array[17, 3] = value
    with pytest.raises(TrajectoryError, match=f"field {field} is not finite in row 17, joint 'panda_joint4'"):
        replace(trajectory, **{field: array})


@pytest.mark.parametrize("shape", [(0, 7), (1, 7), (5, 6), (5,), (5, 7, 1)])
def test_wrong_shapes_are_refused_by_field_and_shape(shape):
    with pytest.raises(TrajectoryError, match=r"trajectory field q has shape .*; it needs \(n >= 2, 7\)"):
        Trajectory(np.zeros(shape), np.zeros(shape), np.zeros(shape))


def test_fields_of_different_lengths_are_refused():
    with pytest.raises(TrajectoryError, match=r"trajectory field qd has shape \(4, 7\), q has \(5, 7\)"):
        Trajectory(np.zeros((5, 7)), np.zeros((4, 7)), np.zeros((5, 7)))
