"""A look is a way to where the wrist camera truly has a region in view, free of everything that is known."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.scenes.tabletop_twins import arm, cubes
from control.path_planning.collision_filter import CollisionFilter, Phase
from control.planners.looking import LookPlan, WristCamera, plan_look
from control.robot.limits import panda_limits
from control.safety.limits import SafetyLimits
from control.seen_volume import CLEAR, FILLED, HIDDEN, SeenVolume
from replan.run.first_looks import wrist_camera
from sim_check.cells.loading import load_cell

LOW, SHAPE = np.array([-0.3, -0.9, 0.0]), (65, 90, 65)


@cache
def camera() -> WristCamera:
    found = wrist_camera(load_cell("cubes"))
    assert found is not None
    return found


def volume(*boxes):
    """A box around the arm's reach that was seen to be free, with other states in some boxes (state, low, high)."""
    states = np.full(SHAPE, CLEAR, np.int8)
    for state, low, high in boxes:
        a, b = (np.round((np.array(corner) - LOW) / 0.02).clip(0).astype(int) for corner in (low, high))
        states[a[0] : b[0], a[1] : b[1], a[2] : b[2]] = state
    return SeenVolume(LOW, 0.02, states)


def points_in(low, high):
    axes = [np.linspace(a, b, 5) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)


REGION = points_in((0.4, 0.35, 0.05), (0.5, 0.5, 0.2))


def looks(seen, points=REGION, safety=None, **more) -> list[LookPlan]:
    twin = replace(cubes(), seen=seen)
    rng = np.random.default_rng(0)
    return plan_look(twin, points, camera(), safety or SafetyLimits(), panda_limits(), rng, arm(), **more)


def end_camera(plan: LookPlan) -> np.ndarray:
    """Pose of the camera in the world at the end of a look, shape (4, 4)."""
    q = plan.path.segments[-1].q[-1]
    tcp = CollisionFilter(cubes(), SafetyLimits()).tcp_pose(q)
    hand_T_tcp = np.eye(4)
    hand_T_tcp[2, 3] = cubes().gripper.tcp_distance
    return tcp @ np.linalg.inv(hand_T_tcp) @ camera().hand_T_camera


def test_a_look_ends_where_the_region_is_in_the_picture_and_keeps_its_distance_on_the_way():
    plans = looks(volume())
    assert plans and plans[0].share > 0.9
    for plan in plans:
        (segment,) = plan.path.segments
        np.testing.assert_array_equal(segment.q[0], cubes().q)
        assert CollisionFilter(cubes(), SafetyLimits(), margin=0.0).path_clear(segment.q, Phase.FREE, 0.08)
        local = (REGION - end_camera(plan)[:3, 3]) @ end_camera(plan)[:3, :3]
        column = camera().focal[0] * local[:, 0] / local[:, 2] + camera().centre[0]
        row = camera().focal[1] * local[:, 1] / local[:, 2] + camera().centre[1]
        inside = (column > 0) & (column < camera().size[0]) & (row > 0) & (row < camera().size[1]) & (local[:, 2] > 0)
        assert inside.mean() >= plan.share


def test_what_stands_in_between_keeps_a_region_out_of_view():
    # A box with closed sides and lid around the region: nothing of its inside can be seen from anywhere.
    shut = volume((FILLED, (0.3, 0.25, 0.0), (0.6, 0.6, 0.3)), (HIDDEN, (0.34, 0.29, 0.0), (0.56, 0.56, 0.26)))
    assert looks(shut) == []
    # Without the lid it can be seen into from above.
    lidless = volume((FILLED, (0.3, 0.25, 0.0), (0.6, 0.6, 0.2)), (HIDDEN, (0.34, 0.29, 0.0), (0.56, 0.56, 0.2)))
    plans = looks(lidless)
    assert plans and end_camera(plans[0])[2, 2] < -0.5


def test_a_closer_look_is_nearer_than_one_for_space():
    far, near = looks(volume()), looks(volume(), closer=True)
    middle = REGION.mean(axis=0)
    distance = [float(np.linalg.norm(end_camera(p[0])[:3, 3] - middle)) for p in (far, near)]
    assert distance[1] < distance[0] and near[0].share > 0.5


@pytest.mark.parametrize(("policy", "there"), [("avoid", True), ("refuse", False)])
def test_where_the_cell_refuses_what_nobody_saw_a_look_goes_through_none_of_it_either(policy, there):
    around = volume((HIDDEN, (-0.3, -0.9, 0.0), (1.0, 0.9, 1.3)))
    assert bool(looks(around, safety=SafetyLimits(unseen=policy))) == there


def test_without_a_look_before_there_is_nothing_to_look_for():
    assert looks(None) == [] and looks(volume(), points=np.zeros((0, 3))) == []
