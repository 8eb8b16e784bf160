"""How options are spelled on the command line, where that is not the name of their field."""

from typing import Annotated

import tyro

Switches = Annotated[tuple[str, ...], tyro.conf.arg(name="option"), tyro.conf.UseAppendAction]  # --option A --option B
SetOnly = Annotated[bool, tyro.conf.FlagCreatePairsOff]  # no --no-... beside it
