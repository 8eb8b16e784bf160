"""Task and motion planning: the whole plan is checked in the twin before anything moves, and is played once."""

from dataclasses import dataclass

import pytest

from control.errors import GoalError, RefusedError
from control.tasks.failure import FailureCause
from control.tasks.reward_spec import RewardSpec
from perception.estimates import SceneEstimate
from planning.baselines.rehearsal import Rehearsal
from planning.baselines.task_and_motion import MAX_CHECKS, run_task_and_motion
from tests.support.models.furnished_world import FurnishedWorld, piece
from tests.support.models.run_contexts import context_of
from tests.support.models.symbolic_world import Journal

CUPBOARD = {"cupboard": piece("cupboard", "door", "left_door", "right_door")}
WITH_LEVER = {**CUPBOARD, "lever": piece("lever", "lever", "rod")}


def cubes(**more) -> FurnishedWorld:
    places = {"crate": "table", "red_cube": "table", "yellow_cube": "crate"}
    return FurnishedWorld({**places, **more.pop("places", {})}, frozenset({"crate"}), **more)


def reach(goal: str, world: FurnishedWorld, log=None, max_checks=MAX_CHECKS, **more):
    return run_task_and_motion(context_of(goal, world, log=log, **more), max_checks)


def test_nothing_moves_before_the_whole_plan_was_checked():
    world = cubes()
    result = reach("place the red cube on the crate", world)
    assert result.reached and result.reason == "red_cube is on crate" and result.replans == 0
    assert result.plans[0].steps == ("move yellow_cube away from crate", "place red_cube on crate")
    assert len(world.rehearsed) == 2 and world.rehearsed_at_first_motion == 2
    assert world.specs == world.rehearsed
    assert world.looks == 2  # at first, and for the judge at the end


def test_what_the_twin_finds_in_the_way_of_a_door_is_moved_first():
    world = cubes(
        places={"kettle": "table"}, furniture=CUPBOARD, beside={"kettle": "cupboard"},
        bars={"cupboard_left_door": "kettle"},
    )  # fmt: skip
    log = Journal()
    result = reach("put the red cube in the cupboard", world, log)
    assert result.reached
    steps = result.plans[0].steps
    assert len(steps) == 4
    assert steps.index("move kettle away from cupboard") < steps.index("open cupboard_left_door")
    learned = [e["learned"] for e in log.of("checked") if not e["possible"]]
    assert learned == [[("is-away", "kettle", "cupboard")]]
    assert world.rehearsed_at_first_motion == len(world.rehearsed)
    assert len(world.specs) == 4  # what was found impossible was never tried


def test_a_bolt_that_no_twin_knows_of_is_met_in_the_cell_only():
    world = cubes(furniture=WITH_LEVER, bolts={"cupboard_left_door": "lever_rod"})
    result = reach("put the red cube in the cupboard", world)
    assert not result.reached and len(result.plans) == 1 and "pull lever_rod" not in result.plans[0].steps
    told = cubes(furniture=WITH_LEVER, bolts={"cupboard_left_door": "lever_rod"})
    sentence = "cupboard_left_door is locked until lever_rod is open"
    assert reach("put the red cube in the cupboard", told, told=(sentence,)).reached


def test_a_motion_without_effect_shows_at_the_end_only():
    world = cubes()
    world.undo = 1
    result = reach("move the yellow cube away from the crate", world)
    assert not result.reached and world.places["yellow_cube"] == "crate" and world.looks == 2
    assert [c.kind for c in result.causes] == ["not_achieved"] and result.replans == 0


def test_a_goal_that_holds_already_takes_no_motion():
    world = cubes()
    result = reach("place the yellow cube on the crate", world)
    assert result.reached and world.specs == [] and world.rehearsed == []


def test_what_is_out_of_sight_cannot_be_planned_for():
    world = cubes(places={"apple": "cupboard"}, furniture=CUPBOARD)
    result = reach("find the apple", world)
    assert not result.reached and world.rehearsed == []
    assert result.reason == "apple is not in view; in view: crate, red cube, yellow cube, cupboard"


def test_an_empty_goal_is_an_error_and_a_strange_one_is_not_reached():
    with pytest.raises(GoalError, match="the goal is empty"):
        reach(" ", cubes())
    result = reach("juggle the cubes", cubes())
    assert not result.reached and result.reason.startswith("cannot understand 'juggle the cubes'")


@dataclass
class Clumsy(FurnishedWorld):
    """Hands that cannot take hold of some things, and may refuse to play."""

    too_wide: tuple[str, ...] = ()
    refusal: str = ""

    def rehearse(
        self, spec: RewardSpec, scene: SceneEstimate, after: Rehearsal | None = None
    ) -> Rehearsal | FailureCause:
        if spec.primary.subject in self.too_wide:
            self.rehearsed.append(spec)
            return FailureCause("no_candidate", spec.primary.subject, f"{spec.primary.subject} is too wide")
        return super().rehearse(spec, scene, after)

    def play(self, rehearsal: Rehearsal):
        if self.refusal:
            raise RefusedError(self.refusal, "the arm stands elsewhere")
        return super().play(rehearsal)


def clumsy(**more) -> Clumsy:
    return Clumsy({"crate": "table", "red_cube": "table", "yellow_cube": "crate"}, frozenset({"crate"}), **more)


def test_when_no_sequence_is_left_the_last_reason_is_told():
    world = clumsy(too_wide=("red_cube",))
    result = reach("place the red cube on the crate", world)
    assert not result.reached and world.specs == []
    assert result.reason == (
        "no plan was found within 20 checked motions; the last motion that was not possible: red_cube is too wide"
    )
    assert {c.kind for c in result.causes} == {"no_candidate"}


def test_the_number_of_checks_is_bounded():
    world = clumsy(too_wide=("red_cube",))
    result = reach("place the red cube on the crate", world, max_checks=3)
    assert len(world.rehearsed) == 3 and result.reason.startswith("no plan was found within 3 checked motions")


def test_a_thing_that_nothing_can_be_done_about_leaves_no_sequence():
    world = clumsy(too_wide=("red_cube", "yellow_cube", "crate"))
    result = reach("place the red cube on the crate", world)
    assert not result.reached and result.reason.startswith("no sequence of actions reaches the goal; the last motion")


def test_a_refusal_of_the_driver_ends_the_plan():
    world = clumsy(refusal="start_mismatch")
    result = reach("place the red cube on the crate", world)
    assert not result.reached and len(result.steps) == 1
    assert (result.causes[0].kind, result.causes[0].check) == ("refused_by_robot", "start_mismatch")
