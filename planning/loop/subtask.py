"""From one step of a plan to a reward spec: description, program, both passes of the verifier."""

from collections.abc import Sequence
from dataclasses import dataclass

from control.errors import ReasonerError
from control.tasks.reward_spec import RewardSpec
from control.tasks.terms.registry import TERMS
from planning.language.answers import parse_description, parse_yes_no
from planning.language.description import offered_lines
from planning.language.reward_program import parse_reward_answer
from planning.loop.verifier import Checker, UnservedLineError
from planning.reasoners.reasoner import Asker


@dataclass(frozen=True)
class Scope:
    """What a step may name and should know.

    Attributes:
        objects: Names in view.
        joints: Joints of furniture.
        plan: All steps of the plan that the step is part of.
        observations: Questions with their answers so far.
    """

    objects: tuple[str, ...]
    joints: tuple[str, ...]
    plan: tuple[str, ...]
    observations: tuple[str, ...]


def spec_for(action: str, scope: Scope, asker: Asker, verifier: Checker, log) -> RewardSpec:
    """The reward spec of one motion step.

    Args:
        action: The step.
        scope: Names and context.
        asker, verifier: Of the run.
        log: Gets `description`, `drop` for every call left out, and `reward`.

    Raises:
        ReasonerError: Some answer stayed unusable.
    """
    relocates = asker.ask("needs_relocation", {"action": action}, parse_yes_no)
    fields = {
        "objects": scope.objects,
        "joints": scope.joints,
        "plan": scope.plan,
        "observations": scope.observations,
        "action": action,
        "relocates": relocates,
        "lines": offered_lines(relocates, bool(scope.joints)),
    }
    lines = asker.ask(
        "motion_description", fields, lambda text: parse_description(text, scope.objects, scope.joints, relocates)
    )
    log("description", action=action, relocates=relocates, lines=[str(line) for line in lines])
    return _program(action, scope, lines, relocates, asker, verifier, log)


def _program(action: str, scope: Scope, lines: Sequence, relocates: bool, asker: Asker, verifier: Checker, log):
    fields = {
        "objects": scope.objects,
        "joints": scope.joints,
        "calls": TERMS.prompt_lines,
        "action": action,
        "description": [str(line) for line in lines],
    }
    complaint: str | None = None
    # A program can be well-formed and yet miss the line that matters, which shows only after both passes.
    for _ in range(asker.tries):
        program = asker.ask(
            "reward_program", fields, lambda text: parse_reward_answer(text, scope.objects, scope.joints),
            complaint=complaint,
        )  # fmt: skip
        for drop in program.drops:
            log("drop", call=drop.text, reason=drop.reason)
        try:
            spec = verifier.make_spec(action, program.calls, lines, relocates)
        except UnservedLineError as error:
            complaint = str(error)
            if program.drops:
                complaint += "; left out were " + ", ".join(f"{d.text} ({d.reason})" for d in program.drops)
            log("unserved", action=action, reason=complaint)
            continue
        log("reward", action=action, spec=spec)
        return spec
    raise ReasonerError(f"no reward program for '{action}' in {asker.tries} tries; the last fault: {complaint}")
