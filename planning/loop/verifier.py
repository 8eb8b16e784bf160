"""The verifier: checks reward calls against the description, picks the primary one, and repairs names."""

from collections.abc import Sequence
from typing import Protocol

from control.tasks.reward_spec import PALM, RewardSpec
from planning.language.answers import MalformedAnswerError, parse_sentence, parse_step_number, parse_yes_no
from planning.language.description import DescriptionLine
from planning.language.reward_program import RewardCall, build_spec
from planning.reasoners.reasoner import Asker


class UnservedLineError(ValueError):
    """No reward call serves the line that finishes the subtask; the message tells the program's writer so."""


class Checker(Protocol):
    """What is asked of whoever checks programs and names."""

    def make_spec(
        self, action: str, calls: Sequence[RewardCall], description: Sequence[DescriptionLine], relocates: bool
    ) -> RewardSpec:
        """A spec out of checked calls, with exactly one primary term."""
        ...

    def repair_names(self, sentence: str, objects: Sequence[str]) -> str:
        """The sentence with names of objects that are there."""
        ...


class AsWritten:
    """What is left when nobody verifies: programs are taken as they were written.

    Args:
        log: Gets `primary`.
    """

    def __init__(self, log) -> None:
        self._log = log

    def make_spec(
        self, action: str, calls: Sequence[RewardCall], description: Sequence[DescriptionLine], relocates: bool
    ) -> RewardSpec:
        """All calls; primary is the last one that says so, else the last one."""
        said = [k for k, call in enumerate(calls) if call.term.primary]
        chosen = said[-1] if said else len(calls) - 1
        self._log("primary", call=calls[chosen].text, line=None, written_as_primary=[calls[k].text for k in said])
        return build_spec([*calls], chosen)

    def repair_names(self, sentence: str, objects: Sequence[str]) -> str:
        """The sentence as it is."""
        return sentence


class Verifier:
    """Both passes over a reward program, and the check of names.

    Args:
        asker: Asks.
        log: Gets `drop` for every call that serves nothing, and `primary`.
    """

    def __init__(self, asker: Asker, log) -> None:
        self._asker = asker
        self._log = log

    def served_lines(
        self, calls: Sequence[RewardCall], description: Sequence[DescriptionLine]
    ) -> list[tuple[RewardCall, int]]:
        """Pass 1: each call with the number (from 1) of the line that it serves; calls that serve none are dropped."""
        lines = [str(line) for line in description]
        kept = []
        for call in calls:
            number = self._asker.ask(
                "verify_reward",
                {"description": lines, "call": call.text},
                lambda text: parse_step_number(text, len(lines), none_allowed=True),
            )
            if number is None:
                self._log("drop", call=call.text, reason="it serves no line of the description")
            else:
                kept.append((call, number))
        return kept

    def finishing_line(self, action: str, description: Sequence[DescriptionLine], relocates: bool) -> int:
        """Pass 2: the number (from 1) of the line after which the action is done.

        A line about the palm cannot finish an action that moves an object: a motion judged by it would stop before
        the object has moved. Such an answer counts as malformed.
        """
        lines = [str(line) for line in description]

        def parse(text: str) -> int:
            number = parse_step_number(text, len(lines), none_allowed=False)
            assert number is not None  # none is not allowed
            if relocates and description[number - 1].a == PALM:
                raise MalformedAnswerError(
                    f"line {number} ('{lines[number - 1]}') is about the palm, but the action moves an object; "
                    "choose the line that says where the object ends up"
                )
            return number

        return self._asker.ask("verify_primary", {"action": action, "description": lines}, parse)

    def make_spec(
        self, action: str, calls: Sequence[RewardCall], description: Sequence[DescriptionLine], relocates: bool
    ) -> RewardSpec:
        """Both passes: the spec whose primary term serves the finishing line.

        Raises:
            UnservedLineError: No call serves that line.
        """
        served = self.served_lines(calls, description)
        line = self.finishing_line(action, description, relocates)
        serving = [k for k, (_, number) in enumerate(served) if number == line]
        if not serving:
            raise UnservedLineError(
                f"no usable call serves line {line} ('{description[line - 1]}'), which ends the step"
            )
        kept = [call for call, _ in served]
        written = [call.text for call in kept if call.term.primary]
        chosen = kept[serving[-1]].text
        self._log(
            "primary",
            call=chosen,
            line=line,
            written_as_primary=written,
            overruled=bool(written) and chosen not in written,
        )
        return build_spec(kept, serving[-1])

    def repair_names(self, sentence: str, objects: Sequence[str]) -> str:
        """The sentence with names that the scene does not have replaced by the closest ones that it has."""
        fields = {"objects": objects, "sentence": sentence}
        if not self._asker.ask("verify_names", fields, parse_yes_no):
            return sentence
        return self._asker.ask("remap_names", fields, parse_sentence)
