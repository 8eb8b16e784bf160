"""The loop with the rule-based planner among doors, levers and plates, in symbolic worlds that are named at random.

Every task is run under several namings: things, colours and furniture are called anew, distractors stand around, and
the order of things changes with the names. What works must not hang on a word.
"""

import random
from collections.abc import Mapping
from dataclasses import dataclass

import pytest

from planning.loop.loop import run_loop
from planning.loop.results import LoopSettings
from tests.support.models.furnished_world import FurnishedWorld, piece
from tests.support.models.run_contexts import context_of
from tests.support.models.symbolic_world import Journal

COLOURS = ("red", "yellow", "green", "blue", "orange", "purple", "white", "black")
THINGS = ("cube", "apple", "lemon", "can", "ball", "cup", "banana")
HOUSES = ("cabinet", "cupboard", "oven", "locker", "vault", "wardrobe")
MAKES = ("wooden", "stone", "steel", "old", "tall")
LEVERS = ("lever", "crank", "toggle")
PLATES = ("weight_sensor", "scale", "pedal")
NAMINGS = range(6)


@dataclass(frozen=True)
class Names:
    """Names for the parts of a task, drawn by seed; all different."""

    thing: str
    weight: str
    bar: str
    distractors: tuple[str, ...]
    house: str
    other_house: str
    lever: str
    plate: str

    @classmethod
    def draw(cls, seed: int) -> "Names":
        rng = random.Random(seed)
        colours, things = rng.sample(COLOURS, 5), rng.sample(THINGS, 5)
        loose = [f"{c}_{t}" for c, t in zip(colours, things, strict=True)]
        house, other = (f"{m}_{h}" for m, h in zip(rng.sample(MAKES, 2), rng.sample(HOUSES, 2), strict=True))
        return cls(loose[0], loose[1], loose[2], tuple(loose[3:]), house, other, rng.choice(LEVERS), rng.choice(PLATES))

    def furniture(self, *names: str) -> dict:
        known = {
            self.house: piece(self.house, "door", "door"),
            self.other_house: piece(self.other_house, "door", "left_door", "right_door"),
            self.lever: piece(self.lever, "lever", "rod"),
            self.plate: piece(self.plate, "plate", "plate"),
        }
        return {name: known[name] for name in names}


def world_of(names: Names, places: Mapping[str, str], *furniture: str, **details) -> FurnishedWorld:
    around = dict.fromkeys(names.distractors, "table")
    return FurnishedWorld({**around, **places}, frozenset(), furniture=names.furniture(*furniture), **details)


def reach(goal: str, world: FurnishedWorld, log=None, settings=None):
    return run_loop(context_of(goal, world, log=log, settings=settings))


def said(name: str) -> str:
    return name.replace("_", " ")


@pytest.mark.parametrize("seed", NAMINGS)
def test_what_has_to_go_into_closed_furniture_goes_through_its_doors(seed):
    names = Names.draw(seed)
    world = world_of(names, {names.thing: "table"}, names.other_house)
    result = reach(f"place the {said(names.thing)} in the {said(names.other_house)}", world)
    assert result.reached, result.reason
    assert world.places[names.thing] == names.other_house
    assert all(world.is_open(j.name) for j in world.furniture[names.other_house].joints)


@pytest.mark.parametrize("seed", NAMINGS)
def test_a_bar_before_a_door_goes_first(seed):
    names = Names.draw(seed)
    door = f"{names.house}_door"
    world = world_of(
        names,
        {names.thing: "table", names.bar: "table"},
        names.house,
        bars={door: names.bar},
        beside={names.bar: names.house},
    )
    log = Journal()
    result = reach(f"put the {said(names.thing)} into the {said(names.house)}", world, log)
    assert result.reached, result.reason
    assert [c.kind for c in result.causes] == ["blocked_by"]
    actions = [s.action for s in result.steps if s.ok]
    assert actions[0] == f"move {names.bar} away from {names.house}"
    assert not [s for s in world.specs if s.primary.subject in names.distractors], "nothing innocent is moved"
    assert log.of("evidence")[0]["measured"][0] == f"{names.bar} is in the way of {door}."


@pytest.mark.parametrize("seed", NAMINGS)
def test_behind_a_locked_door_that_nothing_blocks_a_lever_is_pulled(seed):
    names = Names.draw(seed)
    door, rod = f"{names.house}_door", f"{names.lever}_rod"
    world = world_of(names, {names.thing: names.house}, names.house, names.lever, bolts={door: rod})
    world.explanation = locked(door)
    result = reach(f"find the {said(names.thing)}", world)
    assert result.reached, result.reason
    assert [s.action for s in result.steps] == [
        f"open {door}",
        f"pull {rod}",
        f"open {door}",
        f"look for {names.thing}",
    ]
    assert result.reason.startswith(f"Yes, {names.thing} is in view")


@pytest.mark.parametrize("seed", NAMINGS)
def test_a_door_that_does_not_go_all_the_way_is_opened_as_far_as_it_goes(seed):
    names = Names.draw(seed)
    door, rod = f"{names.house}_door", f"{names.lever}_rod"
    world = world_of(names, {names.thing: names.house}, names.house, names.lever, bolts={door: rod}, most={door: 0.81})
    world.explanation = locked(door)
    result = reach(f"find the {said(names.thing)}", world)
    assert result.reached, result.reason
    assert [s.action for s in result.steps] == [
        f"open {door}",
        f"open {door} to 81 %",
        f"pull {rod}",
        f"open {door} to 81 %",
        f"look for {names.thing}",
    ]


def test_a_door_that_hardly_opens_is_not_opened_in_vain():
    names = Names.draw(0)
    door = f"{names.house}_door"
    world = world_of(names, {names.thing: names.house}, names.house, most={door: 0.2})
    result = reach(f"find the {said(names.thing)}", world)
    assert not result.reached
    assert "can be driven to 20% at most" in result.reason
    assert world.fractions.get(door, 0.0) == 0.0


@pytest.mark.parametrize("seed", NAMINGS)
def test_behind_a_locked_door_a_weight_is_put_on_a_plate_when_no_lever_is_there(seed):
    names = Names.draw(seed)
    door = f"{names.house}_door"
    world = world_of(names, {}, names.house, names.plate, bolts={door: f"{names.plate}_plate"})
    world.explanation = locked(door)
    result = reach(f"open the {said(names.house)}", world)
    assert result.reached, result.reason
    assert [n for n in names.distractors if world.places[n] == names.plate]


@pytest.mark.parametrize("seed", NAMINGS)
def test_a_hint_about_a_lock_is_followed_and_its_hidden_weight_is_looked_for(seed):
    names = Names.draw(seed)
    door = f"{names.house}_door"
    world = world_of(
        names,
        {names.weight: names.other_house},
        names.house,
        names.other_house,
        names.plate,
        bolts={door: f"{names.plate}_plate"},
    )
    goal = (
        f"open the {said(names.house)}; its lock opens when the {said(names.weight)} is put on the {said(names.plate)}"
    )
    result = reach(goal, world)
    assert result.reached, result.reason
    assert world.places[names.weight] == names.plate and world.is_open(door)
    assert not [s for s in world.specs if s.primary.subject in names.distractors]


@pytest.mark.parametrize("seed", NAMINGS)
def test_closed_insides_are_searched_nearest_first_until_the_thing_is_seen(seed):
    names = Names.draw(seed)
    where = names.house if seed % 2 else names.other_house
    world = world_of(names, {names.thing: where}, names.house, names.other_house)
    result = reach(f"where is the {said(names.thing)}?", world)
    assert result.reached, result.reason
    x = {n: world.look([n]).objects[0].position[0] for n in (names.house, names.other_house)}
    nearest = min(x, key=lambda n: x[n])
    assert result.steps[0].action.startswith(f"open {nearest}_")


@pytest.mark.parametrize("seed", NAMINGS)
def test_a_search_that_finds_nothing_ends_and_says_where_it_looked(seed):
    names = Names.draw(seed)
    world = world_of(names, {}, names.house, names.other_house)
    result = reach(f"find the {said(names.thing)}", world)
    assert not result.reached
    assert result.reason.startswith(f"{said(names.thing)} is not in view; in view: ")
    assert f"{said(names.thing)} is not in view, and nothing is left that may hide it" in result.reason
    assert all(world.is_open(j.name) for f in world.furniture.values() for j in f.joints)
    assert len(result.steps) < 12


def test_a_door_that_nothing_unlocks_is_given_up_with_what_was_tried():
    names = Names.draw(0)
    door = f"{names.house}_door"
    world = world_of(names, {}, names.house, names.lever, bolts={door: "nothing"})
    world.explanation = locked(door)
    result = reach(f"open the {said(names.house)}", world)
    assert not result.reached
    assert f"{door} is locked, and nothing is left that may unlock it" in result.reason
    assert f"pull {names.lever}_rod" in [s.action for s in result.steps if s.ok]


def test_what_was_learnt_about_the_cell_is_shown_with_every_new_plan():
    names = Names.draw(1)
    door, rod = f"{names.house}_door", f"{names.lever}_rod"
    world = world_of(names, {names.thing: names.house}, names.house, names.lever, bolts={door: rod})
    world.explanation = locked(door)
    log = Journal()
    reach(f"find the {said(names.thing)}", world, log)
    replans = [p["prompt"] for p in log.of("prompt") if p["contract"] == "replan"]
    assert f"- {door} is locked\n" in replans[0]
    assert f"- {door} is a door of {names.house} and is closed\n" in replans[0]
    assert f"- the inside of {names.house} is hidden\n" in replans[0]


def test_a_goal_that_holds_already_is_confirmed_by_a_look_and_nothing_moves():
    names = Names.draw(2)
    world = world_of(names, {}, names.house)
    result = reach(f"close the {said(names.house)}", world)
    assert result.reached and not world.specs
    assert result.reason == f"Yes, {names.house}_door is closed"


def test_closing_is_a_goal_of_its_own():
    names = Names.draw(3)
    world = world_of(names, {}, names.house, fractions={f"{names.house}_door": 1.0})
    assert reach(f"please shut the {said(names.house)}", world).reached
    assert not world.is_open(f"{names.house}_door")


@pytest.mark.parametrize("part", ["verifier", "perceiver", "replan"])
def test_each_part_can_be_left_out_and_a_plain_task_still_works(part):
    names = Names.draw(4)
    world = world_of(names, {names.thing: "table"}, names.house, fractions={f"{names.house}_door": 1.0})
    log = Journal()
    goal = f"place the {said(names.thing)} in the {said(names.house)}"
    result = reach(goal, world, log, LoopSettings(without=frozenset({part})))
    assert result.reached, result.reason
    asked = {p["contract"] for p in log.of("prompt")}
    assert ("verify_reward" in asked) == (part != "verifier")


def test_without_a_perceiver_nobody_finds_out_what_blocks_a_door():
    names = Names.draw(5)
    door = f"{names.house}_door"
    world = world_of(names, {names.bar: "table"}, names.house, bars={door: names.bar}, beside={names.bar: names.house})
    log = Journal()
    settings = LoopSettings(without=frozenset({"perceiver"}))
    result = reach(f"open the {names.house}_door", world, log, settings)
    assert not result.reached
    assert not log.of("vote") and all("facts" not in p or not p["facts"] for p in log.of("prompt"))
    assert names.bar in world.beside


def test_without_replanning_the_first_failure_is_the_end():
    names = Names.draw(5)
    door = f"{names.house}_door"
    world = world_of(names, {names.bar: "table"}, names.house, bars={door: names.bar}, beside={names.bar: names.house})
    result = reach(f"open the {said(names.house)}", world, settings=LoopSettings(without=frozenset({"replan"})))
    assert not result.reached and len(world.specs) == 1 and result.replans == 0


def locked(door: str):
    from control.tasks.failure import FailureCause

    return FailureCause("locked", door, f"nothing that was seen holds '{door}'")
