"""Reasoners: whatever answers prompts, and the one policy by which they are asked. Needs the standard library only.

A backend turns text (and pictures) into text. Parsing, asking again with a reason, and the record of every try are
done here, once, for all backends.
"""

import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar, runtime_checkable

from control.errors import NoUsableAnswerError, ReasonerError
from planning.language.answers import MalformedAnswerError, UnusableAnswerError
from prompts.contracts import Role, contract, render

T = TypeVar("T")

# What a name of the scene may look like in a prompt: words, never sentences, markup or line breaks.
PLAIN_NAME = re.compile(r"[a-z][a-z0-9]*(?:_[a-z0-9]+)*")
MAX_NAME = 60  # characters; the longest name of the built-in cells has 15
_NAME_FIELDS = ("objects", "joints", "sought", "object")


class Log(Protocol):
    """Receives every event of a run."""

    def __call__(self, event: str, /, **data: Any) -> None:
        """Write one event down; its data are JSON's types, arrays and paths."""
        ...


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
            UnusableAnswerError: There is an answer, but for instance not a whole one; counts as malformed.
            ReasonerError: The backend cannot answer at all.
        """
        ...


@dataclass(frozen=True)
class AnswerUsage:
    """What one answer took.

    Attributes:
        tokens_in: Tokens of the question, pictures included, all requests for this answer together.
        tokens_out: Tokens of the answer.
        cost: In the currency of the prices that the backend was given; 0 without prices.
    """

    tokens_in: int = 0
    tokens_out: int = 0
    cost: float = 0.0


@runtime_checkable
class Metered(Protocol):
    """A backend whose answers take something that is counted."""

    @property
    def usage(self) -> AnswerUsage:
        """Of the last question, answered or not."""
        ...


def usage_of(reasoner: Reasoner) -> AnswerUsage:
    """What the reasoner's last answer took; nothing for one that does not count."""
    return reasoner.usage if isinstance(reasoner, Metered) else AnswerUsage()


TRIES = 3  # of one question, unless it is said otherwise


class Asker:
    """Asks reasoners and parses what they say.

    Args:
        reasoner: Answers everything that no other one is named for.
        log: Gets the events `prompt`, `answer` and `malformed` for every try; `answer` says what it took.
        tries: How often a question may be put in all.
        by_role: Other reasoners for single roles, for instance a vision model as "perceiver".
    """

    def __init__(
        self, reasoner: Reasoner, log: Log, tries: int = TRIES, by_role: Mapping[Role, Reasoner] | None = None
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
            NoUsableAnswerError: No usable answer within the allowed tries.
            ReasonerError: The backend failed, or a name of the scene is not one that may stand in a prompt.
            ContractError: Not the contract's fields.
        """
        _check_names(name, fields)
        reasoner = self._by_role.get(contract(name).role, self._reasoner)
        first_prompt = render(name, fields)
        shown = images if always_show or contract(name).needs_image else ()
        reason = complaint
        for k in range(1, self.tries + 1):
            prompt = first_prompt if reason is None else first_prompt + _again(reason)
            self._log("prompt", contract=name, reasoner=reasoner.name, attempt=k, prompt=prompt, pictures=len(shown))
            try:
                return parse(self._answer(reasoner, name, k, prompt, fields, shown))
            except MalformedAnswerError as error:
                reason = str(error)
                self._log("malformed", contract=name, reasoner=reasoner.name, attempt=k, reason=reason)
        raise NoUsableAnswerError(
            f"{reasoner.name} gave no usable answer to '{name}' in {self.tries} tries; the last fault: {reason}"
        )

    def _answer(
        self, reasoner: Reasoner, name: str, attempt: int, prompt: str, fields: Mapping[str, Any], shown: Sequence[Any]
    ) -> str:
        """One answer, logged with what it took."""
        started = time.monotonic()
        unusable: UnusableAnswerError | None = None
        try:
            answer = reasoner.answer(name, prompt, fields, shown)
        except UnusableAnswerError as error:
            unusable, answer = error, error.text
        usage = usage_of(reasoner)
        self._log(
            "answer",
            contract=name,
            reasoner=reasoner.name,
            attempt=attempt,
            answer=answer,
            unusable=None if unusable is None else str(unusable),
            seconds=round(time.monotonic() - started, 3),
            tokens_in=usage.tokens_in,
            tokens_out=usage.tokens_out,
            cost=usage.cost,
        )
        if unusable is not None:
            raise unusable
        return answer


def _check_names(name: str, fields: Mapping[str, Any]) -> None:
    """Names come from outside: a cell file, a goal, a detector. In a prompt they must not read as instructions."""
    for key in _NAME_FIELDS:
        value = fields.get(key, ())
        for word in (value,) if isinstance(value, str) else value:
            if len(word) > MAX_NAME or not PLAIN_NAME.fullmatch(word):
                raise ReasonerError(
                    f"the name {word[:MAX_NAME]!r} may not stand in the prompt '{name}': names are lower-case words "
                    f"joined by underscores, at most {MAX_NAME} characters, for instance red_cube; rename it where it "
                    "comes from (cell file, goal or detector)"
                )


def _again(reason: str) -> str:
    return f"\nYour last answer could not be used: {reason}.\nAnswer again, in the form that was asked for.\n"
