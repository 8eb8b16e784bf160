"""The rule-based reasoner: its answers have the contracts' forms and come from the fields alone."""

import inspect

import pytest

from control.errors import ReasonerError
from control.tasks.terms.registry import TERMS
from planning.builtin import perceiver, planner, plans, reasoner, situation, verifier
from planning.builtin.reasoner import BuiltinReasoner
from planning.language import answers
from planning.language.description import offered_lines
from planning.language.memory import FailedAttempt, cause_sentences
from planning.language.reward_program import parse_reward_answer
from prompts.contracts import CONTRACTS

OBJECTS = ("red_cube", "yellow_cube", "crate")
CALLS = TERMS.prompt_lines
FACTS = (
    "red_cube: box of 50 x 50 x 50 mm, centre at x 0.400, y 0.200, z 0.025 m",
    "yellow_cube: box of 50 x 50 x 50 mm, centre at x 0.500, y 0.000, z 0.105 m",
    "crate: box of 120 x 120 x 80 mm, centre at x 0.500, y 0.000, z 0.040 m",
    "yellow_cube is on crate",
    "apple is not in view: no box above the threshold",
)


def ask(contract: str, **fields) -> str:
    assert set(fields) == set(CONTRACTS[contract].fields)
    return BuiltinReasoner().answer(contract, "", fields)


def test_there_is_a_rule_for_every_contract_and_an_error_for_others():
    assert set(reasoner._RULES) == set(CONTRACTS)
    with pytest.raises(ReasonerError, match="no rule for 'sing'"):
        BuiltinReasoner().answer("sing", "", {})


def test_no_rule_knows_a_thing_of_any_cell():
    """Neither benchmark objects nor colours of theirs may decide anything."""
    for module in (reasoner, planner, plans, situation, perceiver, verifier):
        code = inspect.getsource(module)
        for word in ("red_cube", "yellow_cube", "crate", "lemon", "kettle", "bowl", "microwave", "wooden_cabinet"):
            assert word not in code, f"{module.__name__} speaks of {word}"


def replan(goal, attempts, finished=(), facts=FACTS, objects=OBJECTS):
    text = ask("replan", objects=objects, goal=goal, facts=facts, learnt=(), finished=finished, attempts=attempts)
    return answers.parse_plan(text)


def failed(action: str, reason: str) -> FailedAttempt:
    return FailedAttempt((action,), action, reason)


@pytest.mark.parametrize(
    "reason",
    [
        "yellow_cube is in the way of red_cube.",
        "yellow_cube is on crate.",
        "The yellow cube is on the crate.",
        "The Yellow_Cube is already on top of the crate.",
        "The yellow cube blocks the crate.",
        "There is no room: yellow_cube occupies crate.",
    ],
)
def test_what_a_failure_blames_is_moved_away_first(reason):
    plan = replan("place the red cube on the crate", (failed("place red_cube on crate", reason),))
    assert plan.steps == ("move yellow_cube away from crate", "place red_cube on crate")
    assert "yellow" in plan.thought.lower()


def test_what_was_moved_away_since_is_not_moved_again():
    attempts = (failed("place red_cube on crate", "yellow_cube is on crate."),)
    plan = replan("place the red cube on the crate", attempts, ("move yellow_cube away from crate",))
    assert plan.steps == ("place red_cube on crate",)


def test_things_that_block_each_other_do_not_send_the_rules_in_circles():
    attempts = (
        failed("place red_cube on crate", "yellow_cube is in the way of red_cube."),
        failed("move yellow_cube away from crate", "lemon is in the way of yellow_cube."),
        failed("move lemon away from crate", "yellow_cube is in the way of lemon."),
    )
    plan = replan("place the red cube on the crate", attempts, facts=(), objects=(*OBJECTS, "lemon"))
    assert plan.steps == ("move lemon away from crate", "move yellow_cube away from crate", "place red_cube on crate")


def test_after_a_failure_of_the_motion_itself_nothing_is_blamed():
    reason = "The motion itself failed (lost grasp). It slipped. yellow_cube is on crate."
    plan = replan("place the red cube on the crate", (failed("place red_cube on crate", reason),))
    assert plan.steps == ("place red_cube on crate",)
    assert "try again" in plan.thought


def test_finished_clauses_are_not_repeated():
    goal = "move the yellow cube away from the crate then place the red cube on the crate"
    attempts = (failed("place red_cube on crate", "The motion itself failed (lost grasp)."),)
    plan = replan(goal, attempts, ("move yellow_cube away from crate",))
    assert plan.steps == ("place red_cube on crate",)


def test_lifting_before_placing_is_one_motion():
    text = ask("high_level_plan", objects=OBJECTS, facts=FACTS, goal="pick up the red cube and place it on the crate")
    assert answers.parse_plan(text).steps == ("place red_cube on crate",)


@pytest.mark.parametrize(
    ("action", "lines", "primary"),
    [
        ("place red_cube on crate", ("red_cube is close to crate",), ("minimize_l2_distance", "red_cube", None)),
        ("move red_cube away from crate", ("red_cube is far from crate",), ("maximize_l2_distance", "red_cube", 0.2)),
        ("pick up red_cube", ("red_cube is at height 0.25",), ("set_obj_z_position", "red_cube", 0.25)),
        ("reach red_cube", (), ("minimize_l2_distance", "palm", None)),
    ],
)
def test_actions_become_descriptions_become_programs(action, lines, primary):
    relocates = answers.parse_yes_no(ask("needs_relocation", action=action))
    assert relocates == bool(lines)
    fields = {"objects": OBJECTS, "joints": (), "plan": (action,), "observations": (), "action": action}
    text = ask("motion_description", relocates=relocates, lines=offered_lines(relocates, False), **fields)
    description = [str(x) for x in answers.parse_description(text, OBJECTS, (), relocates)]
    assert description == ["palm is close to red_cube", *lines]
    code = ask("reward_program", calls=CALLS, objects=OBJECTS, joints=(), action=action, description=description)
    program = parse_reward_answer(code, OBJECTS, ())
    for number, call in enumerate(program.calls, 1):
        assert ask("verify_reward", description=description, call=call.text) == f"<step>{number}</step>"
    last = ask("verify_primary", action=action, description=description)
    assert answers.parse_step_number(last, len(description), none_allowed=False) == len(description)
    term = program.calls[-1].term
    assert (term.kind, term.subject, term.value) == primary


def test_a_door_that_is_to_be_opened_in_part_is_described_and_rewarded_so():
    objects, joints, action = ("cabinet",), ("cabinet_door",), "open cabinet_door to 81 %"
    fields = {"objects": objects, "joints": joints, "plan": (action,), "observations": (), "action": action}
    text = ask("motion_description", relocates=False, lines=offered_lines(False, True), **fields)
    description = [str(x) for x in answers.parse_description(text, objects, joints, False)]
    assert description == ["palm is close to cabinet", "cabinet_door is 81 % open"]
    code = ask(
        "reward_program",
        calls=CALLS,
        objects=objects,
        joints=joints,
        action=action,
        description=description,
    )
    assert parse_reward_answer(code, objects, joints).calls[-1].term.value == 0.81
    call = "set_joint_fraction_reward(cabinet_door, {})"
    assert ask("verify_reward", description=description, call=call.format("0.81")) == "<step>2</step>"
    assert ask("verify_reward", description=description, call=call.format("1")) == "<step>-1</step>"


def test_a_call_that_serves_no_line_is_found():
    description = ("palm is close to red_cube", "red_cube is close to crate", "door is open")
    for call, line in [
        ("set_obj_z_position_reward(red_cube, 1)", -1),
        ("minimize_l2_distance_reward(palm, crate)", -1),
        ("set_joint_fraction_reward(door, 0)", -1),
        ("set_joint_fraction_reward(door, 1)", 3),
        ("set_joint_fraction_reward(door, 0.8)", 3),
        ("minimize_l2_distance_reward(crate, red_cube)", 2),
        ("nonsense", -1),
    ]:
        assert ask("verify_reward", description=description, call=call) == f"<step>{line}</step>"


def test_the_perceiver_answers_from_facts():
    def answer(question):
        return ask("answer_question", question=question, objects=OBJECTS, facts=FACTS)

    assert answer("Is red_cube in view?").startswith("Yes, red_cube is in view: box of 50")
    assert answer("Is the red cube visible?").startswith("Yes, red_cube is in view")
    assert answer("Is there an apple in view?") == "No, apple is not in view."
    assert answer("What colour is the red cube?") == "red_cube is red."
    assert answer("What colour is the crate?") == "The colour of crate is not known."
    assert answer("What is on the crate?") == "yellow_cube is on crate."
    assert answer("What is on the red cube?") == "Nothing is seen on or in red_cube."
    assert ask("perceive_object", object="red_cube", facts=FACTS) == "yes"
    assert ask("perceive_object", object="apple", facts=FACTS) == "no"


def diagnose(action, facts, measured, phrasing):
    fields = {"action": action, "objects": OBJECTS, "facts": facts, "measured": measured, "phrasing": phrasing}
    return ask("diagnose_failure", **fields)


def test_a_diagnosis_joins_what_the_attempt_says_with_what_is_seen():
    action, measured = "place red_cube on crate", ("yellow_cube is in the way of red_cube.",)
    assert diagnose(action, FACTS, measured, 1) == "yellow_cube is on crate and is in the way."
    assert diagnose(action, FACTS, (), 5) == "yellow_cube is on crate."
    assert diagnose(action, FACTS[:3], measured, 1) == "yellow_cube is in the way of red_cube and crate."
    assert diagnose(action, FACTS[:3], (), 1) == "Nothing is seen in the way of red_cube and crate."


def test_names_are_checked_and_repaired():
    def repaired(sentence):
        fields = {"objects": OBJECTS, "sentence": sentence}
        if not answers.parse_yes_no(ask("verify_names", **fields)):
            return sentence
        return ask("remap_names", **fields)

    assert repaired("The yellow block is in the way.") == "The yellow_cube is in the way."
    assert repaired("blue_crate is full.") == "crate is full."
    assert repaired("The yellow cube is on the crate.") == "The yellow cube is on the crate."
    assert repaired("yellow_cube is on the left side of the crate.") == "yellow_cube is on the left side of the crate."


def test_a_summary_begins_with_what_most_explanations_say():
    kettle = "kettle is in front of door."
    explanations = ("door is shut.", kettle, kettle, "The arm is short.")
    text = ask("summarize_failure", action="open the door", explanations=explanations)
    assert answers.parse_reasons(text) == (kettle, "door is shut.")


@pytest.mark.parametrize(
    ("kind", "sentence"),
    [
        ("blocked_by", "yellow_cube is in the way of red_cube."),
        ("unsafe", "yellow_cube is too close."),
        ("no_candidate", "No motion was found for red_cube."),
        ("locked", "red_cube is locked."),
        ("not_seen", "red_cube is not in view."),
        ("lost_grasp", "The motion itself failed (lost grasp)."),
        ("tracking_error", "The motion itself failed (tracking error)."),
        ("refused_by_robot", "The motion itself failed (refused by robot)."),
        ("not_achieved", "The motion was played, but its result for red_cube is not seen."),
    ],
)
def test_every_cause_has_words_and_speaks_of_no_part_of_the_robot(kind, sentence):
    from control.tasks.failure import FailureCause

    bodies = ("yellow_cube", "panda_link7")
    words = cause_sentences(FailureCause(kind, "red_cube", "so it was", bodies=bodies), OBJECTS)
    assert sentence in words and words[-1] == "so it was."
    assert not any("panda_link7" in line for line in words)


DOORS = (
    "oven: box of 300 x 400 x 300 mm, centre at x 0.700, y 0.200, z 0.150 m",
    "cabinet: box of 300 x 400 x 500 mm, centre at x 0.500, y -0.500, z 0.250 m",
    "oven_door is a door of oven and is closed",
    "cabinet_door is a door of cabinet and is open",
    "the inside of oven is hidden",
)
TOO_CLOSE = (
    "No motion was found for oven_door. 'oven_door' cannot be taken: all grasps come too close to 'cabinet_door'."
)


def test_an_open_door_that_leaves_no_room_is_shut_first_and_what_it_hides_is_not_searched_again():
    objects = ("oven", "cabinet")
    plan = replan("open the oven", (failed("open oven_door", TOO_CLOSE),), facts=DOORS, objects=objects)
    assert plan.steps == ("close cabinet_door", "open oven_door")
    shut = tuple(f.replace("cabinet and is open", "cabinet and is closed") for f in DOORS)
    sought = (*shut, "pear is not in view: no box above the threshold")
    done = ("open cabinet_door", "close cabinet_door")
    attempts = (failed("look for pear", "pear is not in view."),)
    plan = replan("find the pear", attempts, done, facts=sought, objects=objects)
    assert plan.steps == ("open oven_door", "look for pear")


def test_the_door_of_what_a_thing_lies_in_stays_open():
    facts = (
        *DOORS,
        "red_cube: box of 50 x 50 x 50 mm, centre at x 0.500, y -0.500, z 0.200 m",
        "red_cube is in cabinet",
    )
    reason = (
        "No motion was found for red_cube. 'red_cube' cannot be taken: all grasps come too close to 'cabinet_door'."
    )
    attempts = (failed("pick up red_cube", reason),)
    plan = replan("pick up the red cube", attempts, facts=facts, objects=("oven", "cabinet", "red_cube"))
    assert plan.steps == ("pick up red_cube",)


UNNAMED = "unnamed_1: box of 150 x 120 x 350 mm, centre at x 0.450, y 0.100, z 0.175 m; nobody named it"


def test_what_nobody_named_is_moved_out_of_the_way_and_where_that_fails_the_plan_ends_saying_where_it_stands():
    facts, objects = (*FACTS, UNNAMED), (*OBJECTS, "unnamed_1")
    goal = "place the red cube on the crate"
    blocked = failed("place red_cube on crate", "unnamed_1 is in the way of red_cube.")
    plan = replan(goal, (blocked,), facts=facts, objects=objects)
    assert plan.steps == ("move unnamed_1 away from red_cube", "place red_cube on crate")
    in_vain = failed(plan.steps[0], "No motion was found for unnamed_1.")
    plan = replan(goal, (blocked, in_vain), facts=facts, objects=objects)
    assert plan.steps == ()
    assert plan.thought.startswith("something unnamed stands at x 0.45, y 0.10 m (unnamed_1: box of 150 x 120 x 350 mm")
    assert plan.thought.endswith("it could not be moved: take it away, or name it")


def test_one_can_ask_what_is_in_the_way():
    question = {"question": "What is in the way?", "objects": (*OBJECTS, "unnamed_1")}
    answer = ask("answer_question", **question, facts=(*FACTS, UNNAMED))
    assert answer == f"unnamed_1 is in view: {UNNAMED.removeprefix('unnamed_1: ')}."
    assert ask("answer_question", **question, facts=FACTS) == "Nothing is seen that nobody named."
