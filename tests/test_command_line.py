"""What a person meets who types something wrong: one line, the right exit code, and nothing moves."""

import json
import subprocess
import sys

import pytest


def replan(*arguments, cwd, timeout=120):
    """Run the command as a user would; returns the finished process."""
    return subprocess.run(
        [sys.executable, "-m", "replan.main", *arguments], capture_output=True, text=True, cwd=cwd, timeout=timeout
    )


def one_line_reason(process):
    """The line that says why, and a check that no traceback reached the user."""
    assert "Traceback" not in process.stderr
    reasons = [line for line in process.stderr.splitlines() if line.startswith("replan: ")]
    assert len(reasons) == 1
    return reasons[0]


def test_an_empty_goal_is_a_usage_error(tmp_path):
    process = replan("run", "  ", cwd=tmp_path)
    assert process.returncode == 2
    assert "the goal is empty; say what to reach" in one_line_reason(process)


def test_an_unknown_cell_lists_the_built_in_ones(tmp_path):
    process = replan("run", "place the red cube on the crate", "--cell", "kitchen", cwd=tmp_path)
    assert process.returncode == 2
    reason = one_line_reason(process)
    assert "kitchen" in reason
    for name in ("cubes", "cubes-blocked", "fruit-bowl"):
        assert name in reason


def test_a_cell_file_with_an_unknown_key_names_the_key_and_the_file(tmp_path):
    (tmp_path / "mine.yaml").write_text("name: mine\ncolour_of_walls: blue\n")
    process = replan("run", "place the red cube on the crate", "--cell", "mine.yaml", cwd=tmp_path)
    assert process.returncode == 2
    assert "colour_of_walls" in one_line_reason(process)
    assert "mine.yaml" in one_line_reason(process)


def test_no_robot_at_the_named_endpoint_is_said_within_seconds(tmp_path):
    process = replan("run", "place the red cube on the crate", "--robot", "tcp/127.0.0.1:9", cwd=tmp_path, timeout=30)
    assert process.returncode == 1
    assert "tcp/127.0.0.1:9" in one_line_reason(process)


def test_an_error_with_json_is_an_object_on_stdout(tmp_path):
    process = replan("run", "", "--json", cwd=tmp_path)
    assert json.loads(process.stdout)["error"] == "GoalError"


@pytest.mark.parametrize("arguments", [["fly"], ["run"], ["run", "goal", "--speed", "fast"], ["bench", "goals", "--x"]])
def test_wrong_usage_exits_with_two(arguments, tmp_path):
    assert replan(*arguments, cwd=tmp_path).returncode == 2


def test_help_of_every_command_is_shown(tmp_path):
    for command in ("run", "perceive", "robot", "doctor", "bench"):
        process = replan(command, "--help", cwd=tmp_path)
        assert process.returncode == 0
        assert "usage: replan" in process.stdout
