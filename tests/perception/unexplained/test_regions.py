"""Distances to solids are those of their surfaces, whatever way they stand."""

import numpy as np
import pytest

from perception.unexplained.regions import EMPTY, PlacedSolid, SolidsRegion, least_distance

HALF = {
    "box": (0.1, 0.05, 0.2),
    "cylinder": (0.06, 0.06, 0.1),
    "capsule": (0.05, 0.05, 0.1),
    "sphere": (0.07, 0.07, 0.07),
    "ellipsoid": (0.07, 0.07, 0.07),
}


def surface(kind, half, rng, count=60_000):
    """Points all over a solid's surface in its own frame, shape (n, 3)."""
    directions = rng.standard_normal((count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    if kind in ("sphere", "ellipsoid"):
        return directions * half
    if kind == "capsule":
        along = rng.uniform(-half[2], half[2], count)
        sides = directions[:, :2] / np.linalg.norm(directions[:, :2], axis=1, keepdims=True)
        caps = directions * half[0] + np.stack(
            [np.zeros(count), np.zeros(count), np.sign(directions[:, 2]) * half[2]], 1
        )
        return np.concatenate([np.column_stack([sides * half[0], along]), caps])
    flat = rng.uniform(-1.0, 1.0, (count, 3))
    if kind == "cylinder":
        turn, radius = rng.uniform(0, 2 * np.pi, count), np.sqrt(rng.uniform(0, 1, count))
        round_ = np.column_stack([np.cos(turn), np.sin(turn), flat[:, 2]])
        ends = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), np.sign(flat[:, 2])])
        return np.concatenate([round_, ends]) * half
    axis = rng.integers(0, 3, count)
    flat[np.arange(count), axis] = np.sign(flat[np.arange(count), axis])
    return flat * half


@pytest.mark.parametrize("kind", sorted(HALF))
def test_a_point_is_as_far_from_a_solid_as_from_the_nearest_point_of_its_surface(kind):
    rng = np.random.default_rng(3)
    half = np.array(HALF[kind])
    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn * np.sign(np.linalg.det(turn)), (0.4, -0.2, 0.3)
    solid = PlacedSolid(kind, half, pose)
    on_it = surface(kind, half, rng) @ pose[:3, :3].T + pose[:3, 3]
    assert np.abs(solid.distance(on_it)).max() < 1e-5
    around = pose[:3, 3] + rng.uniform(-0.4, 0.4, (40, 3))
    nearest = np.array([np.linalg.norm(on_it - point, axis=1).min() for point in around])
    # 60,000 points leave gaps of a few millimetres between them.
    assert np.abs(np.abs(solid.distance(around)) - nearest).max() < 0.004
    assert solid.distance(pose[:3, 3][None])[0] < -0.04


def test_a_region_is_as_near_as_its_nearest_solid_and_nothing_is_infinitely_far():
    far = np.eye(4)
    far[0, 3] = 1.0
    ball = np.full(3, 0.1)
    region = SolidsRegion((PlacedSolid("sphere", ball, np.eye(4)), PlacedSolid("sphere", ball, far)))
    points = np.array([[0.3, 0.0, 0.0], [0.8, 0.0, 0.0], [0.0, 0.0, 0.0]])
    assert region.distance(points) == pytest.approx([0.2, 0.1, -0.1], abs=1e-6)
    assert least_distance((), points).tolist() == [EMPTY] * 3
