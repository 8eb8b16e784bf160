"""libfranka gives the thread that commands an arm the highest real-time priority, asked or not, for good.

Every thread and process that such a thread starts inherits it, and two of them that compute leave nothing of two
processors to anybody else: links die, heartbeats stop. So a thread keeps that priority for a motion alone, and only
where real time was asked for.
"""

import os
from collections.abc import Callable
from typing import Any

Callback = Callable[[Any, Any], Any]  # libfranka's: a robot state and the time since the last one to a command


def in_own_scheduling(control: Callable[[Callback], None], callback: Callback, realtime: bool = False) -> None:
    """Play a motion through libfranka and leave this thread scheduled as it was.

    Args:
        control: Begins the motion with a callback and returns when it has ended.
        callback: Answers a robot state with a command.
        realtime: Keep libfranka's priority during the motion; else it is given up at the first state.

    Raises:
        Exception: What `control` raises.
    """
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    first = not realtime

    def answer(state: Any, period: Any) -> Any:
        nonlocal first
        if first:
            first = False
            os.sched_setscheduler(0, *before)
        return callback(state, period)

    try:
        control(answer)
    finally:
        os.sched_setscheduler(0, *before)
