"""Language to rewards and the plan in one go: what they reach without replanning, and how they fail at the rest."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from control.errors import GoalError, RobotGoneError
from control.tasks.failure import FailureCause
from planning.baselines.language_to_rewards import run_language_to_rewards
from planning.baselines.one_shot_plan import run_one_shot_plan
from planning.builtin.reasoner import BuiltinReasoner
from planning.loop.results import LoopSettings
from tests.support.models.furnished_world import FurnishedWorld, piece
from tests.support.models.run_contexts import CUBES, context_of
from tests.support.models.symbolic_world import World

BOTH = pytest.mark.parametrize("run", [run_language_to_rewards, run_one_shot_plan])


def cubes(**places: str) -> World:
    return World({"crate": "table", "red_cube": "table", "yellow_cube": "table", **places}, frozenset({"crate"}))


def reach(run, goal: str, world: World, names=CUBES, reasoner=None, log=None, **more):
    return run(context_of(goal, world, known_names=names, reasoner=reasoner, log=log, **more))


class Scripted:
    """The rule-based reasoner with texts of its own for some contracts; keeps what it was shown."""

    name = "scripted"

    def __init__(self, **answers: str) -> None:
        self.answers = answers
        self.asked: list[tuple[str, int]] = []

    def answer(self, contract: str, prompt: str, fields: Mapping[str, Any], images: Sequence[Any] = ()) -> str:
        self.asked.append((contract, len(images)))
        return self.answers.get(contract) or BuiltinReasoner().answer(contract, prompt, fields, images)


def plan(*steps: str) -> str:
    return "<thought>so be it</thought>\n[start plan]\n" + "".join(f"> {s}\n" for s in steps) + "[end plan]"


@BOTH
def test_a_plain_place_is_reached(run):
    world = cubes()
    result = reach(run, "place the red cube on the crate", world)
    assert result.reached and result.reason == "red_cube is on crate" and result.replans == 0
    assert world.places["red_cube"] == "crate" and len(world.specs) == 1


@BOTH
def test_a_blocked_crate_is_a_failure_with_the_hands_reason_and_no_second_try(run):
    world = cubes(yellow_cube="crate")
    result = reach(run, "place the red cube on the crate", world)
    assert not result.reached and len(world.specs) == 1
    assert "red_cube finds no room" in result.reason
    assert [c.kind for c in result.causes] == ["blocked_by"]
    assert world.places["yellow_cube"] == "crate"


@BOTH
def test_what_is_not_in_view_is_named(run):
    world = World({"apple": "table", "bowl": "table"}, frozenset({"bowl"}))
    result = reach(run, "place the banana in the bowl", world, names=("apple", "bowl"))
    assert not result.reached and result.reason == "banana is not in view; in view: apple, bowl"
    assert world.specs == []


@BOTH
def test_a_motion_without_effect_is_not_taken_for_success(run):
    world = cubes()
    world.undo = 1
    result = reach(run, "place the red cube on the crate", world)
    assert not result.reached and "red_cube is not on crate" in result.reason
    assert [c.kind for c in result.causes] == ["not_achieved"] and len(world.specs) == 1


@BOTH
def test_an_empty_goal_is_an_error(run):
    with pytest.raises(GoalError, match="the goal is empty"):
        reach(run, " ", cubes())


@BOTH
def test_the_end_of_the_robot_ends_the_run(run):
    world = cubes()
    world.failures = [RobotGoneError("no answer")]
    with pytest.raises(RobotGoneError):
        reach(run, "place the red cube on the crate", world)


@BOTH
def test_each_failure_of_the_hands_is_the_runs_failure(run):
    world = cubes()
    world.failures = [FailureCause("no_candidate", "red_cube", "red_cube is too wide for the gripper")]
    result = reach(run, "place the red cube on the crate", world)
    assert not result.reached and result.reason.endswith("red_cube is too wide for the gripper")


def test_one_reward_program_cannot_be_written_by_the_rules_for_two_clauses():
    world = cubes()
    goal = "move the yellow cube away from the crate, then place the red cube on the crate"
    result = reach(run_language_to_rewards, goal, world)
    assert not result.reached and world.specs == []
    assert result.causes[0].kind == "reasoner_error"
    assert "it is no step of its small language" in result.reason


def test_language_to_rewards_asks_for_no_plan_and_no_verifier():
    asked = Scripted()
    reach(run_language_to_rewards, "place the red cube on the crate", cubes(), reasoner=asked)
    assert [name for name, _ in asked.asked] == ["needs_relocation", "motion_description", "reward_program"]


def test_the_primary_term_is_taken_as_it_was_written():
    program = "```python\nminimize_l2_distance_reward(palm, red_cube, primary_reward=True)\n"
    program += "minimize_l2_distance_reward(red_cube, crate)\nexecute_plan()\n```"
    world = cubes()
    reach(run_language_to_rewards, "place the red cube on the crate", world, reasoner=Scripted(reward_program=program))
    assert world.specs[0].primary.subject == "palm"


def test_the_plan_in_one_go_is_asked_for_with_the_picture():
    asked = Scripted()
    picture = np.zeros((4, 4, 3), np.uint8)
    goal = "place the red cube on the crate"
    result = reach(run_one_shot_plan, goal, cubes(), reasoner=asked, pictures=lambda: (picture,))
    assert result.reached
    assert asked.asked[0] == ("high_level_plan", 1)
    assert {"verify_reward", "verify_primary", "diagnose_failure", "replan"}.isdisjoint(n for n, _ in asked.asked)


def test_the_plan_in_one_go_is_carried_out_step_by_step():
    world = cubes(yellow_cube="crate")
    answer = Scripted(high_level_plan=plan("move yellow_cube away from crate", "place red_cube on crate"))
    result = reach(run_one_shot_plan, "place the red cube on the crate", world, reasoner=answer)
    assert result.reached and world.places["red_cube"] == "crate" and world.places["yellow_cube"] == "table"
    assert [s.action for s in result.steps] == ["move yellow_cube away from crate", "place red_cube on crate"]


def test_the_first_failed_step_ends_the_plan_in_one_go():
    world = cubes(yellow_cube="crate")
    answer = Scripted(high_level_plan=plan("place red_cube on crate", "move yellow_cube away from crate"))
    result = reach(run_one_shot_plan, "place the red cube on the crate", world, reasoner=answer)
    assert not result.reached and len(world.specs) == 1
    assert result.reason == "'place red_cube on crate' failed: red_cube finds no room"


def test_a_step_that_nobody_can_describe_ends_the_plan_in_one_go():
    world = cubes()
    result = reach(run_one_shot_plan, "a goal", world, reasoner=Scripted(high_level_plan=plan("juggle the red_cube")))
    assert not result.reached and result.causes[0].kind == "reasoner_error"
    assert "'juggle the red_cube' failed" in result.reason


def test_looking_is_a_step_of_the_plan_in_one_go():
    world = World({"apple": "table", "bowl": "table"}, frozenset({"bowl"}))
    result = reach(run_one_shot_plan, "find the apple", world, names=("apple", "bowl"))
    assert result.reached and result.reason.startswith("Yes, apple is in view") and world.specs == []
    gone = reach(run_one_shot_plan, "find the banana", world, names=("apple", "bowl"))
    assert not gone.reached and gone.causes[0].kind == "not_seen"
    assert gone.reason == "'look for banana' failed: banana is not in view; in view: apple, bowl"


def test_a_plan_in_one_go_that_is_too_long_stops_at_its_bound():
    answer = Scripted(high_level_plan=plan(*["reach red_cube"] * 4))
    settings = LoopSettings(max_steps=2)
    result = reach(run_one_shot_plan, "reach the red cube", cubes(), reasoner=answer, settings=settings)
    assert not result.reached and result.reason == "the plan took more than 2 steps"


def test_joints_of_furniture_in_view_may_be_named():
    cupboard = piece("cupboard", "door", "door")
    description = "[start of description]\npalm is close to cupboard\ncupboard_door is open\n[end of description]"
    answers = Scripted(needs_relocation="no", motion_description=description)
    world = FurnishedWorld({}, frozenset(), furniture={"cupboard": cupboard})
    result = reach(run_language_to_rewards, "open the cupboard", world, names=(), reasoner=answers)
    assert result.reached and world.is_open("cupboard_door")
    assert result.reason == "cupboard_door is 100% open"


def test_a_bolt_that_nothing_shows_ends_language_to_rewards():
    description = "[start of description]\npalm is close to cupboard\ncupboard_door is open\n[end of description]"
    answers = Scripted(needs_relocation="no", motion_description=description)
    furniture = {"cupboard": piece("cupboard", "door", "door"), "lever": piece("lever", "lever", "rod")}
    world = FurnishedWorld({}, frozenset(), furniture=furniture, bolts={"cupboard_door": "lever_rod"})
    result = reach(run_language_to_rewards, "open the cupboard", world, names=(), reasoner=answers)
    assert not result.reached and result.reason == "cupboard_door is 0% open"
