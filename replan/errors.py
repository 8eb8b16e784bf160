"""All errors that a person may meet, in one place, with the exit code that each leads to.

The tree is drawn in replan_base/errors.py; its root is `replan_base.errors.ReplanError`.

Exit codes: 0 done, 1 error with a one-line reason, 2 usage, 3 goal not reached, 4 unsafe or refused, 130 interrupted
by Ctrl-C, 143 by SIGTERM, 129 by SIGHUP.
"""

from control.errors import ConfigError, GoalError, MachineError, MotionFileError, RefusedError
from perception.errors import OptionError
from replan_base.interruption import EndedBySignal

DONE, ERROR, USAGE, NOT_REACHED, UNSAFE, INTERRUPTED = 0, 1, 2, 3, 4, 130


def exit_code(error: BaseException) -> int:
    """The exit code that an expected error or an interruption leads to."""
    if isinstance(error, EndedBySignal):
        return 128 + error.number  # as shells say it
    if isinstance(error, KeyboardInterrupt):
        return INTERRUPTED
    if isinstance(error, RefusedError):
        return UNSAFE
    if isinstance(error, MachineError):
        return ERROR
    if isinstance(error, (ConfigError, GoalError, MotionFileError, OptionError)):
        return USAGE
    return ERROR
