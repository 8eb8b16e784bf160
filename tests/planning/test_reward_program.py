"""Reward programs: a closed vocabulary, read and never run."""

import math
from pathlib import Path

import pytest

from planning.language.answers import MalformedAnswerError
from planning.language.reward_program import build_spec, parse_reward_answer, parse_reward_program

OBJECTS = ("red_cube", "crate")
JOINTS = ("left_door",)


def parse(program: str):
    return parse_reward_program(program, OBJECTS, JOINTS)


def refused(program: str) -> str:
    with pytest.raises(MalformedAnswerError) as caught:
        parse(program)
    return str(caught.value)


def test_every_call_of_the_vocabulary_becomes_its_term():
    program = parse(
        "reset_reward()\n"
        "minimize_l2_distance_reward('palm', red_cube)\n"
        "maximize_l2_distance_reward(red_cube, crate, distance=0.2, primary_reward=True)\n"
        "maximize_l2_distance_reward(crate, red_cube)\n"
        "set_joint_fraction_reward(left_door, 1)\n"
        "set_obj_z_position_reward(red_cube, z=0.3)\n"
        "set_obj_orientation_reward(red_cube, -1.57)\n"
        "execute_plan(duration=3)"
    )
    assert [(c.term.kind, c.term.subject, c.term.target, c.term.value) for c in program.calls] == [
        ("minimize_l2_distance", "palm", "red_cube", None),
        ("maximize_l2_distance", "red_cube", "crate", 0.2),
        ("maximize_l2_distance", "crate", "red_cube", 0.5),
        ("set_joint_fraction", "left_door", None, 1.0),
        ("set_obj_z_position", "red_cube", None, 0.3),
        ("set_obj_orientation", "red_cube", None, -1.57),
    ]
    assert [c.term.primary for c in program.calls] == [False, True, False, False, False, False]
    assert program.duration == 3.0 and program.drops == ()


@pytest.mark.parametrize(
    ("attack", "named"),
    [
        ("__import__('os').system('touch pwned')", "attribute access ('.system')"),
        ("__import__('os')", "there is no call '__import__'"),
        ("eval('1')", "there is no call 'eval'"),
        ("import os", "import of 'os'"),
        ("from os import system", "import of 'system'"),
        ("(lambda: 1)()", "lambda"),
        ("minimize_l2_distance_reward(palm.__class__, red_cube)", "attribute access ('.__class__')"),
        ("minimize_l2_distance_reward(open('x'), red_cube)", "a call ('open')"),
        ("minimize_l2_distance_reward(lambda: 1, red_cube)", "lambda"),
        ("minimize_l2_distance_reward([x for x in ()], red_cube)", "listcomp"),
        ("minimize_l2_distance_reward(f'{1}', red_cube)", "joinedstr"),
        ("minimize_l2_distance_reward(*[palm, red_cube])", "starred"),
        ("minimize_l2_distance_reward(**{'a': palm})", "dict"),
        ("minimize_l2_distance_reward(**names)", "** is not allowed"),
        ("set_obj_z_position_reward(red_cube, 1 / 0)", "binop"),
        ("x = 5", "assign"),
        ("while True:\n    pass", "while"),
        ("def f():\n    pass", "functiondef"),
        ("red_cube", "the bare name 'red_cube'"),
        ("(y := 3)", "namedexpr"),
        ("set_obj_z_position_reward(red_cube, 3j)", "constant"),
        ("set_obj_z_position_reward(red_cube, b'1')", "constant"),
    ],
)
def test_anything_but_plain_calls_is_refused_by_name(attack, named, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    message = refused(f"minimize_l2_distance_reward(palm, red_cube)\n{attack}\nexecute_plan()")
    assert named in message and message.startswith("line 2")
    assert list(Path(tmp_path).iterdir()) == []


@pytest.mark.parametrize(
    "text", ["(" * 3000, "-" * 3500 + "1", "[" * 900 + "]" * 900, "a\0b", "9" * 3900, "x" * 5000, "(" * 80 + ")" * 80]
)
def test_hostile_sizes_are_refused_without_a_crash(text):
    refused(f"{text}\nexecute_plan()")


def test_too_many_calls_are_refused():
    assert "at most 20" in refused("reset_reward()\n" * 30 + "execute_plan()")


@pytest.mark.parametrize(
    "program",
    [
        "minimize_l2_distance_reward(palm, red_cube)",
        "execute_plan()\nminimize_l2_distance_reward(palm, red_cube)",
        "minimize_l2_distance_reward(palm, red_cube)\nexecute_plan()\nexecute_plan()",
        "",
    ],
)
def test_execution_comes_exactly_once_and_last(program):
    if program:
        assert "execute_plan() must be called exactly once, as the last call" in refused(program)
    else:
        with pytest.raises(MalformedAnswerError):
            parse(program)


@pytest.mark.parametrize(
    ("call", "reason"),
    [
        (
            "minimize_l2_distance_reward(palm, blue_cube)",
            "no object 'blue_cube'; there are ['crate', 'red_cube']",
        ),
        ("set_joint_fraction_reward(right_door, 1)", "there is no joint 'right_door'; there are ['left_door']"),
        ("set_joint_fraction_reward(left_door, 1.5)", "fraction must be between 0 and 1, not 1.5"),
        ("set_joint_fraction_reward(left_door)", "fraction must be a number"),
        ("set_obj_z_position_reward(red_cube, 1e400)", "z must be between 0 and 2, not inf"),
        ("set_obj_z_position_reward(red_cube, True)", "z must be a number"),
        ("set_obj_z_position_reward(palm, 0.2)", "there is no object 'palm'"),
        ("maximize_l2_distance_reward(red_cube, crate, distance=-1)", "distance must be between 0.01 and 2, not -1"),
        ("minimize_l2_distance_reward(red_cube, red_cube)", "given 'red_cube' twice"),
        ("minimize_l2_distance_reward(red_cube)", "b must be a name"),
        ("minimize_l2_distance_reward(red_cube, 3)", "b must be a name"),
        ("minimize_l2_distance_reward(red_cube, crate, weight=3)", "'weight' is surplus"),
        ("minimize_l2_distance_reward(red_cube, crate, primary_reward=1)", "primary_reward is True or False, not 1"),
        ("minimize_l2_distance_reward(palm, crate)", "said twice"),
    ],
)
def test_a_call_that_does_not_fit_the_scene_is_dropped_with_its_reason(call, reason):
    program = parse(f"minimize_l2_distance_reward(palm, crate)\n{call}\nexecute_plan()")
    assert len(program.calls) == 1
    assert reason in program.drops[0].reason
    assert program.drops[0].text.startswith(call.split("(")[0])


def test_a_program_whose_calls_are_all_dropped_is_refused_with_every_reason():
    message = refused("minimize_l2_distance_reward(palm, x)\nset_obj_z_position_reward(y, 1)\nexecute_plan()")
    assert "no object 'x'" in message and "no object 'y'" in message


def test_a_later_reset_clears_what_came_before_by_name():
    program = parse(
        "minimize_l2_distance_reward(palm, crate)\nreset_reward()\n"
        "minimize_l2_distance_reward(palm, red_cube)\nexecute_plan()"
    )
    assert [c.term.target for c in program.calls] == ["red_cube"]
    assert program.drops[0].reason == "cleared by a later reset_reward()"


def test_the_chosen_term_alone_is_primary_whatever_the_program_said():
    program = parse(
        "minimize_l2_distance_reward(palm, red_cube, primary_reward=True)\n"
        "minimize_l2_distance_reward(red_cube, crate)\nexecute_plan()"
    )
    spec = build_spec(program.calls, 1)
    assert [t.primary for t in spec.terms] == [False, True]
    assert spec.primary.subject == "red_cube"


def test_the_answer_must_hold_one_code_block():
    good = "```python\nminimize_l2_distance_reward(palm, red_cube)\nexecute_plan()\n```"
    assert len(parse_reward_answer(f"Here it is:\n{good}", OBJECTS, JOINTS).calls) == 1
    for bad in ("execute_plan()", good + "\n" + good, good[:-3]):
        with pytest.raises(MalformedAnswerError, match="one code block"):
            parse_reward_answer(bad, OBJECTS, JOINTS)


def test_angles_reach_a_full_turn_both_ways():
    program = parse(f"set_obj_orientation_reward(red_cube, {-2 * math.pi})\nexecute_plan()")
    assert program.calls[0].term.value == pytest.approx(-2 * math.pi)
