"""Errors of everything but perception (which may import nothing and has `perception.errors`).

StackError
├── ConfigError            a cell file, profile or option that is not valid
│   └── MachineError       something that this machine lacks or that is taken: rendering, a port, a program
├── GoalError              a goal that cannot be understood or is empty
├── RewardSpecError        a reward program or spec that breaks the vocabulary
│   ├── UnknownObjectError a name that the scene does not have
│   └── TermConflictError  two terms of a spec that cannot hold together
├── TrajectoryError        a trajectory that is malformed or breaks a limit
│   ├── RetimingError      a path for which no timing within the limits was found
│   └── MotionFileError    a motion file that cannot be read as one
├── RefusedError           the driver refused (reason code and text); nothing moved
├── RobotGoneError         the robot process died, froze or never answered
├── StoppedError           motion was stopped on request; the arm is at rest on its path
└── ReasonerError          a language backend failed
    └── NoUsableAnswerError    it kept answering malformed text
"""

from replan_base.errors import ReplanError


class StackError(ReplanError):
    """Root of the stack's errors; the message names what was wrong, what would be valid and what to do next."""


class ConfigError(StackError):
    """A cell file, robot profile or option that is not valid."""


class MachineError(ConfigError):
    """Something that this machine lacks or that is taken: rendering, a port, a program."""


class GoalError(StackError):
    """A goal that is empty or cannot be understood."""


class RewardSpecError(StackError):
    """A reward program or spec that breaks the vocabulary."""


class UnknownObjectError(RewardSpecError):
    """A name that the scene does not have."""


class TermConflictError(RewardSpecError):
    """Two terms of a spec that cannot hold together."""


class TrajectoryError(StackError):
    """A trajectory that is malformed or breaks a limit."""


class RetimingError(TrajectoryError):
    """A path for which no timing within the limits was found."""


class MotionFileError(TrajectoryError):
    """A motion file that cannot be read as one; names the file, and where it can the row and the column."""


class RefusedError(StackError):
    """The driver refused a request; nothing moved.

    Attributes:
        code: Machine-readable reason, for instance ``certificate_used``.
    """

    def __init__(self, code: str, reason: str) -> None:
        super().__init__(reason)
        self.code = code


class RobotGoneError(StackError):
    """The robot process died, froze or never answered."""


class StoppedError(StackError):
    """Motion was stopped on request; the arm is at rest on its path."""


class ReasonerError(StackError):
    """A language backend failed, or does not know what to do with a question."""


class NoUsableAnswerError(ReasonerError):
    """A language backend kept answering text that does not have the asked form."""
