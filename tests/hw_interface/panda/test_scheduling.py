"""Real-time priority: whether it can be had is told before an arm moves."""

import os
from pathlib import Path

import pytest

from hw_interface.panda.scheduling import in_own_scheduling, kernel_is_real_time, real_time_trouble


@pytest.fixture
def kernel(tmp_path: Path) -> Path:
    """The file in which a real-time kernel says that it is one."""
    file = tmp_path / "realtime"
    file.write_text("1\n")
    return file


def test_an_ordinary_kernel_is_told(tmp_path: Path, kernel: Path):
    assert kernel_is_real_time(kernel)
    for other in (tmp_path / "absent", kernel):
        kernel.write_text("0\n")
        assert not kernel_is_real_time(other)
        assert (real_time_trouble(other) or "").startswith("this machine's kernel is not real-time (PREEMPT_RT)")


def test_a_user_without_the_right_to_real_time_is_told_how_to_get_it(kernel: Path, monkeypatch: pytest.MonkeyPatch):
    kept = os.sched_setscheduler

    def refuse(pid: int, policy: int, param: os.sched_param) -> None:
        if policy == os.SCHED_FIFO:
            raise PermissionError(1, "Operation not permitted")
        kept(pid, policy, param)

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    assert "add the line '@realtime - rtprio 99' to /etc/security/limits.conf" in (real_time_trouble(kernel) or "")


def test_looking_changes_nothing(kernel: Path):
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    real_time_trouble(kernel)
    assert (os.sched_getscheduler(0), os.sched_getparam(0)) == before


def test_a_motion_that_fails_leaves_the_priority_as_it_was():
    before = os.sched_getscheduler(0)

    def control(_answer: object) -> None:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        except PermissionError:
            pytest.skip("this user may not have real-time priority")
        raise RuntimeError("aborted")

    with pytest.raises(RuntimeError, match="aborted"):
        in_own_scheduling(control, lambda state, period: None)
    assert os.sched_getscheduler(0) == before
