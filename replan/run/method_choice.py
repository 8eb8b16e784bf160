"""Which method a run may ask for, with which parts left out and what it is told."""

from typing import TYPE_CHECKING, cast, get_args

from control.errors import ConfigError
from planning.baselines import METHODS
from planning.loop.results import LoopSettings, Part

if TYPE_CHECKING:
    from replan.run.options import RunOptions


def check_variant(options: "RunOptions") -> None:
    """Refuse variants of the method that this program does not have.

    Raises:
        ConfigError: One that is asked for.
    """
    unknown = [part for part in options.without if part not in get_args(Part)]
    if unknown:
        raise ConfigError(f"the method has no part '{unknown[0]}' to leave out; there are: {', '.join(get_args(Part))}")
    if options.without and options.method != "replan":
        raise ConfigError(f"only the method 'replan' has parts to leave out; '{options.method}' has none")
    if options.method not in METHODS:
        raise ConfigError(f"there is no method '{options.method}'; there are: {', '.join(METHODS)}")
    if options.told and not METHODS[options.method].symbolic:
        able = ", ".join(name for name, method in METHODS.items() if method.symbolic)
        raise ConfigError(f"the method '{options.method}' cannot be told facts (--told); these can: {able}")
    if options.poses not in ("seen", "true"):
        raise ConfigError(f"poses '{options.poses}' are not known; there are: seen, true")
    if options.poses == "true" and not options.score:
        raise ConfigError("true poses come from a simulated cell that is scored; only benchmarks start one")


def settings_of(options: "RunOptions") -> LoopSettings:
    """Bounds of the run, and the parts of the method that are left out; checked before."""
    return LoopSettings(without=frozenset(cast(tuple[Part, ...], options.without)))
