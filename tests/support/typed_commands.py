"""Commands as a user types them, in processes of their own."""

import os
import subprocess
import sys


def replan(*arguments, cwd, **environment):
    """Run the command as a user would; returns the finished process."""
    command = [sys.executable, "-m", "replan.main", *arguments]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, env={**os.environ, **environment})


def one_line_reason(process):
    """The line that says why, and a check that no traceback reached the user."""
    assert "Traceback" not in process.stderr
    reasons = [line for line in process.stderr.splitlines() if line.startswith("replan: ")]
    assert len(reasons) == 1
    return reasons[0]
