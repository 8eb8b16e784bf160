"""README.md and docs/figures.md: commands are those that exist; figures stand in one place with their origin."""

import re
import subprocess

import pytest

from tests.support.documents import ROOT, module_file, pages, table_rows
from tests.support.typed_commands import replan

README = ROOT / "README.md"
FIGURES = ROOT / "docs" / "figures.md"
SCREEN = 45  # lines
SHOWN = re.compile(r"`(?:\.venv/bin/)?replan ([a-z][a-z0-9-]*)(?: ([a-z][a-z0-9-]*))?[^`]*`((?:, `[\w-]+`)*)")
GROUPS = ("robot", "camera", "bench")


def listed(*arguments: str) -> set[str]:
    """Names of the commands that a help text lists."""
    process = replan(*arguments, "--help", cwd=ROOT, COLUMNS="100")
    found = re.findall(r"•\s+([a-z0-9-]+)", process.stdout)
    assert process.returncode == 0 and found, process.stderr
    return set(found)


@pytest.fixture(scope="module")
def commands() -> dict[str, set[str]]:
    """Names under `replan`, key "", and under its groups."""
    return {"": listed()} | {group: listed(group) for group in GROUPS}


def told(text: str) -> dict[str, set[str]]:
    """Commands that a text shows in backticks or code blocks; "`replan bench rc`, `motions`" shows two."""
    found: dict[str, set[str]] = {"": set()} | {group: set() for group in GROUPS}
    for line in text.splitlines():
        for first, second, more in SHOWN.findall(line):
            found[""].add(first)
            if first in GROUPS and second:
                found[first] |= {second, *re.findall(r"`([\w-]+)`", more)}
    return found


def test_the_table_of_commands_is_complete_and_names_nothing_else(commands):
    shown = told("\n".join("|".join(row) for row in table_rows(README.read_text())))
    assert shown == commands


@pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_pages_name_commands_that_exist(page, commands):
    for group, names in told(page.read_text()).items():
        assert names <= commands[group], (
            f"{page.relative_to(ROOT)}: no command 'replan {group}' {names - commands[group]}"
        )


def test_the_readme_has_three_screens_and_no_figures():
    text = README.read_text()
    sections = text.split("\n## ")
    assert len(sections) == 3
    for section in sections:
        assert len(section.splitlines()) <= SCREEN
    prose = re.sub(r"`[^`]*`|\(3\.11 to 3\.13\)|\]\([^)]*\)|\*\*|```sh\n.*?```", "", text, flags=re.DOTALL)
    assert not re.findall(r"\d+ ?(?:%|/|ms\b|s\b|mm\b|of \d)", prose)


def test_every_figure_names_its_command_commit_and_date(commands):
    rows = table_rows(FIGURES.read_text().split("\n## ")[0])[1:]
    assert len(rows) > 20
    sections = {re.sub(r"[^\w -]", "", title).replace(" ", "-").lower() for title in _titles(FIGURES)}
    for what, command, commit, date in rows:
        anchor = re.search(r"\(#([\w-]+)\)", what)
        assert anchor and anchor[1] in sections, what
        assert re.fullmatch(r"[0-9a-f]{7}", commit) and re.fullmatch(r"20\d\d-\d\d-\d\d", date), what
        known = (
            command == "not kept"
            or command.startswith("`make ")
            or ((bench := re.match(r"`replan bench ([\w-]+)", command)) and bench[1] in commands["bench"])
            or command.startswith("`replan run")
            or ((script := re.match(r"`python -m ([\w.]+)", command)) and module_file(script[1]))
        )
        assert known, f"{what}: {command}"


def test_the_commits_of_figures_are_in_the_history_with_their_dates():
    shallow = _git("rev-parse", "--is-shallow-repository")
    if shallow != "false":
        pytest.skip("this copy has no whole history")
    for _, _, commit, date in table_rows(FIGURES.read_text().split("\n## ")[0])[1:]:
        assert _git("show", "-s", "--format=%as", commit) == date, commit


def test_links_to_sections_lead_to_one():
    for page in pages():
        for target, anchor in re.findall(r"\]\(([\w/.-]*)#([\w-]+)\)", page.read_text()):
            other = page.parent / target if target else page
            anchors = {re.sub(r"[^\w -]", "", title).replace(" ", "-").lower() for title in _titles(other)}
            assert anchor in anchors, f"{page.relative_to(ROOT)} links to {target}#{anchor}"


def _titles(page) -> list[str]:
    return re.findall(r"^#+ (.+)$", page.read_text(), re.MULTILINE)


def _git(*arguments: str) -> str:
    process = subprocess.run(["git", *arguments], capture_output=True, text=True, cwd=ROOT, check=False)
    return process.stdout.strip()


def test_what_contributors_are_told_to_make_can_be_made():
    targets = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    shown = set(re.findall(r"^make ([\w-]+)|`make ([\w-]+)", (ROOT / "CONTRIBUTING.md").read_text(), re.MULTILINE))
    assert {first or second for first, second in shown} <= targets
