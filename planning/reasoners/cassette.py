"""Cassettes: answers on file, recorded from any reasoner and given again without it. Needs the standard library only.

A cassette is a text file of JSON objects, one a line, in the order of the questions:

    {"contract": "action_kind", "prompt_sha256": "...", "prompt": "...", "reasoner": "...", "answer": "no",
     "tokens_in": 0, "tokens_out": 0, "cost": 0.0, "seconds": 0.01}

with `"unusable": REASON` where the backend itself gave an answer up, and `"error": REASON` in place of an answer where
it failed. A run's own `events.jsonl` is a cassette too: its events `prompt` and `answer` hold the same.
"""

import hashlib
import json
import re
import time
from collections import defaultdict, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from control.errors import ConfigError, ReasonerError
from planning.language.answers import UnusableAnswerError
from planning.reasoners.reasoner import AnswerUsage, Reasoner, usage_of

SHOWN = 60  # characters of two prompts that are shown around their first difference


@dataclass(frozen=True)
class RecordedAnswer:
    """One question and what came of it.

    Attributes:
        contract: Name of the prompt contract.
        prompt: The text that was asked.
        reasoner: Who answered.
        answer: What it said; None when it failed.
        unusable: Why the backend itself gave the answer up, or None.
        error: Why it failed, or None.
    """

    contract: str
    prompt: str
    reasoner: str
    answer: str | None
    unusable: str | None = None
    error: str | None = None


def prompt_hash(prompt: str) -> str:
    """SHA-256 of a prompt's text, in hexadecimal."""
    return hashlib.sha256(prompt.encode()).hexdigest()


class CassetteWriter:
    """A cassette that is being recorded; several reasoners may share it.

    Args:
        path: The file; replaced when it exists.

    Raises:
        ConfigError: It cannot be written.
    """

    def __init__(self, path: Path) -> None:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file: TextIO = path.open("w", encoding="utf-8")
        except OSError as error:
            raise ConfigError(
                f"cannot write the cassette {path}: {error.strerror}; choose another --record-cassette"
            ) from error

    def write(self, **record: Any) -> None:
        """Append one line, at once, so that a run that is killed leaves what it has."""
        self._file.write(json.dumps(record, ensure_ascii=False) + "\n")
        self._file.flush()

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class RecordingReasoner:
    """Passes every question on and writes it down with what came of it.

    Args:
        inner: Answers.
        writer: Gets every question.
    """

    def __init__(self, inner: Reasoner, writer: CassetteWriter) -> None:
        self._inner = inner
        self._writer = writer

    @property
    def name(self) -> str:
        """Of the reasoner that answers."""
        return self._inner.name

    @property
    def usage(self) -> AnswerUsage:
        """See `planning.reasoners.reasoner.Metered`."""
        return usage_of(self._inner)

    def answer(self, contract: str, prompt: str, fields: Mapping[str, Any], images: Sequence[Any] = ()) -> str:
        """See `planning.reasoners.reasoner.Reasoner`."""
        started = time.monotonic()
        result: dict[str, Any] = {}
        try:
            answer = self._inner.answer(contract, prompt, fields, images)
            result["answer"] = answer
            return answer
        except UnusableAnswerError as error:
            result = {"answer": error.text, "unusable": str(error)}
            raise
        except ReasonerError as error:
            result = {"error": str(error)}
            raise
        finally:
            if result:
                self._writer.write(
                    contract=contract,
                    prompt_sha256=prompt_hash(prompt),
                    prompt=prompt,
                    reasoner=self.name,
                    **result,
                    **vars(self.usage),
                    seconds=round(time.monotonic() - started, 3),
                )


class CassetteReasoner:
    """Gives recorded answers again.

    Strictly, the next question must be the next one of the cassette. In any order, a question gets the answers that
    were recorded for the same words (numbers apart: measured positions differ from look to look), in their order; asked
    more often than that, it gets the last one. Once a run has departed from its cassette, no question is answered any
    more, so that what the run makes of a lost answer does not hide where it departed.

    Args:
        path: A cassette, or a run's events.jsonl.
        any_order: Whether questions may come in another order.

    Raises:
        ConfigError: There is no such file, or it holds no answers.
    """

    def __init__(self, path: Path, any_order: bool = False) -> None:
        self._path = path
        self._records = read_cassette(path)
        self._any_order = any_order
        self._next = 0
        self._waiting: dict[tuple[str, str], deque[RecordedAnswer]] = defaultdict(deque)
        for record in self._records:
            self._waiting[record.contract, _words(record.prompt)].append(record)
        self._departed: str | None = None

    @property
    def name(self) -> str:
        """For reports: the file, and who had answered."""
        who = ", ".join(dict.fromkeys(r.reasoner for r in self._records))
        return f"cassette {self._path.name} (recorded: {who})"

    def answer(self, contract: str, prompt: str, fields: Mapping[str, Any], images: Sequence[Any] = ()) -> str:
        """See `planning.reasoners.reasoner.Reasoner`; fields and pictures are not used.

        Raises:
            UnusableAnswerError, ReasonerError: As recorded.
            ReasonerError: The cassette has no answer to this question; says where the run departed from it.
        """
        if self._departed is not None:
            raise ReasonerError(self._departed)
        try:
            record = self._matching(contract, prompt)
        except ReasonerError as error:
            self._departed = str(error)
            raise
        if record.error is not None:
            raise ReasonerError(record.error)
        if record.unusable is not None:
            raise UnusableAnswerError(record.unusable, record.answer or "")
        return record.answer or ""

    def _matching(self, contract: str, prompt: str) -> RecordedAnswer:
        if self._any_order:
            waiting = self._waiting.get((contract, _words(prompt)))
            if not waiting:
                raise ReasonerError(
                    f"the cassette {self._path} has no answer to this question of '{contract}': "
                    f"'{_around(prompt, 0)}'; {self._again()}"
                )
            return waiting.popleft() if len(waiting) > 1 else waiting[0]
        where = f"the run departed from the cassette {self._path} at question {self._next + 1}"
        if self._next == len(self._records):
            raise ReasonerError(f"{where}: it asks '{contract}' and the cassette ends there; {self._again()}")
        record = self._records[self._next]
        if record.contract != contract:
            raise ReasonerError(f"{where}: it asks '{contract}', the cassette has '{record.contract}'; {self._again()}")
        if record.prompt != prompt:
            at = _first_difference(prompt, record.prompt)
            raise ReasonerError(
                f"{where} ('{contract}'): it asks '{_around(prompt, at)}', the cassette has "
                f"'{_around(record.prompt, at)}'; {self._again()}"
            )
        self._next += 1
        return record

    def _again(self) -> str:
        other = "" if self._any_order else ", or let questions come in any order with --cassette-any-order"
        return f"record it again with --record-cassette and the reasoner that it came from{other}"


def read_cassette(path: Path) -> tuple[RecordedAnswer, ...]:
    """The answers of a cassette or of a run's events.jsonl, in order.

    Raises:
        ConfigError: There is no such file, a line is not of the form, or it holds no answers.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not text"
        raise ConfigError(
            f"cannot read the cassette {path}: {reason}; name one made with --record-cassette, or a run's events.jsonl"
        ) from error
    records: list[RecordedAnswer] = []
    asked: dict[str, str] = {}  # of a run's events: the prompt that waits for its answer, by contract
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            entry = json.loads(line)
            if "event" not in entry:
                records.append(_record(entry, entry["prompt"]))
                if prompt_hash(entry["prompt"]) != entry["prompt_sha256"]:
                    raise ConfigError(
                        f"line {number} of the cassette {path} was changed: its prompt is not the one of its hash; "
                        "record it again with --record-cassette"
                    )
            elif entry["event"] == "prompt":
                asked[entry["contract"]] = entry["prompt"]
            elif entry["event"] == "answer":
                records.append(_record(entry, asked.pop(entry["contract"])))
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise ConfigError(
                f"line {number} of the cassette {path} is not of the form ({type(error).__name__}: {error}); name one "
                "made with --record-cassette, or a run's events.jsonl"
            ) from None
    if not records:
        raise ConfigError(f"the cassette {path} holds no answers; make one with --record-cassette")
    return tuple(records)


def _record(entry: Mapping[str, Any], prompt: str) -> RecordedAnswer:
    texts = {key: entry.get(key) for key in ("answer", "unusable", "error")}
    if not all(isinstance(v, str) for v in (entry["contract"], prompt, entry["reasoner"])):
        raise TypeError("contract, prompt and reasoner must be texts")
    if not all(v is None or isinstance(v, str) for v in texts.values()):
        raise TypeError("answer, unusable and error must be texts")
    if texts["answer"] is None and texts["error"] is None:
        raise KeyError("answer")
    return RecordedAnswer(entry["contract"], prompt, entry["reasoner"], **texts)


def _words(prompt: str) -> str:
    """A prompt with every number written alike."""
    return re.sub(r"\d+(?:\.\d+)?", "#", prompt.replace("-", ""))


def _first_difference(a: str, b: str) -> int:
    return next((k for k, (x, y) in enumerate(zip(a, b, strict=False)) if x != y), min(len(a), len(b)))


def _around(text: str, at: int) -> str:
    """A piece of a text around a place, on one line."""
    start = max(0, at - SHOWN // 3)
    return " ".join(text[start : start + SHOWN].split())
