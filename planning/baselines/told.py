"""Facts that a person tells a symbolic planner, because no camera sees them.

J is locked until K is open      J and K are joints of furniture; a pressed plate counts as open
J is blocked by X                X is a loose thing that must be moved away before J can be driven
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from control.errors import ConfigError
from planning.language.furnishings import KnownFurniture

UNDERSTOOD = '"JOINT is locked until JOINT is open" and "JOINT is blocked by OBJECT"'
_LOCKED = re.compile(r"(\w+) is locked until (\w+) is open")
_BLOCKED = re.compile(r"(\w+) is blocked by (\w+)")


@dataclass(frozen=True)
class Told:
    """All that was told.

    Attributes:
        locks: (door, joint that must be open first).
        blocks: (joint, thing that must be moved away first).
    """

    locks: tuple[tuple[str, str], ...] = ()
    blocks: tuple[tuple[str, str], ...] = ()

    def keys_of(self, joint: str) -> tuple[str, ...]:
        """Joints that must be open before this one opens."""
        return tuple(k for j, k in self.locks if j == joint)

    def blockers_of(self, joint: str) -> tuple[str, ...]:
        """Things that must be moved away before this joint moves."""
        return tuple(x for j, x in self.blocks if j == joint)


def read_told(sentences: Sequence[str], furniture: Mapping[str, KnownFurniture], names: Sequence[str]) -> Told:
    """Read what was told.

    Args:
        sentences: One fact each, with exact names.
        furniture: Of the cell, by name.
        names: Of the loose things that may be there.

    Raises:
        ConfigError: A sentence of another form, or a name that the cell does not have.
    """
    joints = sorted(j.name for f in furniture.values() for j in f.joints)
    locks, blocks = [], []
    for sentence in sentences:
        text = " ".join(sentence.split()).rstrip(".")
        locked, blocked = _LOCKED.fullmatch(text), _BLOCKED.fullmatch(text)
        if locked:
            _check(sentence, locked[1], joints, "joint")
            _check(sentence, locked[2], joints, "joint")
            if locked[1] == locked[2]:
                raise ConfigError(f"told '{sentence}': a joint cannot be its own key; name another joint")
            locks.append((locked[1], locked[2]))
        elif blocked:
            _check(sentence, blocked[1], joints, "joint")
            _check(sentence, blocked[2], sorted(set(names) - set(furniture)), "object")
            blocks.append((blocked[1], blocked[2]))
        else:
            raise ConfigError(f"told '{sentence}': cannot understand this; say {UNDERSTOOD}, with exact names")
    return Told(tuple(locks), tuple(blocks))


def _check(sentence: str, name: str, valid: Sequence[str], what: str) -> None:
    if name not in valid:
        raise ConfigError(f"told '{sentence}': there is no {what} '{name}'; there are {', '.join(valid) or 'none'}")
