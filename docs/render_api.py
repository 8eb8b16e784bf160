"""`python docs/render_api.py` writes docs/api.md from the docstrings of `replan.api`; a test compares."""

import ast
import dataclasses
import inspect
import itertools
import re
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from replan import api

PAGE = Path(__file__).with_name("api.md")
SECTIONS = ("Args", "Attributes", "Returns", "Raises")
FUNCTIONS = (
    "run_goal",
    "perceive_recording",
    "validate_motion",
    "certify_motion",
    "write_motion",
    "connect",
    "load_cell",
)
OPTIONS = ("RunOptions", "PerceiveOptions", "ReadingOptions", "ValidateOptions")
OTHERS = (
    "RunReport",
    "PerceiveReport",
    "Validation",
    "Verdict",
    "Certificate",
    "Trajectory",
    "CellClient",
    "CellConfig",
    "ReasonerOptions",
    "PerceptionOptions",
)
EXAMPLES = (
    (
        "Reach a goal in a simulated cell",
        """
        from replan.api import RunOptions, run_goal

        options = RunOptions(goal="place the red cube on the crate", cell="cubes", speed=0.0, video=False)
        report = run_goal(options)
        assert report.reached, report.reason
        print(f"{report.motions} motions in {report.seconds:.1f} s; the record is in {report.folder}")
        """,
    ),
    (
        "Perceive what that run saw",
        """
        from replan.api import PerceiveOptions, perceive_recording

        look = min(report.folder.glob("look_*.npz"))
        wanted = PerceiveOptions(names=("red_cube", "crate"), out=report.folder / "perceived", page=False)
        found = perceive_recording(look, wanted)
        for track in found.tracks:
            print(track.name, track.estimate.position)
        """,
    ),
    (
        "Judge the motion that it sent once more, in the scene that it was planned in",
        """
        from replan.api import ReplanError, ValidateOptions, validate_motion

        motion = min(report.folder.glob("trajectory_*.npz"))
        options = ValidateOptions(motion, cell="cubes", scene=report.folder, look=0, perturbed=6)
        try:
            judged = validate_motion(options)
        except ReplanError as error:
            raise SystemExit(str(error))
        print("passed" if judged.verdict.passed else [check.name for check in judged.verdict.failed_checks])
        """,
    ),
)


def page() -> str:
    """The whole page."""
    parts = [
        "# The Python interface",
        "This page is made from the docstrings by `python docs/render_api.py`.",
        *paragraphs(inspect.getdoc(api) or ""),
        "The program belongs into an environment of its own ([install.md](install.md)); use that environment's Python.",
        "## Examples",
    ]
    for title, code in EXAMPLES:
        parts += [f"{title}:", f"```python\n{textwrap.dedent(code).strip()}\n```"]
    parts += ["## Functions"]
    for name in FUNCTIONS:
        parts += [f"### `{name}`", *described_function(getattr(api, name))]
    parts += ["## Options"]
    for name in OPTIONS:
        parts += [f"### `{name}`", *described_type(getattr(api, name))]
    parts += [
        "## Results and what they consist of",
        "Their docstrings describe every attribute: `help(api.RunReport)`.",
    ]
    parts += ["\n".join(f"- {_first_line(name)}" for name in OTHERS)]
    return "\n\n".join(parts) + "\n"


def described_function(function: Any) -> Iterator[str]:
    """Call and docstring of a function."""
    arguments = []
    for p in inspect.signature(function).parameters.values():
        default = "" if p.default is p.empty else f" = {_default(p.default)}"
        arguments.append(f"{p.name}: {p.annotation}{default}")
    returns = inspect.signature(function).return_annotation
    yield f"```text\n{function.__name__}({', '.join(arguments)}) -> {returns}\n```"
    yield from paragraphs(inspect.getdoc(function) or "")


def described_type(kind: type) -> Iterator[str]:
    """Where a type lives, its docstring, its fields."""
    yield f"`{kind.__module__}.{kind.__qualname__}`"
    text = inspect.getdoc(kind) or ""
    documented = dict(literals(kind))
    yield from paragraphs(text)
    if dataclasses.is_dataclass(kind) and documented:
        yield "\n".join(
            f"- `{f.name}`{_or_nothing(f)}: {documented[f.name]}"
            for f in dataclasses.fields(kind)
            if f.name in documented
        )
    elif dataclasses.is_dataclass(kind):
        defaults = [f"`{f.name}`{_or_nothing(f)}" for f in dataclasses.fields(kind) if _or_nothing(f)]
        if defaults:
            yield "Defaults: " + ", ".join(defaults) + "."


def _first_line(name: str) -> str:
    kind = getattr(api, name)
    return f"`{name}` (`{kind.__module__}`): {(inspect.getdoc(kind) or '').splitlines()[0]}"


def literals(kind: type) -> Iterator[tuple[str, str]]:
    """Texts that stand below fields, of a class and those that it comes from."""
    for cls in reversed(kind.__mro__[:-1]):
        try:
            (node,) = ast.parse(textwrap.dedent(inspect.getsource(cls))).body
        except (OSError, TypeError):
            continue
        body = node.body if isinstance(node, ast.ClassDef) else []
        for field, text in itertools.pairwise(body):
            named = isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
            if named and isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant):
                yield field.target.id, " ".join(str(text.value.value).split())


def paragraphs(text: str) -> Iterator[str]:
    """A docstring as Markdown: its sections become lists."""
    for block in re.split(r"\n\s*\n", text):
        head, _, rest = block.partition("\n")
        if head.rstrip(":") in SECTIONS and head.endswith(":"):
            items: list[str] = []
            for line in textwrap.dedent(rest).splitlines():
                if line.startswith(" ") and items:
                    items[-1] += " " + line.strip()
                else:
                    items.append(line.strip())
            yield f"{head.rstrip(':')}:"
            yield "\n".join(f"- {_item(item)}" for item in items)
        else:
            yield block


def _item(text: str) -> str:
    names, colon, rest = text.partition(": ")
    if not colon or not re.fullmatch(r"[\w., ]+", names):
        return text
    return ", ".join(f"`{n}`" for n in names.split(", ")) + f": {rest}"


def _or_nothing(field: "dataclasses.Field[Any]") -> str:
    if field.default is not dataclasses.MISSING:
        return f" = `{_default(field.default)}`"
    return ""


def _default(value: Any) -> str:
    if isinstance(value, Path):
        return f'Path("{value.as_posix()}")'
    return value.__name__ if callable(value) else repr(value)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
