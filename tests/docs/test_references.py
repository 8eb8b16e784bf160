"""Modules, names, files and links that pages, docstrings and comments mention exist."""

import ast
import re
from pathlib import Path

import pytest

from tests.support.documents import PACKAGES, ROOT, blocks, exists, pages

FOLDERS = (*PACKAGES, "docs", "examples", "findings", "scripts")
DOTTED = re.compile(rf"`((?:{'|'.join(PACKAGES)})(?:\.\w+)+)(?:\([^`]*\))?`")
RUN = re.compile(rf"python -m ((?:{'|'.join(PACKAGES)})[\w.]*)")
PATH = re.compile(rf"(?<![\w./-])((?:{'|'.join(FOLDERS)})/[\w./*-]*[\w/*])(?![\w-])")
FILE = re.compile(r"`(\w+\.(?:py|j2))`")
LINK = re.compile(r"\]\(([^)\s]+)\)")
DATA = (".json", ".yaml", ".css", ".mcap", ".toml", ".lock")  # "replan.json" is a file, not a module


ELSEWHERE = {  # files of other programs, and a placeholder
    "control/statesp.py",
    "docs/design.md",
    "examples/examples_common.cpp",
    "prompts/templates/NAME.j2",
}


def sources() -> list[Path]:
    """Every source file."""
    return [file for package in PACKAGES for file in sorted((ROOT / package).rglob("*.py"))]


def spoken(file: Path) -> str:
    """Docstrings and comments of a source file."""
    text = file.read_text()
    nodes = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    docs = [ast.get_docstring(node) or "" for node in ast.walk(ast.parse(text)) if isinstance(node, nodes)]
    return "\n".join([*docs, *re.findall(r"(?<!\S)#.*", text)])


def wrong_references(text: str, base: Path) -> list[str]:
    """What a text names and the repository does not have."""
    dotted = {name for pattern in (DOTTED, RUN) for name in pattern.findall(text) if not name.endswith(DATA)}
    wrong = [name for name in sorted(dotted) if not exists(name.rstrip("."))]
    for path in sorted({found.rstrip("./") for found in PATH.findall(text)} - ELSEWHERE):
        if not any(any(root.glob(path)) if "*" in path else (root / path).exists() for root in (ROOT, base)):
            wrong.append(path)
    known = {file.name for file in (*sources(), *(ROOT / "prompts").rglob("*.j2"), *(ROOT / "docs").rglob("*.py"))}
    return wrong + sorted(set(FILE.findall(text)) - known)


@pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_what_a_page_names_exists(page):
    text = page.read_text()
    wrong = wrong_references(text, page.parent)
    for link in LINK.findall(text):
        target = link.split("#")[0]
        if target and "://" not in target and not (page.parent / target).exists():
            wrong.append(f"link to {link}")
    assert not wrong, f"{page.relative_to(ROOT)} names what is not there: {wrong}"


@pytest.mark.parametrize("package", PACKAGES)
def test_what_docstrings_and_comments_name_exists(package):
    files = [file for file in sources() if file.relative_to(ROOT).parts[0] == package]
    assert files
    wrong = {str(file.relative_to(ROOT)): wrong_references(spoken(file), file.parent) for file in files}
    assert not any(wrong.values()), {file: names for file, names in wrong.items() if names}


@pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_what_a_page_imports_exists(page):
    for block in blocks(page, "python"):
        for node in ast.walk(ast.parse(block)):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] in PACKAGES:
                missing = [a.name for a in node.names if not exists(f"{node.module}.{a.name}")]
                assert not missing, f"{page.relative_to(ROOT)} imports {missing} from {node.module}"


def test_names_that_the_code_does_not_have_are_found():
    text = "`control.retiming.warp`, control/retime.py, `python -m control.gone`, `no_such_file.py`, docs/gone.md"
    assert wrong_references(text, ROOT) == [
        "control.gone",
        "control.retiming.warp",
        "control/retime.py",
        "docs/gone.md",
        "no_such_file.py",
    ]
    good = "`control.retiming.retime`, `perception.frames.RgbdFrame`, `control/safety/limits.py`, `replan.json`"
    assert wrong_references(good, ROOT) == []
