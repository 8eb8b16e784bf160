"""How options are spelled on the command line, where that is not the name of their field.

Options are plain dataclasses beside the functions that take them; their defaults and their help texts stand there. A
command inherits from them, spells flags with what is here, and hands the function its own type of options back.
"""

from collections.abc import Mapping
from dataclasses import fields
from typing import Annotated, Any, TypeVar

import tyro

T = TypeVar("T")

Switches = Annotated[tuple[str, ...], tyro.conf.arg(name="option"), tyro.conf.UseAppendAction]  # --option A --option B
Repeated = Annotated[tuple[str, ...], tyro.conf.UseAppendAction]
SetOnly = Annotated[bool, tyro.conf.FlagCreatePairsOff]  # no --no-... beside it


def options_in(command: Any, kind: type[T], **others: Any) -> T:
    """The options of one kind that a command holds, without what else is in it.

    Args:
        command: Has all fields of `kind`.
        kind: A dataclass.
        others: Values in place of the command's own, by field.
    """
    own: Mapping[str, Any] = {f.name: getattr(command, f.name) for f in fields(kind) if f.init}  # type: ignore[arg-type]
    return kind(**{**own, **others})
