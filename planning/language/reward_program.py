"""Reward programs: text of a closed vocabulary of calls, read without ever running it.

The text is parsed to a syntax tree and walked: each statement must be one call of the vocabulary with plain names and
numbers. Anything else (imports, attributes, lambdas, arithmetic, variables, other calls) makes the whole program
refused, with the construct named. A call of the right form whose names or numbers do not fit the scene is dropped, with
its reason; the caller logs every drop.
"""

import ast
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from control.errors import RewardSpecError
from control.tasks.reward_spec import RewardSpec, RewardTerm
from control.tasks.terms.definition import PLACES, TermDefinition
from control.tasks.terms.registry import TERMS
from control.tasks.terms.vocabulary import Vocabulary
from planning.language.answers import MalformedAnswerError, parse_code_block

MAX_PROGRAM = 4000  # characters; a dozen calls need under 1000
MAX_CALLS = 20


RESET, EXECUTE = "reset_reward", "execute_plan"


@dataclass(frozen=True)
class RewardCall:
    """One call that fits the scene.

    Attributes:
        text: As it was written, on one line.
        term: What it means; `primary` as it was written.
    """

    text: str
    term: RewardTerm


@dataclass(frozen=True)
class Drop:
    """One call that was left out, and why."""

    text: str
    reason: str


@dataclass(frozen=True)
class RewardProgram:
    """What a program says.

    Attributes:
        calls: Usable reward calls in order, at least one.
        drops: Calls left out.
        duration: Of execute_plan in [s]; kept for the record, motions take the time that they need.
    """

    calls: tuple[RewardCall, ...]
    drops: tuple[Drop, ...]
    duration: float


def parse_reward_answer(
    text: str, objects: Collection[str], joints: Collection[str], vocabulary: Vocabulary = TERMS
) -> RewardProgram:
    """The program in an answer's code block.

    Raises:
        MalformedAnswerError: See `parse_reward_program`, or there is not exactly one code block.
    """
    return parse_reward_program(parse_code_block(text), objects, joints, vocabulary)


def parse_reward_program(
    program: str, objects: Collection[str], joints: Collection[str], vocabulary: Vocabulary = TERMS
) -> RewardProgram:
    """Read a program.

    Args:
        program: Its text.
        objects: Names of the scene; "palm" and "rest_position" may be used besides.
        joints: Names of joints of furniture.
        vocabulary: The terms whose calls it may make.

    Raises:
        MalformedAnswerError: A construct beyond plain calls of the vocabulary, execute_plan not exactly once at the
            end, or no usable reward call; the message names it.
    """
    if len(program) > MAX_PROGRAM:
        raise MalformedAnswerError(f"the program has {len(program)} characters; at most {MAX_PROGRAM} are read")
    try:
        tree = ast.parse(program)
    except SyntaxError as error:
        raise MalformedAnswerError(f"line {error.lineno} of the program cannot be read: {error.msg}") from None
    except (ValueError, RecursionError, MemoryError):
        raise MalformedAnswerError(
            "the program cannot be read: it is nested too deeply or has odd characters"
        ) from None
    if len(tree.body) > MAX_CALLS:
        raise MalformedAnswerError(f"the program has {len(tree.body)} calls; at most {MAX_CALLS} are allowed")
    known = vocabulary.calls
    calls = [_as_call(statement, (RESET, *known, EXECUTE)) for statement in tree.body]
    names = [name for name, _ in calls]
    if names.count(EXECUTE) != 1 or names[-1] != EXECUTE:
        raise MalformedAnswerError(f"{EXECUTE}() must be called exactly once, as the last call")
    duration = _execute_duration(calls[-1][1])
    kept: list[RewardCall] = []
    drops: list[Drop] = []
    for name, node in calls[:-1]:
        if name == RESET:
            if node.args or node.keywords:
                raise MalformedAnswerError(f"{RESET}() takes no arguments")
            if kept:  # it clears what was said before it
                drops += [Drop(c.text, f"cleared by a later {RESET}()") for c in kept]
                kept = []
            continue
        text = ast.unparse(node)
        read = _read_term(known[name], vocabulary, node, frozenset(objects), frozenset(joints))
        if isinstance(read, str):
            drops.append(Drop(text, read))
        elif any(replace(c.term, primary=False) == replace(read, primary=False) for c in kept):
            drops.append(Drop(text, "said twice"))
        else:
            kept.append(RewardCall(text, read))
    if not kept:
        why = "; ".join(f"{d.text}: {d.reason}" for d in drops) or "it makes none"
        raise MalformedAnswerError(f"no reward call of the program can be used ({why})")
    return RewardProgram(tuple(kept), tuple(drops), duration)


def build_spec(calls: Sequence[RewardCall], primary: int) -> RewardSpec:
    """The reward spec of these calls with the one at index `primary` as the primary one, whatever the program said."""
    return RewardSpec(tuple(replace(c.term, primary=k == primary) for k, c in enumerate(calls)))


def _as_call(statement: ast.stmt, known: tuple[str, ...]) -> tuple[str, ast.Call]:
    where = f"line {statement.lineno}"
    if not isinstance(statement, ast.Expr):
        raise MalformedAnswerError(f"{where}: {_construct(statement)} is not allowed; write one plain call a line")
    node = statement.value
    if not isinstance(node, ast.Call):
        raise MalformedAnswerError(f"{where}: {_construct(node)} is not allowed; write one plain call a line")
    if not isinstance(node.func, ast.Name):
        raise MalformedAnswerError(f"{where}: {_construct(node.func)} is not allowed; call the given names only")
    if node.func.id not in known:
        raise MalformedAnswerError(f"{where}: there is no call '{node.func.id}'; there are {', '.join(known)}")
    for value in (*node.args, *(k.value for k in node.keywords)):
        if _literal(value) is _NOT_LITERAL:
            raise MalformedAnswerError(
                f"{where}: {_construct(value)} is not allowed as an argument of {node.func.id}; "
                "arguments are names and numbers"
            )
    if any(k.arg is None for k in node.keywords):
        raise MalformedAnswerError(f"{where}: ** is not allowed as an argument of {node.func.id}")
    return node.func.id, node


def _construct(node: ast.AST) -> str:
    """A syntax node in words, with the name in it that matters."""
    if isinstance(node, ast.Attribute):
        return f"attribute access ('.{node.attr}')"
    if isinstance(node, (ast.Import, ast.ImportFrom)):
        return f"import of '{node.names[0].name}'"
    if isinstance(node, ast.Call):
        inner = node.func.id if isinstance(node.func, ast.Name) else _construct(node.func)
        return f"a call ('{inner}')"
    if isinstance(node, ast.Name):
        return f"the bare name '{node.id}'"
    return type(node).__name__.lower()


_NOT_LITERAL = object()


def _literal(node: ast.expr) -> object:
    """The string, number or truth value that a node spells out; names count as their own strings."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Constant) and isinstance(node.value, (str, bool, int, float)):
        return node.value
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) and isinstance(node.operand, ast.Constant):
        value = node.operand.value
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            return -value
    return _NOT_LITERAL


def _execute_duration(node: ast.Call) -> float:
    values = [_literal(v) for v in node.args] + [_literal(k.value) for k in node.keywords]
    if len(values) > 1 or any(k.arg != "duration" for k in node.keywords):
        raise MalformedAnswerError(f"{EXECUTE} takes one argument: duration in seconds")
    value = values[0] if values else 2.0
    if isinstance(value, (bool, str)) or not isinstance(value, (int, float)) or not 0 < value <= 60:
        raise MalformedAnswerError(
            f"duration of {EXECUTE} must be more than 0 and at most 60 seconds, not {str(value)[:20]}"
        )
    return float(value)


def _read_term(
    definition: TermDefinition,
    vocabulary: Vocabulary,
    node: ast.Call,
    objects: frozenset[str],
    joints: frozenset[str],
) -> RewardTerm | str:
    """The term of one call, or why it cannot be used."""
    name, wanted = definition.call, definition.number
    order = (*(a.name for a in definition.names), *((wanted.name,) if wanted else ()))
    if len(node.args) > len(order):
        return f"{name} takes {', '.join(order)}"
    given = {order[k]: _literal(v) for k, v in enumerate(node.args)}
    for keyword in node.keywords:
        key = str(keyword.arg)
        if key in given or key not in (*order, "primary_reward"):
            return f"{name} takes {', '.join(order)} and primary_reward; '{key}' is surplus"
        given[key] = _literal(keyword.value)
    # A bare True is spelled as a constant; the words true and false are names to the parser.
    primary = given.pop("primary_reward", False)
    if not isinstance(primary, bool):
        return f"primary_reward is True or False, not {primary!r}"
    words: list[str] = []
    for argument in definition.names:
        value = given.get(argument.name)
        if not isinstance(value, str):
            return f"{argument.name} must be a name"
        valid = joints if argument.kind == "joint" else objects
        if value not in valid and not (argument.kind == "place" and value in PLACES):
            return f"there is no {argument.what} '{value}'; there are {sorted(valid) or 'none'}"
        words.append(value)
    number: float | None = None
    if wanted:
        value = given.get(wanted.name, wanted.default)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            return f"{wanted.name} must be a number"
        if not wanted.low <= value <= wanted.high:
            return f"{wanted.name} must be between {wanted.low:g} and {wanted.high:g}, not {str(value)[:20]}"
        number = float(value)
    try:
        target = words[1] if len(words) > 1 else None
        return RewardTerm(definition.name, words[0], target, number, primary, vocabulary)
    except RewardSpecError as error:
        return str(error)
