"""docs/architecture.md: tables and picture are of the imports that tests allow; ways go through real modules."""

import importlib.util
import re

from tests.support.documents import PACKAGES, ROOT, exists, table_rows
from tests.test_imports import ARROWS, ROOMS

PAGE = ROOT / "docs" / "architecture.md"
AGAIN = "run '.venv/bin/python docs/architecture/render.py'"


def section(title: str) -> str:
    """A section's text, without its heading."""
    return PAGE.read_text().split(f"\n## {title}\n")[1].split("\n## ")[0]


def rendering():
    """The script that writes tables and picture, as a module."""
    spec = importlib.util.spec_from_file_location("render_rooms", PAGE.parent / "architecture" / "render.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def names(cell: str) -> set[str]:
    return set(re.findall(r"`(\w+)`", cell))


def test_the_table_of_folders_is_what_imports_are_held_to():
    rows = table_rows(section("Folders"))[1:]
    assert {row[0].strip("`"): names(row[2]) for row in rows} == ARROWS, AGAIN


def test_the_table_of_rooms_is_what_imports_are_held_to():
    found: dict[str, dict[str, set[str]]] = {}
    for folder, room, holds, allowed in table_rows(section("Rooms"))[1:]:
        assert len(holds) > 20
        found.setdefault(folder.strip("`"), {})[room.strip("`")] = names(allowed)
    assert found == ROOMS, AGAIN


def test_tables_and_picture_are_as_the_script_writes_them():
    render = rendering()
    assert render.folder_table() in PAGE.read_text() and render.room_table() in PAGE.read_text(), AGAIN
    assert render.PICTURE.read_text() == render.picture(), AGAIN
    shown = re.findall(r">([\w/]+)</text>", render.picture())
    assert {f"{folder}/" for folder in ARROWS} | {room for rooms in ROOMS.values() for room in rooms} <= set(shown)


def test_each_way_goes_through_modules_that_exist():
    for way in ("frame", "goal", "trajectory", "stop"):
        steps = re.findall(r"^\d+\. (.+?)(?=^\d+\. |^$)", section(f"The way of a {way}"), re.DOTALL | re.MULTILINE)
        assert len(steps) >= 8
        for step in steps:
            modules = re.findall(rf"`((?:{'|'.join(PACKAGES)})\.[\w.]+)`", step)
            assert modules, f"the way of a {way} names no module at '{step.strip()}'"
            assert all(exists(module) for module in modules), step
