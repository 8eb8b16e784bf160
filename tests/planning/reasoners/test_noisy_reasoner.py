"""Mistakes on purpose: plausible, seeded, logged, and none of them moves the wrong thing without being noticed."""

from typing import get_args

import numpy as np
import pytest

from control.errors import ConfigError, StackError
from planning.builtin.reasoner import BuiltinReasoner
from planning.language import answers
from planning.language.reward_program import parse_reward_answer
from planning.loop.loop import run_loop
from planning.reasoners.noisy import MAKERS, NoisyReasoner
from planning.reasoners.options import Mistake, NoiseOptions
from prompts.contracts import CONTRACTS
from tests.support.models.run_contexts import context_of
from tests.support.models.symbolic_world import Journal, World

NAMES = ("crate", "red_cube", "yellow_cube")
PLAN = "<thought>So.</thought>\n[start plan]\n> place red_cube on crate\n> touch crate\n> find crate\n[end plan]"
DESCRIPTION = "[start of description]\npalm is close to red_cube\nred_cube is at height 0.25\n[end of description]"
CODE = (
    "```python\nreset_reward()\nminimize_l2_distance_reward(palm, red_cube)\n"
    "maximize_l2_distance_reward(red_cube, crate, distance=0.2, primary_reward=True)\nexecute_plan(duration=2)\n```"
)


class Fixed:
    name = "fixed"

    def __init__(self, answer):
        self.text = answer

    def answer(self, contract, prompt, fields, images=()):
        return self.text


def spoiled(contract, answer, mistake, seed=0, **fields):
    """One answer with one mistake; returns it and the logged event."""
    log = Journal()
    options = NoiseOptions(1.0, (mistake,))
    noisy = NoisyReasoner(Fixed(answer), options, np.random.default_rng(seed), log)
    text = noisy.answer(contract, "?", {"objects": NAMES, **fields})
    return text, (log.of("noise") or [None])[0]


def test_another_name_stands_in_a_plan_that_is_still_one():
    text, event = spoiled("high_level_plan", PLAN, "other_name")
    plan = answers.parse_plan(text)
    assert len(plan.steps) == 3 and text != PLAN and "yellow_cube" in text
    assert event and event["contract"] == "high_level_plan" and event["mistake"] == "other_name"
    assert event["done"].endswith("replaced by yellow_cube") and event["answer"] == PLAN and event["spoiled"] == text


def test_steps_are_lost_or_swapped():
    for seed in range(5):
        assert len(answers.parse_plan(spoiled("replan", PLAN, "line_dropped", seed)[0]).steps) == 2
        swapped = answers.parse_plan(spoiled("replan", PLAN, "steps_swapped", seed)[0]).steps
        assert swapped != answers.parse_plan(PLAN).steps and set(swapped) == set(answers.parse_plan(PLAN).steps)


def test_yes_becomes_no_and_one_word_another():
    assert spoiled("action_kind", "yes", "flipped")[0] == "no"
    assert spoiled("action_completed", "No. <Action>lift it</Action>", "flipped")[0] == "yes"
    assert answers.parse_question_type(spoiled("question_type", "NEITHER", "flipped")[0]) != "NEITHER"


def test_a_wrong_line_is_one_that_there_is():
    fields = {"description": ["a", "b", "c"]}
    for seed in range(10):
        text, _ = spoiled("verify_primary", "<thought>x</thought>\n<step>2</step>", "wrong_number", seed, **fields)
        assert answers.parse_step_number(text, 3, none_allowed=False) in (1, 3)
        text, _ = spoiled("verify_reward", "<step>2</step>", "wrong_number", seed, call="x()", **fields)
        assert answers.parse_step_number(text, 3, none_allowed=True) in (1, 3, None)


def test_reward_programs_stay_readable_and_say_something_else():
    read = lambda text: [c.term for c in parse_reward_answer(text, NAMES, ()).calls]  # noqa: E731
    right = read(CODE)
    moved = read(spoiled("reward_program", CODE, "moved_primary")[0])
    assert [t.primary for t in right] == [False, True] and [t.primary for t in moved] == [True, False]
    extra = read(spoiled("reward_program", CODE, "extra_call")[0])
    assert len(extra) == 3 and extra[:2] == right
    assert len(read(spoiled("reward_program", CODE, "line_dropped")[0])) == 1
    changed = read(spoiled("reward_program", CODE, "changed_number")[0])
    assert changed[1].value in (pytest.approx(0.6), pytest.approx(0.0667))
    other = read(spoiled("reward_program", CODE, "other_name")[0])
    assert [t.names for t in other] != [t.names for t in right]


def test_a_joints_fraction_is_turned_round():
    code = "```python\nset_joint_fraction_reward(lid, 1.0, primary_reward=True)\nexecute_plan()\n```"
    text, _ = spoiled("reward_program", code, "changed_number")
    assert parse_reward_answer(text, NAMES, ("lid",)).calls[0].term.value == 0.0


def test_a_height_changes():
    lines = answers.parse_description(spoiled("motion_description", DESCRIPTION, "changed_number")[0], NAMES, (), True)
    assert lines[1].value in (0.75, 0.0833)


def test_an_answer_that_offers_nothing_to_spoil_is_left_alone_and_not_logged():
    text, event = spoiled("high_level_plan", PLAN, "flipped")
    assert text == PLAN and event is None
    text, event = spoiled("answer_question", "It is dark.", "other_name")
    assert text == "It is dark." and event is None


def test_every_form_can_be_spoiled_and_every_mistake_occurs():
    assert set(MAKERS) == {c.answer for c in CONTRACTS.values()}
    assert {m for makers in MAKERS.values() for m in makers} == set(get_args(Mistake))


def test_the_share_is_kept_and_the_seed_decides():
    def run(seed):
        log = Journal()
        noisy = NoisyReasoner(Fixed("yes"), NoiseOptions(0.2), np.random.default_rng(seed), log)
        return [noisy.answer("action_kind", "?", {"action": "look"}) for _ in range(1000)], len(log.events)

    texts, count = run(1)
    assert 160 < count < 240  # three standard deviations of 1000 draws at 0.2 are 38
    assert sum(t != "yes" for t in texts) == count
    assert run(1) == (texts, count) and run(2)[0] != texts


def test_only_the_roles_that_were_named_make_mistakes():
    log = Journal()
    noisy = NoisyReasoner(Fixed("yes"), NoiseOptions(1.0, roles=("planner",)), np.random.default_rng(0), log)
    assert noisy.answer("verify_names", "?", {}) == "yes" and log.events == []
    assert noisy.answer("action_kind", "?", {}) != "yes"
    assert noisy.name == "fixed with 100 % of the answers spoiled"


def test_options_out_of_range_are_refused():
    with pytest.raises(ConfigError, match="--answer-noise is a share of the answers, 0 to 1, not 1"):
        NoiseOptions(1.5)
    with pytest.raises(ConfigError, match="there is no mistake 'typo'; there are dropped, other_name"):
        NoiseOptions(0.1, ("typo",))  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="there is no role 'cook'; there are planner, perceiver, verifier"):
        NoiseOptions(0.1, roles=("cook",))  # type: ignore[arg-type]


def test_runs_with_spoiled_answers_end_in_words_and_say_what_is_seen():
    reached = 0
    for seed in range(60):
        world = World({"crate": "table", "red_cube": "table", "yellow_cube": "crate"}, frozenset({"crate"}))
        log = Journal()
        noisy = NoisyReasoner(BuiltinReasoner(), NoiseOptions(0.4), np.random.default_rng(seed), log)
        try:
            result = run_loop(context_of("place the red cube on the crate", world, reasoner=noisy, log=log))
        except StackError:
            continue
        reached += result.reached
        for spec in world.specs:
            assert set(spec.primary.names) <= {*NAMES, "palm", "rest_position"}
    assert 10 < reached < 60  # some mistakes cost the goal, most runs survive theirs
