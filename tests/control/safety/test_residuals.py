"""Each safety residual is caught by the row of the table that is about it, and by no other."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.scenes.tabletop_twins import cubes
from control.robot.gripper import PANDA_HAND
from control.safety.limits import SafetyLimits
from control.safety.residuals import Clearances, Contacts, HeldSpan, TwinMotion, safety_residuals
from control.safety.zones import RobotPoints, RobotTrack

SAFETY = SafetyLimits()
N, DT = 500, 0.004
TIME = np.arange(N) * DT


def still(position):
    poses = np.tile(np.eye(4), (N, 1, 1))
    poses[:, :3, 3] = position
    return poses


def touching(*rows):
    """Contacts (sample, body, body, force in N)."""
    pairs = [(r[1], r[2]) for r in rows]
    known = tuple(dict.fromkeys(pairs))
    pair = np.array([known.index(p) for p in pairs], int)
    return Contacts(np.array([r[0] for r in rows], int), known, pair, np.array([r[3] for r in rows], float))


def quiet() -> TwinMotion:
    """A motion that breaks nothing: fingers hold the cube, the cube rubs the crate, the arm moves slowly."""
    tcp = still((0.4, 0.0, 0.3))
    tcp[:, 0, 3] += 0.1 * TIME
    return TwinMotion(
        time=TIME,
        tcp=tcp,
        objects={
            "red_cube": still((0.5, 0.1, 0.085)),
            "crate": still((0.5, 0.1, 0.03)),
            "vase": still((0.6, -0.3, 0.1)),
        },
        contacts=touching(
            (100, "panda_leftfinger", "red_cube", 40.0),
            (200, "red_cube", "crate", 30.0),
            (300, "table", "red_cube", 5.0),
        ),
        named=frozenset({"red_cube", "crate"}),
        subject="red_cube",
        supports=frozenset({"table", "crate"}),
        expects_release=True,
    )


def broken(motion):
    return {r.name: r.check(motion) for r in safety_residuals(SAFETY) if not r.check(motion).ok}


def with_contact(*row):
    return replace(quiet(), contacts=touching(row))


def fast():
    tcp = still((0.3, 0.0, 0.3))
    tcp[:, 0, 3] += 0.3 * np.clip((TIME - 1.0) / 0.4, 0, 1)  # 0.75 m/s
    return replace(quiet(), tcp=tcp)


def spinning():
    angle = 0.6 * np.clip((TIME - 1.0) / 0.2, 0, 1)  # 3 rad/s
    tcp = quiet().tcp.copy()
    tcp[:, 0, 0], tcp[:, 0, 1], tcp[:, 1, 0], tcp[:, 1, 1] = np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)
    return replace(quiet(), tcp=tcp)


def robot_at(body, position, radius=0.05):
    """The quiet motion with one more point of the robot, which goes to a position half-way."""
    points = np.stack([np.tile([0.4, 0.0, 0.5], (N, 1)), quiet().tcp[:, :3, 3]], axis=1)
    points[N // 2 :, 0] = position
    return replace(quiet(), robot=RobotTrack((body, "panda_hand"), np.array([radius, 0.0]), points))


def outside():
    return replace(quiet(), tcp=still((0.5, 0.95, 0.3)))


def displaced():
    poses = still((0.6, -0.3, 0.1))
    poses[:, 1, 3] -= 0.03 * np.clip(TIME / 1.0, 0, 1)
    return replace(quiet(), objects={**quiet().objects, "vase": poses})


def toppled():
    poses, angle = still((0.6, -0.3, 0.1)), np.clip(TIME, 0, 1) * 0.5
    poses[:, 0, 0], poses[:, 0, 2], poses[:, 2, 0], poses[:, 2, 2] = (
        np.cos(angle),
        np.sin(angle),
        -np.sin(angle),
        np.cos(angle),
    )
    return replace(quiet(), objects={**quiet().objects, "vase": poses})


def slipped():
    poses = still((0.4, 0.0, 0.3))
    poses[:, 0, 3] += 0.1 * TIME  # with the hand ...
    poses[:300, 2, 3] -= 0.05 * np.clip(TIME[:300] - 0.4, 0, 1)  # ... but sinking out of it
    poses[300:] = poses[299]
    return replace(quiet(), objects={**quiet().objects, "red_cube": poses}, held=(HeldSpan("red_cube", 50, 300),))


def lacking(part):
    near = {name: np.full(2, -0.01) for name in ("self", "arm", "finger", "held")}
    near[part] = np.array([-0.01, 0.004])
    names: dict[str, tuple[str, ...]] = dict.fromkeys(near, ("vase", "vase"))
    clearances = Clearances(
        np.array([100, 200]), near, names, {name: 0.004 - lack for name, lack in near.items()}, names
    )
    return replace(quiet(), clearances=clearances, held=(HeldSpan("crate", 150, 151),))


def gripping_at_the_end():
    return with_contact(N - 5, "panda_leftfinger", "red_cube", 20.0)


def rolling():
    poses = still((0.5, 0.1, 0.085))
    poses[:, 0, 3] += 0.02 * np.clip(TIME - 1.6, 0, 1)
    return replace(quiet(), objects={**quiet().objects, "red_cube": poses})


def swung_shut():
    points = np.tile([0.5, 0.2, 0.4], (N, 1))
    points[:, 0] += 0.05 * np.clip(TIME, 0, 1)
    return replace(quiet(), handles={"box_door": points})


ZONE = ((0.1, 0.3, 0.4), (0.3, 0.5, 0.8))
SAFETY = replace(SAFETY, keep_out=(ZONE,))
CASES = {
    "tracked_hand_speed": (fast(), 0.75, ("panda_hand",)),
    "tracked_hand_angular_speed": (spinning(), 3.0, ("panda_hand",)),
    "pressing_force": (with_contact(200, "red_cube", "crate", 60.0), 60.0, ("red_cube", "crate")),
    "unwanted_contact": (with_contact(40, "panda_leftfinger", "vase", 5.0), 5.0, ("panda_leftfinger", "vase")),
    "keep_out": (robot_at("panda_link4", (0.28, 0.40, 0.6)), 0.07, ("panda_link4",)),
    "self_clearance": (lacking("self"), 0.004, ("vase",)),
    "self_contact": (with_contact(10, "panda_link5", "panda_hand", 3.0), 3.0, ("panda_link5", "panda_hand")),
    "workspace": (outside(), 0.15, ("panda_hand",)),
    "moved": (displaced(), 0.03, ("vase",)),
    "joint_moved": (swung_shut(), 0.05, ("box_door",)),
    "tipped": (toppled(), 0.5, ("vase",)),
    "held_kept": (slipped(), 0.0399, ("red_cube",)),
    "arm_clearance": (lacking("arm"), 0.004, ("panda_hand", "vase")),
    "finger_clearance": (lacking("finger"), 0.004, ("panda_hand", "vase")),
    "held_clearance": (lacking("held"), 0.004, ("red_cube", "vase")),
    "released": (gripping_at_the_end(), 20.0, ("panda_leftfinger", "red_cube")),
    "settled": (rolling(), 0.02, ("red_cube",)),
}


def test_a_quiet_motion_breaks_nothing_and_costs_nothing():
    assert broken(quiet()) == {}
    assert sum(r.cost(quiet()) for r in safety_residuals(SAFETY)) == 0.0


@pytest.mark.parametrize("name", CASES)
def test_a_motion_that_breaks_one_rule_is_caught_by_that_rule_alone(name):
    motion, worst, bodies = CASES[name]
    caught = broken(motion)
    assert set(caught) == {name}
    assert caught[name].worst == pytest.approx(worst, rel=0.05) and caught[name].bodies == bodies
    assert sum(r.cost(motion) for r in safety_residuals(SAFETY)) > 0.0


def test_a_joint_that_the_subtask_names_may_move():
    motion = swung_shut()
    assert broken(replace(motion, named=motion.named | {"box_door"})) == {}


def test_an_arm_that_leans_on_something_breaks_both_rules_about_contacts():
    caught = broken(with_contact(40, "panda_link4", "vase", 50.0))
    assert set(caught) == {"contact_force", "unwanted_contact"}
    assert caught["contact_force"].worst == 50.0 and caught["contact_force"].at == pytest.approx(40 * DT)


@pytest.mark.parametrize("pair", [("panda_leftfinger", "vase"), ("red_cube", "vase"), ("table", "panda_hand")])
def test_a_touch_outside_fingers_object_and_supports_is_unwanted_though_gentle(pair):
    assert set(broken(with_contact(40, *pair, 5.0))) == {"unwanted_contact"}


def test_what_may_be_handled_beside_the_subject_may_be_touched_and_nothing_else():
    motion = with_contact(40, "panda_leftfinger", "vase", 5.0)
    assert broken(replace(motion, handled=frozenset({"vase"}))) == {}
    assert set(broken(replace(motion, handled=frozenset({"crate"})))) == {"unwanted_contact"}


def test_a_grip_is_no_pressing_and_fingers_pushed_into_the_table_are():
    assert broken(with_contact(40, "panda_leftfinger", "red_cube", 80.0)) == {}
    door = replace(with_contact(40, "panda_leftfinger", "door", 80.0), supports=frozenset({"table", "door"}))
    assert set(broken(door)) == {"pressing_force"}
    assert broken(replace(door, grasped=frozenset({"door"}))) == {}
    assert set(broken(with_contact(40, "table", "panda_leftfinger", 80.0))) == {"pressing_force"}


def test_forces_of_one_pair_at_one_time_add_up():
    parts = touching((40, "panda_link4", "vase", 9.0), (40, "panda_link4", "vase", 9.0))
    assert broken(replace(quiet(), contacts=parts))["contact_force"].worst == 18.0


def test_an_elbow_beside_a_keep_out_zone_is_free_and_one_that_touches_it_is_caught():
    assert broken(robot_at("panda_link4", (0.36, 0.40, 0.6))) == {}
    caught = broken(robot_at("panda_link4", (0.34, 0.40, 0.6)))
    assert set(caught) == {"keep_out"} and caught["keep_out"].worst == pytest.approx(0.01)


def test_the_whole_hand_stays_in_the_workspace_and_the_elbow_need_not():
    caught = broken(robot_at("panda_hand", (0.86, 0.0, 0.5)))
    assert set(caught) == {"workspace"} and caught["workspace"].worst == pytest.approx(0.01)
    assert caught["workspace"].at == pytest.approx(N // 2 * DT)
    assert broken(robot_at("panda_link4", (0.95, 0.0, 0.5))) == {}


def test_points_of_the_robot_lie_on_its_parts():
    data = cubes().start()
    points = RobotPoints(cubes().model)
    at = dict(zip(points.bodies, points.at(data), strict=True))  # one point of each body
    assert {"panda_link1", "panda_link4", "panda_hand", "panda_leftfinger"} <= set(at)
    for body, point in at.items():
        assert np.linalg.norm(point - data.body(body).xpos) < 0.35, body
    fingers = points.at(data)[[b.endswith("finger") for b in points.bodies]]
    tcp = data.site("tcp").xpos
    assert tcp[2] - fingers[:, 2].min() == pytest.approx(
        PANDA_HAND.fingertip, abs=0.001
    )  # the hand points down at rest
