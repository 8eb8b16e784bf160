"""Draws the map of rooms and writes the tables of docs/architecture.md, from the table that the tests hold imports to.

.venv/bin/python docs/architecture/render.py
"""

import ast
import sys
from pathlib import Path
from xml.sax.saxutils import escape

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.test_imports import ARROWS, ROOMS, TRUTH  # noqa: E402

PAGE = ROOT / "docs" / "architecture.md"
PICTURE = ROOT / "docs" / "architecture" / "rooms.svg"
BEGIN, END = "<!-- {}: written by docs/architecture/render.py -->", "<!-- end of {} -->"
LAYERS = (("replan",), ("planning", "prompts"), ("sim_check", "hw_interface"), ("control", "perception"))
WIDTH, PAD, CHIP, GAP, TITLE = 1160, 14, 26, 8, 26  # [px]
LETTER = 7.9  # [px] of one letter at 13 px


def doc_of(package: str) -> str:
    """What a package says that it holds: its docstring's first paragraph, without the sentence about imports."""
    file = ROOT.joinpath(*package.split(".")) / "__init__.py"
    paragraph = (ast.get_docstring(ast.parse(file.read_text())) or "").split("\n\n")[0].replace("\n", " ")
    sentences = [s.strip().rstrip(".") for s in paragraph.split(". ")]
    kept = [s for s in sentences if not s.startswith(("May import", "Imports no", "Imports estimates", "On top"))]
    return ". ".join(kept)


def levels(rooms: dict[str, set[str]]) -> list[list[str]]:
    """Rooms in rows: each row imports rooms of earlier rows only."""
    rows: list[list[str]] = []
    while left := [name for name in rooms if all(name not in row for row in rows)]:
        done = {name for row in rows for name in row}
        rows.append(sorted(name for name in left if rooms[name] <= done))
    return rows


def folder_table() -> str:
    """Every folder: what it holds, and which folders it may import."""
    lines = ["| folder | holds | may import |", "|---|---|---|"]
    for folder, allowed in ARROWS.items():
        lines.append(f"| `{folder}` | {doc_of(folder)} | {', '.join(f'`{a}`' for a in sorted(allowed)) or '–'} |")
    return "\n".join(lines)


def room_table() -> str:
    """Every room: what it holds, and which rooms of its folder it may import."""
    lines = ["| folder | room | holds | may import |", "|---|---|---|---|"]
    for folder, rooms in ROOMS.items():
        for room in (name for row in levels(rooms) for name in row):
            allowed = ", ".join(f"`{name}`" for name in sorted(rooms[room])) or "–"
            lines.append(f"| `{folder}` | `{room}` | {doc_of(f'{folder}.{room}')} | {allowed} |")
    return "\n".join(lines)


def written(text: str, name: str, table: str) -> str:
    """A page's text with one of its tables replaced."""
    begin, end = BEGIN.format(name), END.format(name)
    before, rest = text.split(begin)
    return f"{before}{begin}\n{table}\n{end}{rest.split(end)[1]}"


def picture() -> str:
    """The map as SVG: a band for each layer, rooms in the order of their imports from left to right."""
    parts: list[str] = []
    y = PAD
    for layer in LAYERS:
        width = (WIDTH - 2 * PAD - (len(layer) - 1) * PAD) / len(layer)
        if layer == ("planning", "prompts"):
            widths = [WIDTH - 3 * PAD - 200, 200]
        else:
            widths = [width] * len(layer)
        drawn = [_chips(folder, w) for folder, w in zip(layer, widths, strict=True)]
        height = max(h for _, h in drawn) + TITLE + PAD
        x = float(PAD)
        for folder, w, (chips, _) in zip(layer, widths, drawn, strict=True):
            parts.append(_box(x, y, w, height, "#f4f6f8", "#8896a5"))
            parts.append(_text(x + PAD, y + 19, f"{folder}/", bold=True))
            if not chips:
                parts.append(_text(x + PAD, y + TITLE + 21, "templates, contracts"))
            parts += [_chip(x + cx, y + TITLE + cy, cw, room, truth) for cx, cy, cw, room, truth in chips]
            x += w + PAD
        y += height + 26
        if layer != LAYERS[-1]:
            parts.append(_text(WIDTH / 2, y - 8, "imports ▼ only downwards", colour="#556", middle=True))
    parts.append(_box(PAD, y - 16, WIDTH - 2 * PAD, 34, "#f4f6f8", "#8896a5"))
    parts.append(_text(2 * PAD, y + 6, "replan_base/", bold=True))
    parts.append(
        _text(2 * PAD + 110, y + 6, "release, root of all errors, checks at the start: every folder stands on it")
    )
    y += 44
    parts.append(_chip(PAD, y - 14, 120, "a room", False))
    parts.append(_text(PAD + 132, y + 4, "imports only rooms before it in its folder"))
    parts.append(_chip(PAD + 430, y - 14, 120, "truth", True))
    parts.append(_text(PAD + 562, y + 4, "knows what truly is: only the simulated cell and scorers import it"))
    y += 26
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {y}" width="{WIDTH}" height="{y}"'
    head += ' font-family="sans-serif" font-size="13">'
    return "\n".join([head, '<rect width="100%" height="100%" fill="white"/>', *parts, "</svg>"]) + "\n"


def _chips(folder: str, width: float) -> tuple[list[tuple[float, float, float, str, bool]], float]:
    """Places of a folder's rooms in a box of some width, and their height."""
    places: list[tuple[float, float, float, str, bool]] = []
    x, y = float(PAD), 4.0
    for room in (name for row in levels(ROOMS.get(folder, {})) for name in row):
        w = len(room) * LETTER + 18
        if x + w > width - PAD:
            x, y = float(PAD), y + CHIP + GAP
        places.append((x, y, w, room, f"{folder}.{room}" in TRUTH))
        x += w + GAP
    return places, y + CHIP


def _box(x: float, y: float, w: float, h: float, fill: str, stroke: str, radius: int = 6) -> str:
    where = f'x="{x:.0f}" y="{y:.0f}" width="{w:.0f}" height="{h:.0f}"'
    return f'<rect {where} rx="{radius}" fill="{fill}" stroke="{stroke}"/>'


def _text(x: float, y: float, text: str, bold: bool = False, colour: str = "#1b2733", middle: bool = False) -> str:
    style = (' font-weight="bold"' if bold else "") + (' text-anchor="middle"' if middle else "")
    return f'<text x="{x:.0f}" y="{y:.0f}" fill="{colour}"{style}>{escape(text)}</text>'


def _chip(x: float, y: float, w: float, room: str, truth: bool) -> str:
    fill, stroke = ("#ffe3d6", "#d1622b") if truth else ("#ffffff", "#5b7a99")
    return _box(x, y, w, CHIP, fill, stroke, 4) + _text(x + w / 2, y + 17, room, middle=True)


def main() -> None:
    """Write both."""
    text = written(written(PAGE.read_text(), "folders", folder_table()), "rooms", room_table())
    PAGE.write_text(text)
    PICTURE.write_text(picture())


if __name__ == "__main__":
    main()
