"""The root of all errors that a person may meet.

ReplanError
├── control.errors.StackError          the stack's errors (drawn in control/errors.py)
├── perception.errors.PerceptionError  perception's errors (drawn in perception/errors.py)
├── MissingPartError                   a package that is not always there is not installed
└── ForeignPackageError                a package of ours is mixed with, or hidden by, somebody else's of the same name
"""


class ReplanError(Exception):
    """Root; the message names what was wrong, what would be valid and what to do next."""


class MissingPartError(ReplanError):
    """A package that is not always there is not installed; the message says what to type."""


class ForeignPackageError(ReplanError):
    """A top-level package of ours is mixed with, or hidden by, somebody else's of the same name."""
