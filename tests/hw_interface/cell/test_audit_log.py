"""The audit log survives what may happen to its writer, and nothing moves without it."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from benchmarks.robot_side.perfect_robot import certificate, perfect_driver, swing
from control.errors import ConfigError, MachineError, RefusedError
from hw_interface.cell.audit import Audit
from hw_interface.cell.audit_log import AuditLog, DamagedLine, read_audit_log
from tests.support.waiting import until

WRITER = """
import sys
from pathlib import Path
from hw_interface.cell.audit_log import AuditLog
log = AuditLog(Path(sys.argv[1]))
print("writing", flush=True)
while True:
    log.record("asked", what="trajectory", text="x" * 300)
"""


def test_what_was_written_is_read_in_order_with_its_numbers(tmp_path: Path):
    log = AuditLog(tmp_path / "new" / "audit.jsonl", clock=lambda: 12.5)
    log.record("stop", reason="a person's")
    log.record("mode", force=True, mode="stopped")
    log.close()
    assert list(read_audit_log(log.path)) == [
        {"number": 1, "time": 12.5, "event": "stop", "reason": "a person's", "crc": pytest.approx(0, abs=2**32)},
        {"number": 2, "time": 12.5, "event": "mode", "mode": "stopped", "crc": pytest.approx(0, abs=2**32)},
    ]
    again = AuditLog(log.path)
    again.record("speed", speed=0.5)
    numbers = [line["number"] for line in read_audit_log(log.path) if isinstance(line, dict)]
    assert numbers == [1, 2, 3], "numbers go on when the log is opened again"


def test_a_writer_killed_at_any_moment_leaves_a_readable_log(tmp_path: Path):
    path = tmp_path / "audit.jsonl"
    for pause in (0.01, 0.05, 0.11):
        process = subprocess.Popen([sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE)
        assert process.stdout is not None
        process.stdout.readline()
        before = path.read_bytes().count(b"\n")
        assert until(lambda before=before: path.read_bytes().count(b"\n") > before + 5)
        time.sleep(pause)
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        process.stdout.close()
        lines = list(read_audit_log(path))
        assert len(lines) > 5
        assert [k for k, line in enumerate(lines[:-1]) if isinstance(line, DamagedLine)] == []


def test_a_line_that_was_cut_or_changed_is_named_and_the_others_are_kept(tmp_path: Path):
    log = AuditLog(tmp_path / "audit.jsonl")
    for k in range(3):
        log.record("speed", speed=k)
    log.close()
    text = log.path.read_bytes()
    log.path.write_bytes(text.replace(b'"speed":1', b'"speed":7') + b'{"number":4,"ti')
    read = list(read_audit_log(log.path))
    assert [type(line) for line in read] == [dict, DamagedLine, dict, DamagedLine]
    assert read[1] == DamagedLine(2, False) and read[3] == DamagedLine(4, True)
    after = AuditLog(log.path)
    after.record("stop")
    last = list(read_audit_log(log.path))[-1]
    assert isinstance(last, dict) and last["event"] == "stop", "what comes later stands on a line of its own"


def test_a_place_that_cannot_be_written_is_said_before_anything_starts(tmp_path: Path):
    (tmp_path / "file").write_text("")
    with pytest.raises(MachineError, match="free or name another place: --audit-log FILE"):
        AuditLog(tmp_path / "file" / "audit.jsonl")
    with pytest.raises(ConfigError, match="cannot be read"):
        list(read_audit_log(tmp_path / "none.jsonl"))


def full_disk(tmp_path: Path) -> AuditLog:
    """A log whose every write fails for want of room."""
    path = tmp_path / "audit.jsonl"
    log = AuditLog(path)
    os.dup2(os.open("/dev/full", os.O_WRONLY), log._file)
    return log


def test_no_motion_is_asked_for_when_the_disk_is_full(tmp_path: Path):
    driver, _ = perfect_driver()
    audit = Audit(driver, full_disk(tmp_path))
    assert driver.mode == "reflex", "a log that cannot be kept latches the robot at once"
    error = driver.state().last_error
    assert error is not None and error.code == "audit_log" and "nothing moves without it: make room" in error.reason
    motion = swing(0.5, 0.02)
    with pytest.raises(RefusedError) as refused, audit.asking("trajectory"):
        driver.submit(motion, certificate(motion))
    assert refused.value.code == "audit_log" and not driver.moving


def test_a_disk_that_fills_up_in_a_motion_brings_the_arm_to_rest(tmp_path: Path):
    driver, _ = perfect_driver()
    log = AuditLog(tmp_path / "audit.jsonl")
    audit = Audit(driver, log)
    motion = swing(1.0, 0.1)
    with audit.asking("trajectory"):
        driver.submit(motion, certificate(motion))
    os.dup2(os.open("/dev/full", os.O_WRONLY), log._file)
    for _ in range(300):
        driver.tick()
        audit.watch()
    assert not driver.moving and driver.mode == "reflex"
    error = driver.state().last_error
    assert error is not None and error.code == "audit_log"


def test_a_request_waits_for_the_disk_once_and_nothing_moves_when_that_fails(tmp_path: Path, monkeypatch):
    driver, _ = perfect_driver()
    log = AuditLog(tmp_path / "audit.jsonl")
    audit = Audit(driver, log)
    start, motion = np.array(driver.state().q_d), swing(1.0, 0.1)
    written = []

    def broken(file: int) -> None:
        written.append(log.path.read_text())
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(os, "fdatasync", broken)
    with audit.asking("trajectory", force=False):
        driver.submit(motion, certificate(motion))
    assert len(written) == 1 and '"event":"asked"' in written[0] and '"event":"granted"' in written[0]
    for _ in range(100):
        driver.tick()
        assert np.array_equal(driver.state().q_d, start)
    error = driver.state().last_error
    assert driver.mode == "reflex" and error is not None and error.code == "audit_log"
