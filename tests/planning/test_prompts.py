"""Prompts: one template per contract, with exactly the contract's fields."""

from importlib import import_module

import pytest

from planning.language.memory import FailedAttempt, FailedPlan
from prompts.contracts import CONTRACTS, PHRASINGS, TEMPLATES, ContractError, contract, render

FIELDS = {
    "object": "red_cube",
    "facts": ("red_cube: box of 50 x 50 x 50 mm",),
    "objects": ("red_cube", "crate"),
    "goal": "place the red cube on the crate",
    "learnt": ("left_door is locked",),
    "finished": ("pick up red_cube",),
    "attempts": (FailedAttempt(("place red_cube on crate",), "place red_cube on crate", "It was hard."),),
    "failed_plans": (FailedPlan("Why not", ("touch crate",), "It did nothing."),),
    "action": "place red_cube on crate",
    "joints": ("left_door",),
    "plan": ("place red_cube on crate",),
    "observations": ("Is it there? Yes.",),
    "relocates": True,
    "lines": ("A is close to B",),
    "description": ("palm is close to red_cube",),
    "calls": ("minimize_l2_distance_reward(a, b)\n    brings a and b together",),
    "call": "minimize_l2_distance_reward(palm, red_cube)",
    "measured": ("No motion was found.",),
    "phrasing": 1,
    "sentence": "The block is there.",
    "explanations": ("The crate is full.",),
    "sought": ("apple",),
    "question": "Is the apple in view?",
}


def fields_of(name: str) -> dict:
    return {f: FIELDS[f] for f in contract(name).fields}


@pytest.mark.parametrize("name", sorted(CONTRACTS))
def test_every_contract_renders_and_uses_all_of_its_fields(name):
    text = render(name, fields_of(name))
    assert "{{" not in text and "{%" not in text
    for field in contract(name).fields:
        if field in ("relocates", "phrasing"):
            continue
        value = FIELDS[field]
        sample = value if isinstance(value, str) else value[0]
        words = {
            "attempts": "It was hard.",
            "failed_plans": "It did nothing.",
            "object": "red cube",
        }.get(field, sample)
        assert words in text, f"{name} does not show its field {field}"


@pytest.mark.parametrize("name", sorted(CONTRACTS))
def test_a_missing_or_surplus_field_is_an_error_that_names_it(name):
    fields = fields_of(name)
    for field in fields:
        with pytest.raises(ContractError, match=f"'{name}' lacks field '{field}'"):
            render(name, {k: v for k, v in fields.items() if k != field})
    with pytest.raises(ContractError, match=f"'{name}' has no field 'weather'"):
        render(name, {**fields, "weather": "fine"})


def test_an_unknown_contract_lists_those_that_exist():
    with pytest.raises(ContractError, match=r"no prompt contract 'sing'; there are \['action_completed'"):
        render("sing", {})


def test_there_is_a_contract_for_every_template_and_the_other_way_round():
    templates = {p.stem for p in TEMPLATES.glob("*.j2") if not p.stem.startswith("_")}
    assert templates == set(CONTRACTS)


def test_the_diagnosis_has_six_different_wordings():
    texts = {render("diagnose_failure", fields_of("diagnose_failure") | {"phrasing": k + 1}) for k in range(PHRASINGS)}
    assert PHRASINGS == len(texts) == 6


def test_replanning_shows_the_goal_prompt_with_the_failed_attempts_after_it():
    text = render("replan", fields_of("replan"))
    first = render("high_level_plan", fields_of("high_level_plan")).strip()
    assert text.startswith(first)
    assert 'the step "place red_cube on crate" failed' in text[len(first) :]


def test_text_of_a_goal_is_never_taken_for_template_code():
    text = render("high_level_plan", {"objects": (), "facts": (), "goal": "{{ 7 * 7 }} {% for x in y %}"})
    assert "{{ 7 * 7 }} {% for x in y %}" in text


def test_every_contract_names_the_function_that_reads_its_answers():
    for one in CONTRACTS.values():
        module, _, function = one.parser.rpartition(".")
        assert callable(getattr(import_module(module), function)), one.name


def test_the_table_in_the_documentation_is_the_table_of_contracts():
    text = (TEMPLATES.parents[1] / "docs" / "loop.md").read_text()
    for one in CONTRACTS.values():
        fields = ", ".join(one.fields)
        row = f"| `{one.name}` | {one.role} | {fields} | {one.answer} | `{one.parser.split('.')[-1]}` |"
        assert row in text, row
