"""libfranka gives the thread that commands an arm the highest real-time priority, asked or not, for good.

Every thread and process that such a thread starts inherits it, and two of them that compute leave nothing of two
processors to anybody else: links die, heartbeats stop. So a thread keeps that priority for a motion alone, and not
even then where the robot's clock waits for it (a simulated box in lockstep).
"""

import contextlib
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

KERNEL_FILE = Path("/sys/kernel/realtime")  # where a PREEMPT_RT kernel says so, and where libfranka looks
Callback = Callable[[Any, Any], Any]  # libfranka's: a robot state and the time since the last one to a command


def in_own_scheduling(control: Callable[[Callback], None], callback: Callback, realtime: bool = False) -> None:
    """Play a motion through libfranka and leave this thread scheduled as it was.

    Args:
        control: Begins the motion with a callback and returns when it has ended.
        callback: Answers a robot state with a command.
        realtime: Keep libfranka's priority during the motion, where this user may have it; else it is given up at the
            first state.

    Raises:
        Exception: What `control` raises.
    """
    with _scheduling_kept() as as_it_was:
        first = not realtime

        def answer(state: Any, period: Any) -> Any:
            nonlocal first
            if first:
                first = False
                as_it_was()
            return callback(state, period)

        control(answer)


@contextlib.contextmanager
def _scheduling_kept() -> Iterator[Callable[[], None]]:
    """Leaves this thread scheduled as it was; gives what schedules it so sooner."""
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    as_it_was = lambda: os.sched_setscheduler(0, *before)  # noqa: E731
    try:
        yield as_it_was
    finally:
        as_it_was()


def kernel_is_real_time(kernel: Path = KERNEL_FILE) -> bool:
    """Whether this machine's kernel keeps deadlines (PREEMPT_RT).

    Args:
        kernel: File in which it says so.
    """
    try:
        return kernel.read_text().strip() == "1"
    except OSError:
        return False


def real_time_trouble(kernel: Path = KERNEL_FILE) -> str | None:
    """Why an arm cannot be commanded in real time from this machine by this user, and what to do; None if it can.

    Args:
        kernel: As in `kernel_is_real_time`.
    """
    if not kernel_is_real_time(kernel):
        return (
            "this machine's kernel is not real-time (PREEMPT_RT), so commands come late when it is busy, and the "
            "control box stops the arm; boot a real-time kernel"
        )
    with _scheduling_kept():
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(os.sched_get_priority_max(os.SCHED_FIFO)))
        except PermissionError:
            return (
                "this user may not have real-time priority: add the line '@realtime - rtprio 99' to "
                "/etc/security/limits.conf, join that group (groupadd realtime; usermod -aG realtime USER) and log in "
                "again"
            )
    return None
