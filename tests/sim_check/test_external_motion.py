"""What gripper events of somebody else's motion mean once it is said what is handled."""

import numpy as np
import pytest

from control.errors import ConfigError
from control.robot.limits import REST_Q
from control.trajectory.samples import GripperCommand, GripperEvent, Trajectory
from sim_check.twin.external_motion import with_handling


def resting(events: tuple[tuple[float, float], ...], seconds: float = 4.0) -> Trajectory:
    """An arm at rest whose gripper is told widths at times: (time in [s], width in [m])."""
    q = np.tile(np.array(REST_Q), (round(seconds * 1000) + 1, 1))
    told = tuple(GripperEvent(t, 0.5, GripperCommand("grasp" if w < 0.06 else "move", w)) for t, w in events)
    return Trajectory(q, 0 * q, 0 * q, told)


def spans(trajectory: Trajectory) -> list[tuple[str, int, int, str | None]]:
    return [(s.name, s.start, s.stop, s.held) for s in trajectory.segments]


def test_what_the_gripper_closes_around_is_held_until_it_opens():
    out = with_handling(resting(((1.0, 0.05), (3.0, 0.08))), ("red_cube",), None)
    assert spans(out) == [
        ("reach", 0, 1000, None),
        ("grasp", 1000, 1500, None),
        ("carry", 1500, 3000, "red_cube"),
        ("leave", 3000, 4001, None),
    ]


def test_what_is_held_from_the_start_is_held_until_the_first_opening():
    out = with_handling(resting(((2.0, 0.08),)), (), "red_cube")
    assert spans(out) == [("carry", 0, 2000, "red_cube"), ("leave", 2000, 4001, None)]


def test_several_objects_are_grasped_in_the_order_of_their_names():
    events = ((0.5, 0.05), (1.5, 0.08), (2.0, 0.05), (3.0, 0.08))
    out = with_handling(resting(events), ("red_cube", "yellow_cube"), None)
    assert [s.held for s in out.segments if s.held] == ["red_cube", "yellow_cube"]
    twice = with_handling(resting(events), ("red_cube",), None)
    assert [s.held for s in twice.segments if s.held] == ["red_cube", "red_cube"]


def test_without_a_name_nothing_is_added():
    motion = resting(((1.0, 0.05),))
    assert with_handling(motion, (), None) is motion


def test_a_name_that_is_never_grasped_is_told():
    with pytest.raises(ConfigError, match=r"never closes around 'yellow_cube': it grasps 1 times .* under --touches"):
        with_handling(resting(((1.0, 0.05), (3.0, 0.08))), ("red_cube", "yellow_cube"), None)
    with pytest.raises(ConfigError, match=r"never closes around 'red_cube'"):
        with_handling(resting(((1.0, 0.08),)), ("red_cube",), None)


def test_samples_and_their_derivatives_stay_as_they_are():
    motion = resting(((1.0, 0.05), (3.0, 0.08)))
    out = with_handling(motion, ("red_cube",), None)
    np.testing.assert_array_equal(out.q, motion.q)
    assert out.gripper == motion.gripper
