"""Answers as JSON objects, for servers that hold a model to a schema: one small schema for each form of answer.

An object is turned back into the contract's textual form at once, so that the strict parsers of
`planning.language.answers` read every answer, whichever way it came.
"""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from planning.language.answers import MalformedAnswerError, QuestionType
from prompts.contracts import AnswerForm


class StructuredAnswer(BaseModel):
    """Base: unknown and missing keys are refused, and nothing is converted from another type."""

    model_config = ConfigDict(extra="forbid", strict=True)

    HINT: ClassVar[str]  # what goes where, for the model

    def as_text(self) -> str:
        """The answer in its contract's textual form."""
        """In the contract's textual form."""
        raise NotImplementedError


class YesNo(StructuredAnswer):
    """yes_no."""

    HINT: ClassVar[str] = '"answer" is yes or no; "note" is what you would say after it, or empty'

    answer: Literal["yes", "no"]
    note: str

    def as_text(self) -> str:
        """The answer in its contract's textual form."""
        return f"{self.answer} {self.note}".strip()


class PlanObject(StructuredAnswer):
    """plan."""

    HINT: ClassVar[str] = '"thought" is the thought; "steps" are the steps, without marks'

    thought: str
    steps: list[str]

    def as_text(self) -> str:
        """The answer in its contract's textual form."""
        steps = "".join(f"> {_line(step)}\n" for step in self.steps)
        return f"<thought>{_line(self.thought)}</thought>\n[start plan]\n{steps}[end plan]"


class DescriptionObject(StructuredAnswer):
    """description."""

    HINT: ClassVar[str] = '"lines" are the lines of the description'

    lines: list[str]

    def as_text(self) -> str:
        """The answer in its contract's textual form."""
        lines = "".join(f"{_line(line)}\n" for line in self.lines)
        return f"[start of description]\n{lines}[end of description]"


class RewardCalls(StructuredAnswer):
    """reward_code."""

    HINT: ClassVar[str] = '"calls" are the lines of the code block, one call each'

    calls: list[str]

    def as_text(self) -> str:
        """The answer in its contract's textual form."""
        return "```python\n" + "".join(f"{_line(call)}\n" for call in self.calls) + "```"


class StepNumber(StructuredAnswer):
    """step."""

    HINT: ClassVar[str] = '"thought" is one sentence of thought; "step" is the number'

    thought: str
    step: int

    def as_text(self) -> str:
        """The answer in its contract's textual form."""
        return f"<thought>{_line(self.thought)}</thought>\n<step>{self.step}</step>"


class Reasons(StructuredAnswer):
    """reasons."""

    HINT: ClassVar[str] = '"reasons" are the one or two reasons'

    reasons: list[str]

    def as_text(self) -> str:
        """The answer in its contract's textual form."""
        return "\n".join(f"<reason>{_line(r)}</reason>" for r in self.reasons) or "none"


class Questions(StructuredAnswer):
    """questions."""

    HINT: ClassVar[str] = '"questions" are the one or two questions'

    questions: list[str]

    def as_text(self) -> str:
        """The answer in its contract's textual form."""
        return "\n".join(f"<question>{_line(q)}</question>" for q in self.questions) or "none"


class TypeOfQuestion(StructuredAnswer):
    """question_type."""

    HINT: ClassVar[str] = '"type" is the word'

    type: QuestionType

    def as_text(self) -> str:
        """The answer in its contract's textual form."""
        return self.type


class Completion(StructuredAnswer):
    """completion."""

    HINT: ClassVar[str] = '"done" is yes or no; "action" is the one thing to do next, or empty'

    done: Literal["yes", "no"]
    action: str

    def as_text(self) -> str:
        """The answer in its contract's textual form."""
        return self.done if not self.action.strip() else f"{self.done}\n<Action>{_line(self.action)}</Action>"


class Sentence(StructuredAnswer):
    """sentence."""

    HINT: ClassVar[str] = '"sentence" is the answer'

    sentence: str

    def as_text(self) -> str:
        """The answer in its contract's textual form."""
        return self.sentence


OBJECTS: Mapping[AnswerForm, type[StructuredAnswer]] = {
    "yes_no": YesNo,
    "plan": PlanObject,
    "description": DescriptionObject,
    "reward_code": RewardCalls,
    "step": StepNumber,
    "reasons": Reasons,
    "questions": Questions,
    "question_type": TypeOfQuestion,
    "completion": Completion,
    "sentence": Sentence,
}


def response_format(form: AnswerForm) -> dict[str, Any]:
    """What asks a server that speaks the OpenAI protocol for an object of this form."""
    schema = OBJECTS[form].model_json_schema()
    return {"type": "json_schema", "json_schema": {"name": form, "strict": True, "schema": _without_titles(schema)}}


def object_hint(form: AnswerForm) -> str:
    """The sentence that ends a question whose answer is to be an object."""
    return f"\nGive the answer as one JSON object in place of the form above: {OBJECTS[form].HINT}.\n"


def as_answer(text: str, form: AnswerForm) -> str | None:
    """An object's text in the contract's textual form; None when it is no object at all.

    Raises:
        MalformedAnswerError: It begins as an object and is not one of this form; the message says where.
    """
    if not text.lstrip().startswith("{"):
        return None
    try:
        return OBJECTS[form].model_validate_json(text).as_text()
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise MalformedAnswerError(
            f"the JSON object is not of the form that was asked for{f', at {where}' if where else ''}: {first['msg']}; "
            + OBJECTS[form].HINT
        ) from None


def _line(text: str) -> str:
    """On one line, so that a text cannot pretend to be several."""
    return " ".join(text.split())


def _without_titles(schema: Any) -> Any:
    """The schema without the titles and descriptions that pydantic adds and no server needs."""
    if isinstance(schema, dict):
        return {
            k: {n: _without_titles(v) for n, v in value.items()} if k == "properties" else _without_titles(value)
            for k, value in schema.items()
            if k not in ("title", "description")
        }
    if isinstance(schema, Sequence) and not isinstance(schema, str):
        return [_without_titles(v) for v in schema]
    return schema
