"""The table of prompt contracts: what is asked, of whom, with which fields, and in which form the answer comes.

Templates lie in `prompts/templates/NAME.j2`. They are text for language models; the rule-based reasoner gets the same
fields and answers in the same forms, so that the same parsers serve both.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

Role = Literal["planner", "perceiver", "verifier"]
AnswerForm = Literal[
    "yes_no",
    "plan",
    "description",
    "reward_code",
    "step",
    "reasons",
    "questions",
    "question_type",
    "completion",
    "sentence",
]

# What reads each form of answer; strict, and what it refuses is asked again with its reason.
PARSERS: Mapping[AnswerForm, str] = {
    "yes_no": "planning.language.answers.parse_yes_no",
    "plan": "planning.language.answers.parse_plan",
    "description": "planning.language.answers.parse_description",
    "reward_code": "planning.language.reward_program.parse_reward_answer",
    "step": "planning.language.answers.parse_step_number",
    "reasons": "planning.language.answers.parse_reasons",
    "questions": "planning.language.answers.parse_questions",
    "question_type": "planning.language.answers.parse_question_type",
    "completion": "planning.language.answers.parse_completion",
    "sentence": "planning.language.answers.parse_sentence",
}

PHRASINGS = 6  # of diagnose_failure: two questions, each in three wordings

TEMPLATES = Path(__file__).parent / "templates"


class ContractError(ValueError):
    """A contract that does not exist, or fields that are not the contract's: a mistake in the program."""


@dataclass(frozen=True)
class Contract:
    """One kind of question.

    Attributes:
        name: Also the name of the template's file.
        role: Which of the three reasoners answers it.
        fields: Names of the values that the template uses, no more and no fewer.
        answer: Form of the answer; `PARSERS` names what reads it.
        needs_image: Whether a model should be shown the latest pictures with it.
    """

    name: str
    role: Role
    fields: tuple[str, ...]
    answer: AnswerForm
    needs_image: bool = False

    @property
    def parser(self) -> str:
        """Dotted name of the function that reads its answers."""
        return PARSERS[self.answer]


_TABLE = (
    # What is in view.
    Contract("perceive_object", "perceiver", ("object", "facts"), "yes_no", needs_image=True),
    # Plans. `replan` and `new_plan` are high_level_plan with what went wrong appended.
    Contract("high_level_plan", "planner", ("objects", "goal", "facts"), "plan"),
    Contract("replan", "planner", ("objects", "goal", "facts", "learnt", "finished", "attempts"), "plan"),
    Contract(
        "new_plan", "planner", ("objects", "goal", "facts", "learnt", "finished", "attempts", "failed_plans"), "plan"
    ),
    # Eyes or hands.
    Contract("action_kind", "planner", ("action",), "yes_no"),
    Contract("needs_relocation", "planner", ("action",), "yes_no"),
    # From a subtask to rewards.
    Contract(
        "motion_description", "planner", ("objects", "joints", "plan", "observations", "action", "relocates", "lines"),
        "description",
    ),
    Contract("reward_program", "planner", ("objects", "joints", "calls", "action", "description"), "reward_code"),
    Contract("verify_reward", "verifier", ("description", "call"), "step"),
    Contract("verify_primary", "verifier", ("action", "description"), "step"),
    # Why it failed.
    Contract(
        "diagnose_failure", "perceiver", ("action", "objects", "facts", "measured", "phrasing"), "sentence",
        needs_image=True,
    ),
    Contract("verify_names", "verifier", ("objects", "sentence"), "yes_no"),
    Contract("remap_names", "verifier", ("objects", "sentence"), "sentence"),
    Contract("summarize_failure", "planner", ("action", "explanations"), "reasons"),
    # Steps that only look.
    Contract("perception_questions", "planner", ("goal", "plan", "action", "objects", "joints", "sought"), "questions"),
    Contract("question_type", "planner", ("question",), "question_type"),
    Contract("answer_question", "perceiver", ("question", "objects", "facts"), "sentence", needs_image=True),
    Contract("action_completed", "planner", ("plan", "action", "observations"), "completion"),
)  # fmt: skip

CONTRACTS: Mapping[str, Contract] = {c.name: c for c in _TABLE}


def contract(name: str) -> Contract:
    """The contract of this name.

    Raises:
        ContractError: There is none.
    """
    try:
        return CONTRACTS[name]
    except KeyError:
        raise ContractError(f"no prompt contract '{name}'; there are {sorted(CONTRACTS)}") from None


def check_fields(name: str, fields: Mapping[str, Any]) -> None:
    """Raise ContractError when a field is missing or not the contract's."""
    wanted = contract(name).fields
    for field in wanted:
        if field not in fields:
            raise ContractError(f"prompt '{name}' lacks field '{field}'; its fields are {list(wanted)}")
    for field in fields:
        if field not in wanted:
            raise ContractError(f"prompt '{name}' has no field '{field}'; its fields are {list(wanted)}")


@lru_cache(maxsize=1)
def _environment():
    import jinja2

    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        undefined=jinja2.StrictUndefined,
        autoescape=False,  # prompts are plain text, not markup
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=False,
    )


def render(name: str, fields: Mapping[str, Any]) -> str:
    """The prompt's text.

    Args:
        name: Of the contract.
        fields: Exactly the contract's fields.

    Raises:
        ContractError: No such contract, or a field is missing or surplus; it names the field.
    """
    check_fields(name, fields)
    return _environment().get_template(f"{name}.j2").render(**fields).strip() + "\n"
