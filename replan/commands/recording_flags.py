"""How the options of reading a recording are spelled."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import tyro

from perception.recordings.mcap_choice import McapChoice
from replan.commands.flags import options_in
from replan.perceive.options import ReadingOptions


@dataclass(frozen=True)
class McapFlags(McapChoice):
    """What to read out of an MCAP file."""

    colour: Annotated[str | None, tyro.conf.arg(name="colour-topic")] = McapChoice.colour
    depth: Annotated[str | None, tyro.conf.arg(name="depth-topic")] = McapChoice.depth
    info: Annotated[str | None, tyro.conf.arg(name="info-topic")] = McapChoice.info
    cameras: tyro.conf.Suppress[tuple[str, ...]] = McapChoice.cameras
    tolerance: Annotated[float, tyro.conf.arg(name="stamp-tolerance")] = McapChoice.tolerance


@dataclass(frozen=True, kw_only=True)
class ReadingFlags(ReadingOptions):
    """Which frames of a recording are read, and how."""

    mcap: McapFlags = field(default_factory=McapFlags)

    def options(self) -> ReadingOptions:
        """The options."""
        return options_in(self, ReadingOptions, mcap=options_in(self.mcap, McapChoice))
