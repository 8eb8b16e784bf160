"""The structure of the source tree, read from its text: modules, who imports whom, names that stand twice.

python -m tests.support.structure [ROOT]       # prints the figures of a checkout, this one by default
"""

import ast
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("perception", "control", "hw_interface", "sim_check", "prompts", "planning", "replan")


def modules(root: Path = ROOT) -> dict[str, Path]:
    """Files of the folders by dotted name; a package stands for its `__init__.py`."""
    files = {}
    for file in (file for folder in FOLDERS for file in sorted((root / folder).rglob("*.py"))):
        parts = file.relative_to(root).with_suffix("").parts
        files[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = file
    return files


def imported_modules(file: Path, known: dict[str, Path]) -> set[str]:
    """Modules of the folders that a file imports, wherever in the file it does."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names if alias.name in known}
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                names |= {inner if inner in known else node.module} & set(known)
    return names


def room_of(module: str, known: dict[str, Path]) -> str:
    """The room that a module lies in, as "folder.room", or the module itself where it lies in none."""
    folder, *rest = module.split(".")
    inside = len(rest) > 1 or (rest and known[module].name == "__init__.py")
    return f"{folder}.{rest[0]}" if inside else module


def single_importers(known: dict[str, Path]) -> dict[str, str]:
    """Modules that exactly one other module imports, with that one; packages and programs are left out."""
    importers: dict[str, list[str]] = {name: [] for name in known}
    for name, file in known.items():
        for other in imported_modules(file, known) - {name}:
            importers[other].append(name)
    return {n: by[0] for n, by in importers.items() if len(by) == 1 and known[n].name != "__init__.py"}


def circles(known: dict[str, Path]) -> list[set[str]]:
    """Rooms that import each other in a circle; modules outside of rooms count as rooms of their own."""
    arrows: dict[str, set[str]] = {}
    for name, file in known.items():
        room = room_of(name, known)
        arrows.setdefault(room, set()).update(room_of(other, known) for other in imported_modules(file, known))
    reached = {room: _reached(room, arrows) for room in arrows}
    found: list[set[str]] = []
    for room in arrows:
        circle = {other for other in reached[room] if room in reached[other]}
        if len(circle) > 1 and circle not in found:
            found.append(circle)
    return found


def _reached(start: str, arrows: dict[str, set[str]]) -> set[str]:
    reached: set[str] = set()
    ahead = set(arrows[start])
    while ahead:
        reached |= ahead
        ahead = {further for room in ahead for further in arrows.get(room, set())} - reached
    return reached


def class_names(known: dict[str, Path]) -> Counter[str]:
    """How often each public class name is defined at the top of a module."""
    return Counter(
        node.name
        for file in known.values()
        for node in ast.parse(file.read_text()).body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )


def folder_widths(root: Path = ROOT) -> dict[Path, int]:
    """How many modules lie directly in each folder of sources, tests and benchmarks."""
    files = [file for top in (*FOLDERS, "tests", "benchmarks") for file in (root / top).rglob("*.py")]
    return dict(Counter(file.parent.relative_to(root) for file in files if file.name != "__init__.py"))


def _report(root: Path) -> Iterator[str]:
    known, widths = modules(root), folder_widths(root)
    yield f"{'folder':14}{'files':>7}{'lines':>8}{'rooms':>7}"
    for folder in (*FOLDERS, "tests", "benchmarks"):
        files = list((root / folder).rglob("*.py"))
        rooms = {file.relative_to(root).parts[1] for file in files if len(file.relative_to(root).parts) > 2}
        lines = sum(len(file.read_text().splitlines()) for file in files)
        yield f"{folder:14}{len(files):7}{lines:8}{len(rooms):7}"
    widest = max(widths, key=lambda folder: widths[folder])
    yield f"widest folder: {widest} with {widths[widest]} modules"
    yield f"modules with one importer: {len(single_importers(known))} of {len(known)}"
    yield f"circles between rooms: {len(circles(known))} {[sorted(circle) for circle in circles(known)] or ''}"
    twice = sorted(name for name, count in class_names(known).items() if count > 1)
    yield f"class names used twice: {len(twice)} {', '.join(twice)}"


if __name__ == "__main__":
    print("\n".join(_report(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT)))
