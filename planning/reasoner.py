"""Reasoners: whatever answers prompts, and the one policy by which they are asked. Needs the standard library only.

A backend turns text (and pictures) into text. Parsing, asking again with a reason, and the record of every try are
done here, once, for all backends.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol, TypeVar

from control.errors import ReasonerError
from planning.answers import MalformedAnswerError
from prompts.contracts import Role, contract, render

T = TypeVar("T")


class Log(Protocol):
    """Receives every event of a run."""

    def __call__(self, event: str, /, **data: Any) -> None: ...


class Reasoner(Protocol):
    """One backend."""

    @property
    def name(self) -> str:
        """For reports: what it is, plainly named."""
        ...

    def answer(self, contract: str, prompt: str, fields: Mapping[str, Any], images: Sequence[Any] = ()) -> str:
        """Answer one prompt.

        Args:
            contract: Name of the prompt contract.
            prompt: The text to answer; when a former answer was malformed, it ends with the reason.
            fields: The contract's fields, for backends that work on them instead of the text.
            images: RGB pictures, uint8, shape (height, width, 3); only for contracts that need them.

        Returns:
            The answer's text; it is parsed strictly and asked for again when malformed.

        Raises:
            ReasonerError: The backend cannot answer at all.
        """
        ...


class Asker:
    """Asks reasoners and parses what they say.

    Args:
        reasoner: Answers everything that no other one is named for.
        log: Gets the events `prompt`, `answer` and `malformed` for every try.
        tries: How often a question may be put in all.
        by_role: Other reasoners for single roles, for instance a vision model as "perceiver".
    """

    def __init__(
        self, reasoner: Reasoner, log: Log, tries: int = 3, by_role: Mapping[Role, Reasoner] | None = None
    ) -> None:
        if tries < 1:
            raise ValueError(f"tries must be at least 1, not {tries}")
        self._reasoner = reasoner
        self._by_role = dict(by_role or {})
        self._log = log
        self.tries = tries

    def ask(
        self,
        name: str,
        fields: Mapping[str, Any],
        parse: Callable[[str], T],
        images: Sequence[Any] = (),
        complaint: str | None = None,
        always_show: bool = False,
    ) -> T:
        """Ask until the answer has its form.

        Args:
            name: Of the contract.
            fields: Its fields.
            parse: Reads the answer; raises MalformedAnswerError with a reason that is sent back.
            images: Latest pictures; withheld from contracts that need none.
            complaint: Why an earlier answer, well-formed by itself, could not be used.
            always_show: Whether the pictures go along even where the contract needs none.

        Raises:
            ReasonerError: No usable answer within the allowed tries, or the backend failed.
            ContractError: Not the contract's fields.
        """
        reasoner = self._by_role.get(contract(name).role, self._reasoner)
        first_prompt = render(name, fields)
        shown = images if always_show or contract(name).needs_image else ()
        reason = complaint
        for k in range(1, self.tries + 1):
            prompt = first_prompt if reason is None else first_prompt + _again(reason)
            self._log("prompt", contract=name, reasoner=reasoner.name, attempt=k, prompt=prompt, pictures=len(shown))
            answer = reasoner.answer(name, prompt, fields, shown)
            self._log("answer", contract=name, reasoner=reasoner.name, attempt=k, answer=answer)
            try:
                return parse(answer)
            except MalformedAnswerError as error:
                reason = str(error)
                self._log("malformed", contract=name, reasoner=reasoner.name, attempt=k, reason=reason)
        raise ReasonerError(
            f"{reasoner.name} gave no usable answer to '{name}' in {self.tries} tries; the last fault: {reason}"
        )


def _again(reason: str) -> str:
    return f"\nYour last answer could not be used: {reason}.\nAnswer again, in the form that was asked for.\n"
