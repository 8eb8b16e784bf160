"""All errors that a person may meet, in one place, with the exit code that each leads to.

control.errors.StackError          the stack's tree (drawn in control/errors.py)
perception.errors.PerceptionError  perception's tree (drawn in perception/errors.py); it may import nothing of ours

Exit codes: 0 done, 1 error with a one-line reason, 2 usage, 3 goal not reached, 4 unsafe or refused, 130 interrupted.
"""

from control.errors import ConfigError, GoalError, MachineError, MotionFileError, RefusedError, StackError
from perception.errors import OptionError, PerceptionError

DONE, ERROR, USAGE, NOT_REACHED, UNSAFE, INTERRUPTED = 0, 1, 2, 3, 4, 130

EXPECTED_ERRORS = (StackError, PerceptionError)


def exit_code(error: BaseException) -> int:
    """The exit code that an expected error leads to."""
    if isinstance(error, RefusedError):
        return UNSAFE
    if isinstance(error, MachineError):
        return ERROR
    if isinstance(error, (ConfigError, GoalError, MotionFileError, OptionError)):
        return USAGE
    return ERROR
