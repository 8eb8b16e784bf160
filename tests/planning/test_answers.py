"""Answers: each form is parsed strictly, and a fault is told in words that can be sent back."""

import pytest

from planning.language import answers
from planning.language.answers import MalformedAnswerError

PLAN = "<thought>Simple.</thought>\n[start plan]\n> place red_cube on crate\n>touch crate\n[end plan]"
NAMES = ("red_cube", "crate", "kettle")


def test_a_plan_has_a_thought_and_steps():
    plan = answers.parse_plan(PLAN)
    assert plan.thought == "Simple." and plan.steps == ("place red_cube on crate", "touch crate")


def test_an_empty_plan_is_an_answer():
    assert answers.parse_plan("<thought>No way.</thought>[start plan]\n[end plan]").steps == ()


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("", "the answer is empty"),
        ("x" * 30_000, "at most 20000 are read"),
        ("[start plan]\n> a\n[end plan]", "1 to 1 <thought>"),
        ("<thought>a</thought>\n> a", "between [start plan] and [end plan]"),
        ("<thought>a</thought>[start plan]\n1. a\n[end plan]", "must start with '>'"),
        ("<thought>a</thought>[start plan]\n>\n[end plan]", "a line of the plan is empty"),
        ("<thought>a</thought>[start plan]\n" + "> a\n" * 13 + "[end plan]", "at most 12"),
        ("<thought>a</thought>[start plan]\n> " + "a" * 300 + "\n[end plan]", "is too long"),
        ("<thought>cut off [start plan]\n> a\n[end plan]", "a <thought> is not closed"),
        (PLAN + PLAN, "stand once"),
    ],
)
def test_malformed_plans_are_told_their_fault(text, fault):
    with pytest.raises(MalformedAnswerError) as caught:
        answers.parse_plan(text)
    assert fault in str(caught.value)


@pytest.mark.parametrize(("text", "value"), [("yes", True), ("No.", False), (" **Yes**, it is", True), ('"no"', False)])
def test_yes_and_no(text, value):
    assert answers.parse_yes_no(text) is value


@pytest.mark.parametrize("text", ["maybe", "not sure", "I say yes", "nope", "yesterday"])
def test_neither_yes_nor_no(text):
    with pytest.raises(MalformedAnswerError, match="must begin with yes or no"):
        answers.parse_yes_no(text)


def test_step_numbers_are_within_the_lines():
    assert answers.parse_step_number("because\n<step> 2 </step>", 3, none_allowed=False) == 2
    assert answers.parse_step_number("<step>-1</step>", 3, none_allowed=True) is None
    for text, fault in [
        ("<step>4</step>", "there is no line 4; the lines are 1 to 3"),
        ("<step>0</step>", "there is no line 0"),
        ("<step>-1</step>", "there is no line -1"),
        ("2", "exactly one <step>"),
        ("<step>1</step><step>2</step>", "it has 2"),
    ]:
        with pytest.raises(MalformedAnswerError, match=fault):
            answers.parse_step_number(text, 3, none_allowed=False)


def description(*lines: str, relocates=True, joints=()):
    text = "[start of description]\n" + "\n".join(lines) + "\n[end of description]"
    return [str(line) for line in answers.parse_description(text, NAMES, joints, relocates)]


def test_a_description_follows_the_template():
    assert description("1. palm is close to red_cube.", "- red_cube is far from crate") == [
        "palm is close to red_cube",
        "red_cube is far from crate",
    ]
    assert description("palm is close to crate", relocates=False) == ["palm is close to crate"]
    assert description("palm is close to crate", "left_door is open", joints=("left_door",), relocates=False)[1:] == [
        "left_door is open"
    ]


@pytest.mark.parametrize(
    ("lines", "fault"),
    [
        ((), "the description is empty"),
        (("red_cube is close to crate",), "the first line must be 'palm is close to A'"),
        (("palm is close to red_cube",), "no line says where the object ends up"),
        (("palm is close to red_cube", "red_cube flies"), "'red_cube flies' has none of the forms"),
        (("palm is close to banana", "banana is close to crate"), "there is no object 'banana'"),
        (("palm is close to red_cube", "left_door is open"), "there is no joint 'left_door'; there are none"),
        (("palm is close to red_cube", "red_cube is close to red_cube"), "names 'red_cube' twice"),
        (
            ("palm is close to red_cube", "red_cube is close to crate", "red_cube is close to kettle"),
            "'red_cube' is described more than once",
        ),
        (
            ("palm is close to red_cube", "red_cube is close to crate", "red_cube is close to crate"),
            "'red_cube' is described more than once",
        ),
        (
            ("palm is close to red_cube", "red_cube is close to crate", "red_cube is far from kettle"),
            "'red_cube' is described more than once",
        ),
    ],
)
def test_a_description_that_breaks_a_rule_is_told_which(lines, fault):
    with pytest.raises(MalformedAnswerError) as caught:
        description(*lines)
    assert fault in str(caught.value)


def test_an_answer_that_was_cut_off_is_noticed():
    with pytest.raises(MalformedAnswerError, match="seems to be cut off"):
        answers.parse_sentence("The kettle stands in front of the door and keeps it from")
    assert answers.parse_sentence("the kettle") == "the kettle"


def test_a_reason_is_about_objects_and_not_about_the_robot():
    assert answers.parse_reasons("<reason>The kettle is in the way.</reason>") == ("The kettle is in the way.",)
    for text, fault in [
        ("<reason>The robot is already holding the cube.</reason>", "is about the robot"),
        ("<reason>The kettle is", "is not closed"),
        ("The kettle", "1 to 2 <reason>"),
        ("<reason>a</reason>" * 3, "it has 3"),
    ]:
        with pytest.raises(MalformedAnswerError, match=fault):
            answers.parse_reasons(text)


def test_a_question_names_an_object_and_compares_nothing():
    good = "<question>What colour is the red cube?</question>"
    assert answers.parse_questions(good, NAMES) == ("What colour is the red cube?",)
    with pytest.raises(MalformedAnswerError, match=r"compares things \('which'\)"):
        answers.parse_questions("<question>Is it the crate which is red?</question>", NAMES)
    with pytest.raises(MalformedAnswerError, match=r"compares things \('same'\)"):
        answers.parse_questions("<question>Is the crate of the same colour?</question>", NAMES)
    with pytest.raises(MalformedAnswerError, match="names none of"):
        answers.parse_questions("<question>What do you see?</question>", NAMES)


def test_question_types_are_one_word_of_three():
    assert answers.parse_question_type("It is OBJECT_PRESENCE.") == "OBJECT_PRESENCE"
    for text in ("presence", "OBJECT_PRESENCE or NEITHER"):
        with pytest.raises(MalformedAnswerError, match="must be one of OBJECT_PRESENCE, OBJECT_ATTRIBUTE, NEITHER"):
            answers.parse_question_type(text)


def test_completion_is_yes_or_no_with_what_remains():
    assert answers.parse_completion("yes") == (True, None)
    assert answers.parse_completion("no") == (False, None)
    assert answers.parse_completion("No. <Action>open the door</Action>") == (False, "open the door")


def test_votes_about_the_robot_or_about_nothing_do_not_count():
    assert answers.usable_vote("The kettle is in the way.", NAMES) is None
    assert answers.usable_vote("The arm is too short for the kettle.", NAMES) == "it is about the robot"
    assert answers.usable_vote("It is dark.", NAMES) == "it names no object of the scene"
