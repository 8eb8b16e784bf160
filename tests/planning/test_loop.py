"""The loop from goal to result, with the rule-based reasoner and a symbolic world."""

import random
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from control.errors import GoalError, ReasonerError, RefusedError, RobotGoneError, StoppedError, TermConflictError
from control.tasks.failure import FailureCause
from planning.builtin.reasoner import BuiltinReasoner
from planning.loop.loop import run_loop
from planning.loop.results import LoopSettings
from tests.support.models.run_contexts import CUBES, context_of
from tests.support.models.symbolic_world import Journal, World

ROOT = Path(__file__).resolve().parents[2]


def cubes(**places: str) -> World:
    return World({"crate": "table", "red_cube": "table", "yellow_cube": "table", **places}, frozenset({"crate"}))


def reach(goal: str, world: World, names=CUBES, reasoner=None, log=None, settings=None):
    return run_loop(context_of(goal, world, known_names=names, reasoner=reasoner, log=log, settings=settings))


class Overriding:
    """The rule-based reasoner with other answers to some contracts: a text, or a function of the fields."""

    name = "overriding"

    def __init__(self, **answers: Any) -> None:
        self.answers = answers
        self.prompts: list[tuple[str, str]] = []

    def answer(self, contract: str, prompt: str, fields: Mapping[str, Any], images: Sequence[Any] = ()) -> str:
        self.prompts.append((contract, prompt))
        other = self.answers.get(contract)
        if other is None:
            return BuiltinReasoner().answer(contract, prompt, fields, images)
        return str(other(fields) if callable(other) else other)


def test_a_plain_place_takes_one_step_and_is_judged_on_what_is_seen():
    world, log = cubes(), Journal()
    result = reach("place the red cube on the crate", world, log=log)
    assert result.reached and result.replans == 0
    assert world.places["red_cube"] == "crate"
    assert result.plans[0].steps == ("place red_cube on crate",)
    assert result.reason == "red_cube is on crate"
    assert world.looks == 2  # before the plan and after the motion
    assert log.of("judgement")[0]["met"]


def test_a_blocked_place_is_replanned_with_the_blocking_object_named():
    world, log = cubes(yellow_cube="crate"), Journal()
    result = reach("place the red cube on the crate", world, log=log)
    assert result.reached and result.replans == 1
    assert world.places == {"crate": "table", "red_cube": "crate", "yellow_cube": "table"}
    assert result.plans[1].steps == ("move yellow_cube away from crate", "place red_cube on crate")
    assert [c.kind for c in result.causes] == ["blocked_by"]
    assert "yellow_cube" in log.of("failed_attempt")[0]["reason"]
    assert len(log.of("vote")) == 6
    terms = [spec.primary for spec in world.specs]
    assert [(t.kind, t.subject, t.target, t.value) for t in terms[1:2]] == [
        ("maximize_l2_distance", "yellow_cube", "crate", 0.2)
    ]


def test_what_lies_on_what_lies_in_the_way_goes_first():
    world = cubes(yellow_cube="crate")
    world.places["lemon"] = "yellow_cube"
    result = reach("place the red cube on the crate", world, names=(*CUBES, "lemon"))
    assert result.reached
    assert result.plans[-1].steps == (
        "move lemon away from yellow_cube",
        "move yellow_cube away from crate",
        "place red_cube on crate",
    )
    assert world.places["lemon"] == "table" and world.places["red_cube"] == "crate"


def test_a_goal_about_something_absent_says_what_is_there_and_moves_nothing():
    world = World({"apple": "table", "bowl": "table"}, frozenset({"bowl"}))
    result = reach("place the banana in the bowl", world, names=("apple", "bowl"))
    assert not result.reached
    assert result.reason == "banana is not in view; in view: apple, bowl"
    assert world.specs == []


def test_a_thing_that_the_detector_cannot_look_for_counts_as_not_seen():
    world = World({"apple": "table", "bowl": "table"}, frozenset({"bowl"}), deaf_to=frozenset({"banana"}))
    result = reach("place the banana in the bowl", world, names=("apple", "bowl"))
    assert result.reason == "banana is not in view; in view: apple, bowl"
    assert world.specs == []


def test_something_outside_the_cells_names_is_looked_for_and_can_be_moved():
    world = World({"pear": "table", "bowl": "table"}, frozenset({"bowl"}))
    assert reach("put the pear into the bowl", world, names=("bowl",)).reached
    assert world.places["pear"] == "bowl"


def test_moving_away():
    world = cubes(yellow_cube="crate")
    result = reach("move the yellow cube away from the crate", world)
    assert result.reached and world.places["yellow_cube"] == "table"


def test_finding_needs_eyes_only_and_tells_where():
    world = World({"apple": "table", "bowl": "table"}, frozenset({"bowl"}))
    result = reach("find the apple", world, names=("apple", "bowl"))
    assert result.reached and world.specs == []
    assert result.reason.startswith("Yes, apple is in view: box of 50 x 50 x 50 mm, centre at x 0.400")


def test_what_cannot_be_found_is_not_reached_and_says_what_is_in_view():
    world = World({"bowl": "table"}, frozenset({"bowl"}))
    result = reach("find the apple", world, names=("apple", "bowl"))
    assert not result.reached and world.specs == []
    assert result.reason == "apple is not in view; in view: bowl"
    assert result.causes[0].kind == "not_seen" and result.causes[0].subject == "apple"


def test_clauses_are_carried_out_in_order():
    world = cubes(yellow_cube="crate")
    result = reach("move the yellow cube away from the crate and then put the red cube on the crate", world)
    assert result.reached and result.replans == 0
    assert result.plans[0].steps == ("move yellow_cube away from crate", "place red_cube on crate")


def test_a_later_clause_may_replace_what_an_earlier_one_achieved():
    world = cubes()
    result = reach("put the red cube on the crate; then take the red cube off the crate", world)
    assert result.reached and world.places["red_cube"] == "table"


def test_an_empty_goal_is_an_error():
    with pytest.raises(GoalError, match="the goal is empty"):
        reach("   ", cubes())


def test_a_goal_that_is_not_understood_names_its_part_and_moves_nothing():
    world = cubes()
    with pytest.raises(GoalError, match="cannot understand 'juggle the cube'"):
        reach("juggle the cube", world)
    with pytest.raises(GoalError, match="cannot understand 'all cubes'"):
        reach("place all cubes on the crate", world)
    with pytest.raises(GoalError, match="the colour of crate is not known, so 'cube' of the same colour cannot be"):
        reach("place the cube with the same colour as the crate on the crate", world)
    assert world.specs == []


def test_an_ambiguous_name_lists_the_candidates():
    with pytest.raises(GoalError, match="'cube' may mean red_cube or yellow_cube; say which one"):
        reach("place the cube on the crate", cubes())


def test_one_cube_alone_is_the_cube():
    world = World({"crate": "table", "red_cube": "table"}, frozenset({"crate"}))
    assert reach("place the cube on the crate", world).reached


def test_a_motion_without_effect_is_not_taken_for_success():
    world = cubes()
    world.undo = 1
    result = reach("place the red cube on the crate", world)
    assert result.reached and result.replans == 1
    assert result.causes[0].kind == "not_achieved"
    assert result.causes[0].message == "red_cube is not on crate"


def test_what_the_twin_knows_of_a_motion_without_effect_is_the_cause():
    world = cubes()
    world.undo = 1
    world.explanation = FailureCause("locked", "red_cube", "nothing that was seen holds 'red_cube'")
    result = reach("place the red cube on the crate", world)
    assert result.reached and result.causes[0] == world.explanation


def test_after_a_lost_grasp_nothing_innocent_is_moved_away():
    world = cubes(red_cube="crate")
    world.failures = [FailureCause("lost_grasp", "yellow_cube", "it slipped")]
    result = reach("move the yellow cube away from the crate", world)
    assert result.plans[1].steps == ("move yellow_cube away from crate",)


def test_a_refusal_of_the_driver_becomes_a_cause():
    world = cubes()
    world.failures = [RefusedError("certificate_used", "this certificate was played already")]
    result = reach("place the red cube on the crate", world)
    assert result.reached
    assert (result.causes[0].kind, result.causes[0].check) == ("refused_by_robot", "certificate_used")


def test_terms_that_exclude_each_other_become_a_cause_that_names_both_and_the_planner_goes_on():
    world = cubes()
    world.failures = [TermConflictError("near(a, b) and far(a, b) cannot both be met: being at 'b' is being near")]
    result = reach("place the red cube on the crate", world)
    assert result.reached
    assert result.causes[0].kind == "reasoner_error"
    assert result.causes[0].message == "near(a, b) and far(a, b) cannot both be met: being at 'b' is being near"


@pytest.mark.parametrize("error", [RobotGoneError("no answer"), StoppedError("stopped"), KeyboardInterrupt()])
def test_the_end_of_the_robot_or_of_patience_ends_the_run(error):
    world = cubes()
    world.failures = [error]
    with pytest.raises(type(error)):
        reach("place the red cube on the crate", world)


def test_a_hopeless_task_is_given_up_within_its_bounds():
    world = cubes()
    world.failures = [FailureCause("no_candidate", "red_cube", f"{k} motions failed") for k in range(100)]
    settings = LoopSettings(replans=2, plans=2)
    result = reach("place the red cube on the crate", world, settings=settings)
    assert not result.reached
    assert len(world.specs) == 2 * 3  # two plans, each with one attempt and two replans
    assert result.replans == 2 * 2 + 1
    assert result.reason == "'place red_cube on crate' failed 3 times, last: 5 motions failed"


def test_what_fails_in_the_same_words_again_and_again_is_given_up_early():
    world = cubes()
    world.failures = [FailureCause("no_candidate", "red_cube", "red_cube is too wide")] * 100
    result = reach("place the red cube on the crate", world)
    assert not result.reached and len(world.specs) == 3
    assert "'place red_cube on crate' failed 3 times alike" in result.reason
    assert "red_cube is too wide." in result.reason


def test_every_prompt_answer_and_verdict_is_logged():
    log = Journal()
    reach("place the red cube on the crate", cubes(yellow_cube="crate"), log=log)
    assert len(log.of("prompt")) == len(log.of("answer")) > 20
    assert all("builtin" in data["reasoner"] for data in log.of("answer"))
    names = {event for event, _ in log.events}
    assert {"goal", "plan", "route", "description", "reward", "attempt", "judgement", "vote", "diagnosis"} <= names


def test_malformed_plans_are_asked_for_again_with_the_reason_then_given_up():
    log, reasoner = Journal(), Overriding(high_level_plan="> place red_cube on crate")
    with pytest.raises(ReasonerError, match=r"overriding gave no usable answer to 'high_level_plan' in 3 tries"):
        reach("place the red cube on the crate", cubes(), reasoner=reasoner, log=log)
    assert len(log.of("malformed")) == 3
    assert "could not be used: the plan must stand once between [start plan] and [end plan]" in reasoner.prompts[1][1]
    assert "could not be used" not in reasoner.prompts[0][1]


def test_an_unusable_reward_program_is_a_cause_and_not_the_end():
    reasoner = Overriding(reward_program="```python\n__import__('os').system('x')\n```")
    world, log = cubes(), Journal()
    settings = LoopSettings(1, 1)
    result = reach("place the red cube on the crate", world, reasoner=reasoner, settings=settings, log=log)
    assert not result.reached and world.specs == []
    assert result.causes[0].kind == "reasoner_error"
    assert "attribute access ('.system')" in result.causes[0].message
    assert log.of("vote") == []  # objects have no part in it


def test_votes_of_five_to_one_stand_with_all_votes_kept():
    def vote(fields):
        return "The crate is broken." if fields["phrasing"] == 2 else "yellow_cube is on crate."

    log = Journal()
    reach(
        "place the red cube on the crate",
        cubes(yellow_cube="crate"),
        reasoner=Overriding(diagnose_failure=vote),
        log=log,
    )
    votes = [data["vote"] for data in log.of("vote")]
    assert [v.phrasing for v in votes] == [1, 2, 3, 4, 5, 6]
    assert votes[1].blames == ("crate",) and votes[0].blames == ("yellow_cube",)


def test_names_that_the_scene_does_not_have_are_replaced_by_the_closest():
    reasoner = Overriding(diagnose_failure="The yellow block is on the crate.")
    log = Journal()
    reach("place the red cube on the crate", cubes(yellow_cube="crate"), reasoner=reasoner, log=log)
    vote = log.of("vote")[0]["vote"]
    assert vote.answer == "The yellow block is on the crate."
    assert vote.sentence == "The yellow_cube is on the crate." and vote.blames == ("yellow_cube",)


def test_a_vision_step_may_leave_a_motion_to_be_done():
    remaining = "no\n<Action>move yellow_cube away from crate</Action>"
    world = cubes(yellow_cube="crate")
    result = reach("find the crate", world, reasoner=Overriding(action_completed=remaining))
    assert result.reached and world.places["yellow_cube"] == "table"


def test_undone_work_is_noticed_at_the_end():
    class Clumsy(World):
        """Bumps the red cube off whatever it is on while it moves the yellow one."""

        def attempt(self, spec, scene):
            result = super().attempt(spec, scene)
            if spec.primary.subject == "yellow_cube":
                self.places["red_cube"] = "table"
            return result

    goal = "place the red cube on the crate then move the yellow cube away from the crate"
    once = reach(goal, Clumsy(cubes().places, frozenset({"crate"})), settings=LoopSettings(plans=1))
    assert not once.reached
    assert once.reason == "all steps were done, but red_cube is not on crate"
    world = Clumsy(cubes().places, frozenset({"crate"}))
    twice = reach(goal, world)
    assert twice.reached and twice.replans == 1 and world.places["red_cube"] == "crate"


COLOURS = ("red", "green", "blue", "purple", "orange", "black", "white")
NOUNS = ("cube", "block", "mug", "tin", "brick", "jar", "lemon", "sponge", "bottle")
CARRIERS = ("crate", "bowl", "tray", "plate", "basket")


@pytest.mark.parametrize("seed", range(25))
def test_renaming_and_recolouring_everything_changes_nothing(seed):
    rng = random.Random(seed)
    colour = rng.sample(COLOURS, 3)
    nouns = rng.sample(NOUNS, 2)
    moved = f"{colour[0]}_{nouns[0]}" if rng.random() < 0.7 else nouns[0]
    blocker = f"{colour[1]}_{nouns[1]}" if rng.random() < 0.7 else nouns[1]
    carrier = rng.choice((f"{colour[2]}_{rng.choice(CARRIERS)}", rng.choice(CARRIERS)))
    places = {moved: "table", blocker: carrier, carrier: "table"}
    names = list(places)
    rng.shuffle(names)
    world = World({n: places[n] for n in names}, frozenset({carrier}))
    verb, how = rng.choice(("place", "put", "Move")), rng.choice(("on", "in", "onto"))
    goal = f"{verb} the {moved} {how} the {carrier}".replace("_", " ")
    result = reach(goal, world, names=tuple(names))
    assert result.reached and result.replans == 1
    assert world.places == {moved: carrier, blocker: "table", carrier: "table"}
    assert result.plans[1].steps[0] == f"move {blocker} away from {carrier}"


def test_planning_loads_neither_simulator_nor_networks():
    code = "import sys, planning.loop.loop, planning.builtin.reasoner; print(*sys.modules)"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert not {"mujoco", "torch", "cv2", "jinja2"} & set(out.stdout.split())


def test_what_stands_too_close_is_moved_away_from_the_thing_that_it_is_next_to():
    world, log = cubes(), Journal()
    world.beside["yellow_cube"] = "red_cube"
    cause = FailureCause("unsafe", "red_cube", "fingers would touch it", bodies=("yellow_cube",), check="contact")
    world.failures = [cause]
    result = reach("place the red cube on the crate", world, log=log)
    assert result.reached
    assert result.plans[1].steps == ("move yellow_cube away from red_cube", "place red_cube on crate")


def test_a_blamed_thing_that_stands_far_away_is_left_alone():
    world = cubes()
    world.failures = [FailureCause("unsafe", "red_cube", "too near", bodies=("yellow_cube",), check="contact")]
    result = reach("place the red cube on the crate", world)
    assert result.reached and result.plans[1].steps == ("place red_cube on crate",)


def test_each_role_can_have_a_reasoner_of_its_own():
    class Silent(Overriding):
        name = "silent"

    world, log = cubes(yellow_cube="crate"), Journal()
    others = {"perceiver": Silent()}
    goal = "place the red cube on the crate"
    run_loop(context_of(goal, world, log=log, by_role=others, pictures=lambda: ("picture",)))
    by_silent = {data["contract"] for data in log.of("prompt") if data["reasoner"] == "silent"}
    assert by_silent == {"diagnose_failure"}
    assert {data["pictures"] for data in log.of("prompt") if data["contract"] == "diagnose_failure"} == {1}
    assert {data["pictures"] for data in log.of("prompt") if data["contract"] != "diagnose_failure"} == {0}


def test_what_was_cleared_away_need_not_stay_where_it_was_put():
    class Dragging(World):
        """Drags the yellow cube back beside the crate while the red one is placed."""

        def attempt(self, spec, scene):
            result = super().attempt(spec, scene)
            if result.ok and spec.primary.subject == "red_cube":
                self.beside["yellow_cube"] = "crate"
            return result

    world = Dragging(cubes(yellow_cube="crate").places, frozenset({"crate"}))
    assert reach("place the red cube on the crate", world).reached


def test_where_the_palm_was_is_not_asked_again_at_the_end():
    result = reach("reach the crate then place the red cube on the crate", cubes())
    assert result.reached and [s.action for s in result.steps] == ["reach crate", "place red_cube on crate"]
    plan = "<thought>Tidy.</thought>\n[start plan]\n> reach crate\n> place red_cube on crate\n[end plan]"
    assert reach("tidy up", cubes(), reasoner=Overriding(high_level_plan=plan)).reached


def test_of_several_unknown_words_only_those_that_cannot_be_looked_for_are_given_up():
    world = World({"pear": "table", "bowl": "table"}, frozenset({"bowl"}), deaf_to=frozenset({"gizmo"}))
    log = Journal()
    result = reach("put the pear in the bowl then put the gizmo in the bowl", world, names=("bowl",), log=log)
    assert result.reason == "gizmo is not in view; in view: bowl, pear"
    assert [data["name"] for data in log.of("unlookable")] == ["gizmo"]


def test_a_backend_that_fails_in_the_middle_of_a_diagnosis_ends_the_run_at_once():
    def gone(fields):
        raise ReasonerError("the language server broke off; look at its log")

    log = Journal()
    with pytest.raises(ReasonerError, match="the language server broke off"):
        reach(
            "place the red cube on the crate",
            cubes(yellow_cube="crate"),
            reasoner=Overriding(diagnose_failure=gone),
            log=log,
        )
    assert len([p for p in log.of("prompt") if p["contract"] == "diagnose_failure"]) == 1
