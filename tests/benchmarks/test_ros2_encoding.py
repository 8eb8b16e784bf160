"""The benchmark of ROS 2's encoders compares two that write the same, and reports both for every message."""

import json
import subprocess
import sys


def test_every_message_is_measured_with_both_encoders_and_both_kinds_of_memory():
    command = [sys.executable, "-m", "benchmarks.robot_side.ros2_encoding", "--repeats", "2", "--starts", "1", "--json"]
    report = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    measured = {(r["message"], r["memory"], r["encoder"]) for r in report["rows"]}
    assert len(measured) == len(report["rows"]) == 16
    assert all(0.0 < r["p10"] <= r["p50"] <= r["p90"] for r in report["rows"])
    assert len(report["types"]) == len(report["first"]) == 1
