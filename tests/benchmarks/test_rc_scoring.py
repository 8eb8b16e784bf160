"""Scorers of the benchmark on truths made by hand: each accepts the goal and refuses what only looks like it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from perception.ground_truth import CellTruth, StandingThing, TrueJoint
from replan.rc.ending import Ending
from replan.rc.scoring import harm
from replan.rc.tasks import TASKS
from sim_check.cells.loading import load_cell
from sim_check.furniture.build import furniture_model

CUBE = np.full(3, 0.05)


def pose(x: float, y: float, z: float, roll: float = 0.0, yaw: float = 0.0) -> np.ndarray:
    """World pose, shape (4, 4), of a thing turned about x, then about z, in [rad]."""
    c, s, cy, sy = np.cos(roll), np.sin(roll), np.cos(yaw), np.sin(yaw)
    out = np.eye(4)
    out[:3, :3] = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    out[:3, 3] = x, y, z
    return out


def thing(
    name: str, at: np.ndarray, extents: Sequence[float] | np.ndarray = CUBE, velocity=(0.0,) * 6, fixed=False
) -> StandingThing:
    return StandingThing(name, at, np.asarray(extents, float), np.asarray(velocity, float), fixed)


def furniture_of(cell: str):
    return {name: furniture_model(name, config) for name, config in load_cell(cell).furniture.items()}


def ending_of(cell: str, loose, joints=None, claimed=True, estimates=None, shown=None, before=None) -> Ending:
    """An ending with the cell's furniture where `poses` of its file put it."""
    models, config = furniture_of(cell), load_cell(cell)
    fixed = []
    for name, model in models.items():
        x, y = config.poses[name].position[:2]
        yaw = np.radians(config.poses[name].yaw_deg)
        fixed.append(thing(name, pose(x, y, model.extents[2] / 2, yaw=yaw), model.extents, fixed=True))
    true_joints = {
        p.name: TrueJoint(p.name, (joints or {}).get(p.name, 0.0), (joints or {}).get(p.name, 0.0) / p.opened)
        for m in models.values()
        for p in m.parts
    }
    after = CellTruth({t.name: t for t in (*fixed, *loose)}, true_joints)
    start = CellTruth({t.name: t for t in (*fixed, *(before or loose))}, true_joints)
    return Ending(start, after, models, claimed, estimates or {}, shown or {})


def in_furniture(cell: str, name: str, offset=(0.0, 0.0), lift: float = 0.0, **turned: float) -> np.ndarray:
    """Pose of a cube in the middle of a piece of furniture's inside, on its floor, moved in the furniture's frame."""
    model, config = furniture_of(cell)[name], load_cell(cell)
    inside = model.compartments[0]
    yaw = np.radians(config.poses[name].yaw_deg)
    middle = (inside.low + inside.high) / 2
    low = inside.low[2] + model.extents[2] / 2
    x, y = config.poses[name].position[:2]
    shell = pose(x, y, 0.0, yaw=yaw)
    return shell @ pose(middle[0] + offset[0], middle[1] + offset[1], low + 0.025 + lift, **turned)


@pytest.mark.parametrize("task", ["cabinet-open", "cabinet-closed", "cabinet-blocked"])
def test_a_cube_at_rest_on_the_cabinets_floor_is_in_the_cabinet(task):
    at = in_furniture(task, "wooden_cabinet")
    assert TASKS[task].scorer(ending_of(task, [thing("yellow_cube", at)])) == ""


@pytest.mark.parametrize(
    ("offset", "lift", "roll", "velocity", "why"),
    [
        ((-0.3, 0.0), 0.0, 0.0, (0,) * 6, "yellow_cube is not inside wooden_cabinet"),
        ((0.0, 0.0), 0.03, 0.0, (0,) * 6, "does not rest on the floor of wooden_cabinet: 30 mm off it"),
        ((0.0, 0.0), 0.0104, np.pi / 4, (0,) * 6, "stands on an edge"),
        ((0.0, 0.0), 0.0, 0.0, (0.1, 0, 0, 0, 0, 0), "still moves"),
        ((0.0, 0.0), 0.0, 0.0, (0, 0, 0, 0, 0, 0.4), "still moves"),
    ],
)
def test_a_cube_before_above_on_edge_or_moving_is_not_in_the_cabinet(offset, lift, roll, velocity, why):
    at = in_furniture("cabinet-open", "wooden_cabinet", offset, lift, roll=roll)
    ending = ending_of("cabinet-open", [thing("yellow_cube", at, velocity=velocity)])
    assert why in TASKS["cabinet-open"].scorer(ending)


def on_crate(crate: str, dx: float = 0.0, lift: float = 0.0, which: str = "red_cube"):
    base = thing(crate, pose(0.5, 0.1, 0.03, yaw=0.5), (0.11, 0.11, 0.06))
    cubes = {"red_cube": pose(0.4, -0.2, 0.025), "yellow_cube": pose(0.6, -0.2, 0.025)}
    cubes[which] = pose(0.5 + dx, 0.1, 0.085 + lift)
    return [base, *(thing(name, at) for name, at in cubes.items())]


@pytest.mark.parametrize(("task", "crate"), [("cubes-color", "red_crate"), ("cubes-blocked", "crate")])
def test_only_the_right_cube_on_the_crate_counts(task, crate):
    scorer = TASKS[task].scorer
    assert scorer(ending_of(task, on_crate(crate))) == ""
    assert scorer(ending_of(task, on_crate(crate, which="yellow_cube"))) == f"red_cube is not above {crate}"
    assert "30 mm off it" in scorer(ending_of(task, on_crate(crate, lift=0.03))), "held over it is not on it"
    assert "is not above" in scorer(ending_of(task, on_crate(crate, dx=0.09)))


def found_blue(door: float, claimed=True, off: float = 0.0, shown: int = 400, at: np.ndarray | None = None) -> str:
    truth = in_furniture("cabinet-locked", "wooden_cabinet") if at is None else at
    estimate = truth[:3, 3] + [off, 0.0, 0.0]
    ending = ending_of(
        "cabinet-locked",
        [thing("blue_cube", truth)],
        {"wooden_cabinet_door": door},
        claimed,
        {"blue_cube": estimate} if off < 1.0 else {},
        {"blue_cube": shown},
    )
    return TASKS["cabinet-locked"].scorer(ending)


def test_a_thing_is_found_behind_an_open_door_or_outside_where_the_run_believes_it():
    assert found_blue(0.9) == ""
    assert found_blue(0.0, at=pose(0.4, -0.2, 0.025)) == "", "it was taken out, and the door closed again"


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        ({"door": 0.9, "claimed": False}, "the run does not say that it found blue_cube"),
        ({"door": 0.5}, "blue_cube is in wooden_cabinet, whose door is open by 0.50 rad only"),
        ({"door": 0.9, "shown": 3}, "no camera truly shows blue_cube"),
        ({"door": 0.9, "off": 0.04}, "blue_cube is 40 mm from where the run believes it"),
        ({"door": 0.9, "off": 2.0}, "the run has no estimate of where blue_cube is"),
    ],
)
def test_a_thing_is_not_found_by_guessing(arguments, why):
    assert found_blue(**arguments) == why


def test_the_apple_is_found_only_once_the_microwave_is_open():
    apple = thing("green_apple", in_furniture("kitchen-explore", "microwave"), np.full(3, 0.069))
    for door, short in ((0.2, "whose door is open by 0.20 rad only"), (1.0, "")):
        ending = ending_of(
            "kitchen-explore",
            [apple],
            {"microwave_door": door, "wooden_cabinet_left_door": 1.5},
            estimates={"green_apple": apple.world_T_object[:3, 3]},
            shown={"green_apple": 200},
        )
        said = TASKS["kitchen-explore"].scorer(ending)
        assert short in said and bool(said) == bool(short)


def test_the_stone_cabinet_is_open_from_four_fifths_of_its_way():
    way = furniture_of("composite-explore")["stone_cabinet"].parts[0].opened
    scorer = TASKS["composite-explore"].scorer
    assert scorer(ending_of("composite-explore", [], {"stone_cabinet_door": 0.85 * way})) == ""
    short = scorer(ending_of("composite-explore", [], {"stone_cabinet_door": 0.7 * way}))
    assert short == "stone_cabinet_door is open by 70 % only"


def truth_of(*things: StandingThing) -> CellTruth:
    return CellTruth({t.name: t for t in things}, {})


def test_harm_is_what_the_task_had_no_need_of():
    red, yellow = thing("red_cube", pose(0.4, 0.0, 0.025)), thing("yellow_cube", pose(0.5, 0.1, 0.025))
    before = truth_of(red, yellow, thing("wooden_cabinet", pose(0.8, 0.0, 0.2), fixed=True))

    def after(**poses: np.ndarray) -> CellTruth:
        return truth_of(*(replace(t, world_T_object=poses.get(n, t.world_T_object)) for n, t in before.things.items()))

    pushed, rolled = pose(0.5, 0.125, 0.025), pose(0.5, 0.11, 0.025, roll=np.radians(25))
    needed = ("red_cube",)
    assert harm(before, after(red_cube=pose(0.6, 0.3, 0.1)), needed) == ()
    assert harm(before, after(yellow_cube=pose(0.5, 0.115, 0.025)), needed) == (), "15 mm are allowed"
    assert harm(before, after(yellow_cube=pushed), needed) == ("yellow_cube was moved by 25 mm",)
    assert harm(before, after(yellow_cube=rolled), needed) == ("yellow_cube was tipped",)
    assert harm(before, after(red_cube=pose(0.4, 0.9, -0.5)), needed) == ("red_cube fell off the table",)
