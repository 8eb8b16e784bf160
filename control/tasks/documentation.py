"""The reward terms as docs/reward-terms.md shows them: `python -m control.tasks.documentation` prints them."""

from control.tasks.terms.definition import ArgumentKind, TermDefinition
from control.tasks.terms.registry import TERMS
from control.tasks.terms.vocabulary import Vocabulary

_KINDS: dict[ArgumentKind, str] = {
    "object": "an object",
    "joint": "a joint of furniture",
    "place": "an object, `palm` or `rest_position`",
}


def as_markdown(vocabulary: Vocabulary) -> str:
    """A table of all calls, then a section for each term."""
    lines = ["| call of a reward program | what the hand does |", "|---|---|"]
    lines += [f"| `{d.signature}` | {d.hand} |" for d in vocabulary.definitions]
    return "\n".join(lines) + "\n\n" + "\n\n".join(_section(d) for d in vocabulary.definitions)


def _section(definition: TermDefinition) -> str:
    return "\n".join(
        [
            f"### {definition.name}",
            f"- Arguments: {_arguments(definition)}.",
            f"- Met when {definition.met}.",
            f"- Residual along a motion: {definition.cost}.",
            f"- Cannot be met beside: {definition.conflicts}.",
        ]
    )


def _arguments(definition: TermDefinition) -> str:
    words = [f"`{a.name}` {_KINDS[a.kind]}" for a in definition.names]
    number = definition.number
    if number is not None:
        default = "" if number.default is None else f", {number.default:g} where it is left out"
        bounds = f"from {number.low:g} to {number.high:g}{number.spelled_unit}"
        words.append(f"`{number.name}` the {number.quantity} {bounds}{default}")
    return "; ".join(words)


if __name__ == "__main__":
    print(as_markdown(TERMS))
