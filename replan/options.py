"""Groups of options that several parts of the program take. A default stands here once; commands spell the flags."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sim_check.cells.loading import CellConfig

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"


@dataclass(frozen=True, kw_only=True)
class CellOptions:
    """Which cell."""

    cell: str = "cubes"
    """Built-in cell or a cell file (YAML)."""
    cell_options: tuple[str, ...] = ()
    """Switch of the cell to turn on; may be repeated."""

    def load(self) -> CellConfig:
        """The cell, with its switches turned on.

        Raises:
            ConfigError: There is no such cell or switch, or the file is not valid.
        """
        from sim_check.cells.loading import load_cell

        return load_cell(self.cell, dict.fromkeys(self.cell_options, True))


@dataclass(frozen=True, kw_only=True)
class ClientOptions:
    """Where a robot process is that runs already."""

    robot: str = DEFAULT_ENDPOINT
    """Endpoint of the robot process or router: tls/HOST:PORT with --link on another machine."""
    link: Path | None = None
    """Link file with this machine's certificates, for tls/ endpoints (docs/security.md)."""


@dataclass(frozen=True, kw_only=True)
class ListenOptions:
    """Where a robot process is offered, and how often it tells its state."""

    endpoint: str = DEFAULT_ENDPOINT
    """Where to listen: tcp/ within this machine, or tls/HOST:PORT with --link."""
    connect: str | None = None
    """Join the router at this endpoint (`replan router`) instead of listening."""
    link: Path | None = None
    """Link file with this machine's certificates, for tls/ endpoints (docs/security.md)."""
    state_rate: float = 70.0
    """States a second to publish, at most 1000."""


@dataclass(frozen=True, kw_only=True)
class ChildOptions:
    """Of a process that another one started."""

    parent_pid: int | None = None
    """End when this process is gone."""


@dataclass(frozen=True, kw_only=True)
class ConnectionOptions:
    """Where the robot is: a process that runs already, or a simulated cell that is started."""

    robot: str | None = None
    """Endpoint of a running robot process or router, for instance tcp/127.0.0.1:7447, or tls/HOST:PORT with --link.
    Default: start a simulated cell."""
    link: Path | None = None
    """Link file with this machine's certificates, for tls/ endpoints (docs/security.md)."""
