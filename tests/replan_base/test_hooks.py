"""Hooks before a commit run the project's own tools, which need no download."""

import subprocess
import sys
from pathlib import Path

import yaml

from replan_base.packages import ROOT

HOOKS = [h for repo in yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())["repos"] for h in repo["hooks"]]


def test_every_hook_is_a_program_of_the_projects_environment():
    assert {hook["id"] for hook in HOOKS} == {"ruff-check", "ruff-format", "pyright"}
    for hook in HOOKS:
        assert hook["language"] == "system", hook["id"]
        program = hook["entry"].split()[0]
        assert program.startswith(".venv/bin/") and (Path(sys.prefix) / "bin" / Path(program).name).exists(), program


def test_the_configuration_is_valid():
    command = [str(Path(sys.prefix) / "bin" / "pre-commit"), "validate-config", ".pre-commit-config.yaml"]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True, timeout=60)
