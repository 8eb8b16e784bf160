"""The rule-based reasoner: deterministic, no network, no privileged knowledge.

It sees a contract's fields and nothing else: names in view, facts of perception in sentences, failed attempts in words.
It answers in the contract's form, so the parsers that serve language models serve it too. Its language of goals is
small (`planning.language.goal_language`); what it does not understand it says.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from control.errors import ReasonerError
from planning.builtin import perceiver as builtin_perceiver
from planning.builtin import planner as builtin_planner
from planning.builtin import plans as builtin_plans
from planning.builtin import verifier as builtin_verifier

_RULES: dict[str, Callable[[Mapping[str, Any]], str]] = {
    "perceive_object": builtin_perceiver.perceive_object,
    "high_level_plan": builtin_plans.make_plan,
    "replan": builtin_plans.make_plan,
    "new_plan": builtin_plans.make_plan,
    "action_kind": builtin_planner.action_kind,
    "needs_relocation": builtin_planner.needs_relocation,
    "motion_description": builtin_planner.motion_description,
    "reward_program": builtin_planner.reward_program,
    "verify_reward": builtin_verifier.verify_reward,
    "verify_primary": builtin_verifier.verify_primary,
    "diagnose_failure": builtin_perceiver.diagnose_failure,
    "verify_names": builtin_verifier.verify_names,
    "remap_names": builtin_verifier.remap_names,
    "summarize_failure": builtin_planner.summarize_failure,
    "perception_questions": builtin_planner.perception_questions,
    "question_type": builtin_planner.question_type,
    "answer_question": builtin_perceiver.answer_question,
    "action_completed": builtin_planner.action_completed,
}


class BuiltinReasoner:
    """Answers every contract by rules."""

    @property
    def name(self) -> str:
        """For reports."""
        return "builtin (rules, no language model)"

    def answer(self, contract: str, prompt: str, fields: Mapping[str, Any], images: Sequence[Any] = ()) -> str:
        """See `planning.reasoners.reasoner.Reasoner`; the prompt's text and the images are not used.

        Raises:
            ReasonerError: No rule for this contract, or an action that the rules do not understand.
        """
        rule = _RULES.get(contract)
        if rule is None:
            raise ReasonerError(f"the builtin reasoner has no rule for '{contract}'; it knows {sorted(_RULES)}")
        return rule(fields)
