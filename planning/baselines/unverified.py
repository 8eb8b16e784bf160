"""From words to a reward spec without a verifier: one description, one program, taken as they are."""

from control.rewards import RewardSpec
from planning.answers import parse_description, parse_yes_no
from planning.reasoner import Asker, Log
from planning.reward_program import build_spec, parse_reward_answer
from planning.subtask import Scope


def unverified_spec(action: str, scope: Scope, asker: Asker, log: Log) -> RewardSpec:
    """The reward spec of an action as it was written.

    The same questions and parsers as the loop's, but no call is dropped for serving nothing, and the primary term is
    the one that the program's writer marked: the last marked one, or the last call when none is.

    Args:
        action: A step, or a whole goal.
        scope: Names and context.
        asker: Of the run.
        log: Gets `description`, `drop` for calls that do not fit the scene, and `reward`.

    Raises:
        ReasonerError: Some answer stayed unusable.
    """
    relocates = asker.ask("needs_relocation", {"action": action}, parse_yes_no)
    named = {"objects": scope.objects, "joints": scope.joints, "action": action}
    lines = asker.ask(
        "motion_description",
        {**named, "plan": scope.plan, "observations": scope.observations, "relocates": relocates},
        lambda text: parse_description(text, scope.objects, scope.joints, relocates),
    )
    log("description", action=action, relocates=relocates, lines=[str(line) for line in lines])
    program = asker.ask(
        "reward_program",
        {**named, "description": [str(line) for line in lines]},
        lambda text: parse_reward_answer(text, scope.objects, scope.joints),
    )
    for drop in program.drops:
        log("drop", call=drop.text, reason=drop.reason)
    marked = [k for k, call in enumerate(program.calls) if call.term.primary]
    spec = build_spec(program.calls, marked[-1] if marked else len(program.calls) - 1)
    log("reward", action=action, spec=spec)
    return spec
