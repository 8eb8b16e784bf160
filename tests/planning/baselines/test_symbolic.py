"""From a perceived scene to symbols: facts, what was told, symbolic goals, shortest plans, and the PDDL text."""

import pytest

from control.errors import ConfigError
from planning.baselines.domain import distances, sentence, spec_of, symbolic_problem
from planning.baselines.pddl_text import write_pddl
from planning.baselines.strips import shortest_plan, useful
from planning.baselines.symbolic_goals import UnplannableError, read_symbolic_goals
from planning.baselines.told import Told, read_told
from sim_check.cells.loading import load_cell
from sim_check.twin.fixed_poses import fixed_scene
from tests.support.models.furnished_world import FurnishedWorld, piece

FURNITURE = {
    "cupboard": piece("cupboard", "door", "left_door", "right_door"),
    "lever": piece("lever", "lever", "rod"),
    "scale": piece("scale", "plate", "plate"),
}
NAMES = ("crate", "red_cube", "yellow_cube", *FURNITURE)


def world(**more) -> FurnishedWorld:
    places = {"crate": "table", "red_cube": "table", "yellow_cube": "crate"}
    return FurnishedWorld({**places, **more.pop("places", {})}, frozenset({"crate"}), furniture=FURNITURE, **more)


def facts_of(of: FurnishedWorld):
    return symbolic_problem(of.look(NAMES), FURNITURE, Told()).initial


def plan_for(goal: str, of: FurnishedWorld, *told: str) -> list[str] | None:
    scene = of.look(NAMES)
    goals = read_symbolic_goals(goal, scene, FURNITURE, read_told(told, FURNITURE, NAMES))
    problem = symbolic_problem(scene, FURNITURE, goals.told, goals.facts)
    plan = shortest_plan(useful(problem.actions(), goals.facts), problem.initial, goals.facts)
    return None if plan is None else [sentence(a) for a in plan]


def test_facts_say_what_stands_on_what_and_what_is_closed():
    facts = facts_of(world(fractions={"cupboard_left_door": 0.96}))
    assert {("rests-on", "yellow_cube", "crate"), ("rests-on", "red_cube", "the-table")} <= facts
    assert ("is-empty", "crate") not in facts and ("is-empty", "yellow_cube") in facts
    assert {("is-open", "cupboard_left_door"), ("is-closed", "cupboard_right_door")} <= facts
    assert {("is-closed", "lever_rod"), ("can-move", "lever_rod"), ("is-empty", "scale")} <= facts
    assert ("is-away", "red_cube", "crate") in facts and ("is-away", "yellow_cube", "crate") not in facts


def test_what_is_seen_in_front_of_closed_doors_is_not_in_the_furniture():
    inside = {"yellow_cube": "cupboard"}
    both = dict.fromkeys(("cupboard_left_door", "cupboard_right_door"), 1.0)
    assert ("rests-on", "yellow_cube", "cupboard") in facts_of(world(places=inside, fractions=both))
    seen = world(places=inside, fractions=both).look(NAMES)
    shut = world(places=inside).look(("cupboard",)).objects
    closed = type(seen)((*(o for o in seen.objects if o.name != "cupboard"), *shut), (), 0.0, 0.0, "test")
    facts = symbolic_problem(closed, FURNITURE, Told()).initial
    assert ("rests-on", "yellow_cube", "the-table") in facts


def test_the_wrong_cube_goes_first():
    assert plan_for("place the red cube on the crate", world()) == [
        "move yellow_cube away from crate",
        "place red_cube on crate",
    ]


def test_doors_that_are_seen_closed_are_opened_first():
    steps = plan_for("put the red cube in the cupboard", world())
    assert steps is not None and set(steps[:2]) == {"open cupboard_left_door", "open cupboard_right_door"}
    assert steps[2:] == ["place red_cube in cupboard"]


def test_a_told_lock_puts_the_lever_first_and_an_untold_one_does_not():
    goal = "put the red cube in the cupboard"
    told = plan_for(goal, world(), "cupboard_left_door is locked until lever_rod is open")
    assert told is not None and len(told) == 4
    assert told.index("pull lever_rod") < told.index("open cupboard_left_door")
    untold = plan_for(goal, world())
    assert untold is not None and "pull lever_rod" not in untold


def test_a_weight_is_put_on_a_plate_that_was_told_to_be_a_key():
    steps = plan_for(
        "put the red cube in the cupboard", world(), "cupboard_left_door is locked until scale_plate is open"
    )
    assert steps is not None and len(steps) == 4
    assert any(s.endswith("on scale") for s in steps[: steps.index("open cupboard_left_door")])


def test_what_was_told_to_be_in_the_way_is_moved_first():
    near = world(places={"yellow_cube": "table"}, beside={"yellow_cube": "cupboard"})
    steps = plan_for("put the red cube in the cupboard", near, "cupboard_left_door is blocked by yellow_cube")
    assert steps is not None
    assert steps.index("move yellow_cube away from cupboard") < steps.index("open cupboard_left_door")


@pytest.mark.parametrize(
    ("told", "message"),
    [
        ("the cupboard is locked", "cannot understand this; say \"JOINT is locked until JOINT is open\""),
        ("cupboard_door is locked until lever_rod is open", "there is no joint 'cupboard_door'; there are cup"),
        ("lever_rod is blocked by kettle", "there is no object 'kettle'; there are crate, red_cube, yellow_cube"),
        ("lever_rod is locked until lever_rod is open", "a joint cannot be its own key"),
    ],
)  # fmt: skip
def test_told_facts_that_cannot_be_read_say_what_would_be_valid(told, message):
    with pytest.raises(ConfigError, match=f"told '{told}': {message}"):
        read_told((told,), FURNITURE, NAMES)


def test_doors_and_levers_are_goals_by_furniture_or_by_joint():
    scene = world(fractions={"cupboard_left_door": 1.0}).look(NAMES)
    both = read_symbolic_goals("open the cupboard", scene, FURNITURE)
    assert both.facts == {("is-open", "cupboard_left_door"), ("is-open", "cupboard_right_door")}
    assert [(t.kind, t.value) for w in both.all for t in w.terms] == [("set_joint_fraction", 1.0)] * 2
    one = read_symbolic_goals("close the left door of the cupboard", scene, FURNITURE)
    assert one.facts == {("is-closed", "cupboard_left_door")}
    rod = read_symbolic_goals("pull the lever", scene, FURNITURE)
    assert rod.facts == {("is-open", "lever_rod")}


def test_what_a_goal_tells_of_a_lock_counts_as_told():
    weight = "open the cupboard; the cupboard opens when the red cube is put on the scale"
    steps = plan_for(weight, world())
    assert steps is not None and len(steps) == 3 and steps[0].endswith("on scale")
    assert plan_for("open the cupboard; the cupboard opens when the lever is pulled", world())[0] == "pull lever_rod"  # type: ignore[index]
    with pytest.raises(UnplannableError, match="'place red_cube on crate' moves no joint that is known"):
        plan_for("open the cupboard; the cupboard opens when the red cube is put on the crate", world())


def test_clearing_a_thing_is_moving_away_what_rests_on_it():
    assert plan_for("clear the crate", world()) == ["move yellow_cube away from crate"]


@pytest.mark.parametrize(
    ("goal", "message"),
    [
        ("find the apple", "apple is not in view; in view: crate, red cube, yellow cube, cupboard, lever, scale"),
        ("place the red cube on the lever", "nothing can be put on lever"),
        ("place the cupboard on the crate", "cupboard is furniture and stays where it is"),
        ("pick up the cube", "'cube' may mean red_cube or yellow_cube; say which one"),
    ],
)
def test_goals_without_symbols_say_why(goal, message):
    with pytest.raises(UnplannableError, match=message):
        read_symbolic_goals(goal, world().look(NAMES), FURNITURE)


def test_of_two_goals_about_one_thing_the_later_one_lasts():
    goal = "put the red cube on the crate; then take the red cube off the crate; then put the yellow cube on the crate"
    goals = read_symbolic_goals(goal, world().look(NAMES), FURNITURE)
    assert [w.text for w in goals.lasting] == ["move red_cube away from crate", "place yellow_cube on crate"]


def test_a_lift_is_the_last_thing_that_a_plan_does():
    steps = plan_for("pick up the red cube, then move the yellow cube away from the crate", world())
    assert steps == ["move yellow_cube away from crate", "pick up red_cube"]


def test_two_things_cannot_be_held_up_at_once():
    assert plan_for("pick up the red cube, then pick up the yellow cube", world()) is None


def test_things_are_put_further_away_from_furniture_than_from_each_other():
    scene = world().look(NAMES)
    away = distances(scene, FURNITURE)
    spec = spec_of(("away", "red_cube", "cupboard"), away)
    assert spec is not None and spec.primary.value == pytest.approx(0.2 + 0.25)
    assert away.of["crate"] == 0.2


def test_the_text_has_the_scene_and_what_was_told():
    told = read_told(("cupboard_left_door is locked until lever_rod is open",), FURNITURE, NAMES)
    scene = world().look(NAMES)
    goal = read_symbolic_goals("put the red cube in the cupboard", scene, FURNITURE).facts
    text = write_pddl(symbolic_problem(scene, FURNITURE, told, goal), "scene")
    assert "(:requirements :strips :typing)" in text.domain
    assert "(rests-on yellow_cube crate)" in text.problem and "(is-closed cupboard_left_door)" in text.problem
    assert "(can-move cupboard_right_door)" in text.problem and "(can-move cupboard_left_door)" not in text.problem
    assert "(rests-on red_cube cupboard)" in text.problem.split("(:goal")[1]
    action = text.domain.split("(:action open-cupboard_left_door")[1].split("(:action")[0]
    assert "(is-open lever_rod)" in action.split(":effect")[0]
    assert "open-cupboard_right_door" not in text.domain


def test_a_name_that_pddl_has_no_room_for_can_be_found_again():
    odd = FurnishedWorld({"2nd_cube": "table", "crate": "table"}, frozenset({"crate"}))
    scene = odd.look(("2nd_cube", "crate"))
    text = write_pddl(symbolic_problem(scene, {}, Told()), "scene")
    written = next(n for n, own in text.originals.items() if own == "2nd_cube")
    assert written != "2nd_cube" and f"(rests-on {written} the-table)" in text.problem


@pytest.mark.parametrize(
    ("cell", "goal", "steps"),
    [
        ("cabinet-blocked", "place the yellow cube in the wooden cabinet", 3),
        ("cabinet-open", "place the yellow cube in the wooden cabinet", 1),
        ("cubes-blocked", "place the red cube on the crate", 2),
    ],
)
def test_scenes_that_come_with_the_program_have_plans(cell, goal, steps):
    from planning.language.furnishings import known_furniture

    config = load_cell(cell, {})
    furniture = known_furniture(config.furniture)
    scene = fixed_scene(config.poses, config.furniture, 0.0, 0.0)
    wanted = read_symbolic_goals(goal, scene, furniture).facts
    problem = symbolic_problem(scene, furniture, Told(), wanted)
    plan = shortest_plan(useful(problem.actions(), wanted), problem.initial, wanted)
    assert plan is not None and len(plan) == steps
