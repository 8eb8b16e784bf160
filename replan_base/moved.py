"""Imports of modules that have moved end with one line that says where to.

A finder at the end of `sys.meta_path` sees only names that nobody else could find. The table of moves,
`moved_modules.json`, holds the old and the new names by the release that moved them.
"""

import json
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from types import MappingProxyType, ModuleType

from replan_base.packages import PACKAGES

TABLE = Path(__file__).with_name("moved_modules.json")


class MovedModules:
    """A finder that finds nothing: it raises for names in the table of moves, and leaves all others to Python."""

    @classmethod
    def find_spec(cls, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None) -> None:
        """Say where a module went.

        Raises:
            ModuleNotFoundError: The module has moved, or it is a package now and what was imported from it has moved.
                It has no `name`: `from package import module` drops an error that has the name which it looked for.
        """
        if fullname.partition(".")[0] not in PACKAGES:
            return
        parent, _, name = fullname.rpartition(".")
        if fullname in moves():
            new, release = moves()[fullname]
            raise ModuleNotFoundError(f"{fullname} has moved to {new} (version {release})")
        if parent in moves():  # `from control.trajectory import Trajectory`, where the module's name is a package's now
            new, release = moves()[parent]
            raise ModuleNotFoundError(
                f"{parent} has no '{name}'; what the module {parent} held has moved to {new} (version {release})"
            )


def tell_where_modules_went() -> None:
    """Let imports of moved modules say where they went; once is enough, more often does no harm."""
    if MovedModules not in sys.meta_path:
        sys.meta_path.append(MovedModules)


@cache
def moves() -> Mapping[str, tuple[str, str]]:
    """New name and the release that moved it, by old name."""
    table = json.loads(TABLE.read_text(encoding="utf-8"))
    return MappingProxyType({old: (new, release) for release, by_old in table.items() for old, new in by_old.items()})
