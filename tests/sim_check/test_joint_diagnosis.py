"""Why a joint does not move: the things that hold it are named, and what nothing seen explains is a lock."""

import numpy as np
import pytest

from benchmarks.scenes.estimates import estimate
from benchmarks.scenes.furniture_twins import CABINET, barred, cabinet, furnished, lever, sliding
from benchmarks.scenes.tabletop_twins import arm, only
from control.robot.limits import REST_Q
from control.safety.limits import SafetyLimits
from sim_check.diagnosis.blocking_bodies import diagnose
from sim_check.diagnosis.joints import blame, push_joint

SAFETY = SafetyLimits()


def blamed(twin, name, fraction=1.0):
    joint = twin.joint(name)
    assert joint is not None
    return blame(twin, joint, fraction)


@pytest.mark.parametrize("door", ["cabinet_left_door", "cabinet_right_door"])
@pytest.mark.parametrize("wrong", [0.0, 0.005])
def test_the_bar_behind_the_handles_is_to_blame_and_the_cube_aside_is_not(door, wrong):
    found = blamed(barred(wrong=wrong), door)
    assert found.bodies == ("bar",) and not found.free
    assert next(iter(found.push.resisted)) == "bar" and found.push.resisted["bar"] > 1.0
    assert 0.0 < found.push.progress < 0.5  # a barred door opens a little


@pytest.mark.parametrize(
    "twin, joint",
    [(cabinet, "cabinet_right_door"), (sliding, "cabinet_door"), (lever, "lever_rod")],
)
def test_a_free_joint_goes_all_the_way_and_nothing_is_blamed(twin, joint):
    found = blamed(twin(), joint)
    assert found.free and found.bodies == () and found.push.progress == pytest.approx(1.0, abs=0.05)


def test_a_door_that_pushes_a_light_thing_aside_is_not_free():
    cube = estimate("box", (0.45, 0.20, 0.11), (0.06, 0.06, 0.22))
    twin = furnished("cabinet", CABINET, 0.62, 0.0, 0.0, {}, cube)
    found = blamed(twin, "cabinet_left_door")
    assert found.bodies == ("box",)


def test_the_arm_in_the_way_of_a_pushed_joint_does_not_count():
    twin = cabinet()
    assert np.allclose(twin.q, REST_Q)
    joint = twin.joint("cabinet_left_door")
    assert joint is not None
    push = push_joint(twin, joint, 1.0)
    assert not any(name.startswith("panda") for name in push.resisted)


def test_closing_is_diagnosed_as_well():
    found = blamed(cabinet(left=1.0), "cabinet_left_door", 0.0)
    assert found.free and found.push.progress == pytest.approx(1.0, abs=0.05)


def test_a_barred_door_becomes_a_typed_cause_with_its_evidence():
    spec = only("set_joint_fraction", "cabinet_left_door", value=1.0)
    cause = diagnose(barred(), spec, None, SAFETY, np.random.default_rng(0), arm(), nthread=1)
    assert (cause.kind, cause.subject, cause.bodies) == ("blocked_by", "cabinet_left_door", ("bar",))
    assert cause.message.startswith("'bar' keeps 'cabinet_left_door' from moving: pushed, it gets 1")
    assert cause.evidence["progress_without"]["bar"] > 0.9


def test_a_joint_that_did_not_move_though_nothing_holds_it_in_the_twin_is_locked():
    spec = only("set_joint_fraction", "cabinet_left_door", value=0.6)
    cause = diagnose(cabinet(), spec, None, SAFETY, np.random.default_rng(0), arm(), nthread=1)
    assert (cause.kind, cause.subject, cause.bodies) == ("locked", "cabinet_left_door", ())
    assert "nothing that was seen holds 'cabinet_left_door'" in cause.message
    assert cause.evidence["progress"] > 0.95
