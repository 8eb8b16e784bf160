"""Errors of perception.

PerceptionError
├── CatalogueError        a catalogue of objects that cannot be used: unknown keys, values that are not valid
├── FrameError            a frame that cannot be used: wrong size, no valid depth, bad intrinsics
├── MissingPackageError   an optional package that is not installed
├── ModelUnavailableError a detector or segmenter whose weights, packages or device are not on this machine
├── OptionError           an option that is outside of its range
└── UnknownPhraseError    a phrase that the chosen detector has no way to look for

The other folders have `control.errors.StackError` as their root; `replan_base.errors` draws both together.
"""

from replan_base.errors import ReplanError


class PerceptionError(ReplanError):
    """Root of what perception raises; the message says what was wrong, what would be valid, what to do."""


class CatalogueError(PerceptionError):
    """A catalogue of objects that is not valid."""


class FrameError(PerceptionError):
    """A frame that cannot be used."""


class MissingPackageError(PerceptionError):
    """An optional package that is not installed; the message says what to install."""


class ModelUnavailableError(PerceptionError):
    """A model whose weights, packages or device are not on this machine."""


class OptionError(PerceptionError):
    """An option of perception that is not valid."""


class UnknownPhraseError(PerceptionError):
    """A phrase that the detector cannot look for."""
