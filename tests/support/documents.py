"""Reads the documentation pages for tests: their text, their code blocks, and what modules and names the code has."""

import ast
import re
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = (
    "benchmarks",
    "control",
    "hw_interface",
    "perception",
    "planning",
    "prompts",
    "replan",
    "replan_base",
    "sim_check",
    "tests",
)


def pages() -> list[Path]:
    """Every Markdown page that speaks of the code as it is; the change log speaks of earlier versions."""
    own = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "findings" / "README.md"]
    return [page for page in [*own, *sorted((ROOT / "docs").rglob("*.md"))] if page.is_file()]


def blocks(page: Path, language: str) -> list[str]:
    """The fenced code blocks of one language on a page, in order."""
    return re.findall(rf"^```{language}\n(.+?)^```", page.read_text(), re.DOTALL | re.MULTILINE)


def table_rows(text: str) -> list[list[str]]:
    """Cells of every row of the Markdown tables in a text, without the rules below the headings."""
    rows = [line for line in text.splitlines() if line.startswith("|")]
    cells = [[cell.strip() for cell in re.split(r"(?<!\\)\|", row.strip("|"))] for row in rows]
    return [row for row in cells if not all(re.fullmatch(r":?-+:?", cell) for cell in row)]


def module_file(name: str) -> Path | None:
    """The file of a module, the `__init__.py` of a package, or None where there is none."""
    path = ROOT.joinpath(*name.split("."))
    if path.with_suffix(".py").is_file():
        return path.with_suffix(".py")
    return path / "__init__.py" if (path / "__init__.py").is_file() else None


def exists(dotted: str) -> bool:
    """Whether a dotted name of our packages is a module, or a name in one, or an attribute of a class in one."""
    parts = dotted.split(".")
    for length in range(len(parts), 0, -1):
        file = module_file(".".join(parts[:length]))
        if file is not None:
            rest = parts[length:]
            return not rest or ".".join(rest[:2]) in names_in(file)
    return False


@cache
def names_in(file: Path) -> set[str]:
    """Names that a file defines or imports at its top (for checkers too), "Class.attribute" of what classes define."""
    names: set[str] = set()
    top = ast.parse(file.read_text()).body
    for node in [*top, *(inner for block in top if isinstance(block, ast.If) for inner in block.body)]:
        for name in _defined(node):
            names.add(name)
        if isinstance(node, ast.ClassDef):
            names |= {f"{node.name}.{name}" for inner in ast.walk(node) for name in _defined(inner)}
    return names


def _defined(node: ast.AST) -> list[str]:
    """Names that one statement defines."""
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        return [node.name]
    if isinstance(node, ast.Assign | ast.AnnAssign):
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        found = [name for target in targets for name in ast.walk(target)]
        return [n.id if isinstance(n, ast.Name) else n.attr for n in found if isinstance(n, ast.Name | ast.Attribute)]
    if isinstance(node, ast.Import | ast.ImportFrom):
        return [alias.asname or alias.name for alias in node.names]
    return []
