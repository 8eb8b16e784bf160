"""What language models took in a run, counted from its events. Needs the standard library only."""

from dataclasses import dataclass
from typing import Any

from planning.reasoners.reasoner import Log


@dataclass
class Usage:
    """A sum over answers.

    Attributes:
        questions: Answers asked for, repeated ones included.
        malformed: Answers that could not be used.
        tokens_in, tokens_out: As backends count them.
        cost: In the currency of the prices that were given.
        seconds: Wall time spent waiting for answers.
    """

    questions: int = 0
    malformed: int = 0
    tokens_in: int = 0
    tokens_out: int = 0
    cost: float = 0.0
    seconds: float = 0.0

    def add(self, other: "Usage") -> None:
        """Add another sum to this one."""
        self.questions += other.questions
        self.malformed += other.malformed
        self.tokens_in += other.tokens_in
        self.tokens_out += other.tokens_out
        self.cost += other.cost
        self.seconds += other.seconds


class UsageLog:
    """A log that counts what passes through it: the events `answer` and `malformed` of `reasoner.Asker`.

    Args:
        log: Gets every event on.

    Attributes:
        counts: Sums by (name of the reasoner, contract), in the order of their first question.
    """

    def __init__(self, log: Log) -> None:
        self._log = log
        self.counts: dict[tuple[str, str], Usage] = {}

    def __call__(self, event: str, /, **data: Any) -> None:
        """Count an event and pass it on."""
        if event in ("answer", "malformed"):
            usage = self.counts.setdefault((data["reasoner"], data["contract"]), Usage())
            if event == "malformed":
                usage.malformed += 1
            else:
                taken = {key: data[key] for key in ("tokens_in", "tokens_out", "cost", "seconds")}
                usage.add(Usage(questions=1, **taken))
        self._log(event, **data)

    def total(self) -> Usage:
        """The sum over everything."""
        total = Usage()
        for usage in self.counts.values():
            total.add(usage)
        return total

    def as_rows(self) -> list[dict[str, Any]]:
        """One object per reasoner and contract, for the record."""
        return [
            {"reasoner": reasoner, "contract": contract, **vars(usage), "seconds": round(usage.seconds, 3)}
            for (reasoner, contract), usage in self.counts.items()
        ]
