"""The five failures that the RePlan paper reports (its section on failure cases), each as a regression test."""

import pytest

from control.tasks.failure import FailureCause
from planning.loop.results import LoopSettings
from tests.planning.test_loop import Overriding, cubes, reach
from tests.support.models.symbolic_world import Journal

# -- 1. A wrong primary reward: the motion stopped before the thing had moved


def test_a_wrong_primary_reward_in_the_program_is_overruled():
    program = (
        "```\nreset_reward()\nminimize_l2_distance_reward(palm, red_cube, primary_reward=True)\n"
        "minimize_l2_distance_reward(red_cube, crate)\nexecute_plan()\n```"
    )
    world, log = cubes(), Journal()
    assert reach("place the red cube on the crate", world, reasoner=Overriding(reward_program=program), log=log).reached
    assert world.specs[0].primary.subject == "red_cube"
    assert log.of("primary")[0]["overruled"]


def test_a_verifier_that_ends_a_relocation_at_the_palm_is_asked_again():
    reasoner = Overriding(verify_primary="<thought>near</thought><step>1</step>")
    result = reach("place the red cube on the crate", cubes(), reasoner=reasoner, settings=LoopSettings(0, 1))
    assert not result.reached
    assert "line 1 ('palm is close to red_cube') is about the palm" in result.causes[0].message


# -- 2. A summary against the majority of the diagnoses


def test_a_summary_against_the_majority_of_votes_is_overruled():
    reasoner = Overriding(summarize_failure="<reason>The crate is too small.</reason>")
    log = Journal()
    result = reach("place the red cube on the crate", cubes(yellow_cube="crate"), reasoner=reasoner, log=log)
    assert result.reached
    diagnosis = log.of("diagnosis")[0]
    assert diagnosis["overruled"] and diagnosis["tally"] == {"yellow_cube": 6}
    assert "yellow_cube is on crate" in diagnosis["reasons"][0]
    assert "6 of 6 name yellow_cube" in log.of("malformed")[0]["reason"]


# -- 3. A vague question got a useless answer


def test_a_question_that_compares_or_names_nothing_is_sent_back_and_the_next_one_is_put():
    asked = iter(
        [
            "<question>Which cube has the same colour as the crate?</question>",
            "<question>Is it there?</question>",
            "<question>Is red_cube in view?</question>",
        ]
    )
    log = Journal()
    reasoner = Overriding(perception_questions=lambda fields: next(asked))
    assert reach("find the red cube", cubes(), reasoner=reasoner, log=log).reached
    first, second = (m["reason"] for m in log.of("malformed"))
    assert "compares things ('Which'); ask for one property of one named object" in first
    assert "the question 'Is it there?' names none of ['crate', 'red_cube', 'yellow_cube']" in second
    assert [o["question"] for o in log.of("observation")] == ["Is red_cube in view?"]


# -- 4. Diagnoses about the robot, and answers that a token limit cut off


def test_a_diagnosis_about_the_robot_is_kept_but_does_not_count():
    reasoner = Overriding(diagnose_failure="The gripper is already holding the red_cube.")
    log = Journal()
    result = reach("place the red cube on the crate", cubes(yellow_cube="crate"), reasoner=reasoner, log=log)
    assert {data["vote"].unusable for data in log.of("vote")} == {"it is about the robot"}
    assert log.of("diagnosis")[0]["reasons"] == ()
    assert result.reached  # the attempt itself said what was in the way


def test_one_lost_vote_does_not_end_the_run():
    def vote(fields):
        return "it is blocked and then the answer was cut" if fields["phrasing"] == 4 else "yellow_cube is on crate."

    log = Journal()
    world = cubes(yellow_cube="crate")
    assert reach("place the red cube on the crate", world, reasoner=Overriding(diagnose_failure=vote), log=log).reached
    unusable = [data["vote"].unusable for data in log.of("vote")]
    assert [u is None for u in unusable] == [True, True, True, False, True, True]
    assert "seems to be cut off" in unusable[3]


# -- 5. A failure of the controller was read as "this cannot be done"


@pytest.mark.parametrize("kind", ["tracking_error", "lost_grasp", "no_candidate", "refused_by_robot"])
def test_a_failure_of_the_motion_does_not_abandon_a_sound_plan(kind):
    world = cubes()
    world.failures = [FailureCause(kind, "red_cube", "it slipped")]
    result = reach("place the red cube on the crate", world)
    assert result.reached
    assert result.plans[1].steps == ("place red_cube on crate",)
