"""`replan router`: one meeting point for robot, camera and planner processes on several machines."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from replan.options import DEFAULT_ENDPOINT

if TYPE_CHECKING:
    from replan.console import Console


@dataclass(frozen=True)
class Router:
    """Pass messages on between robot, camera and planner processes that connect to it, until Ctrl-C.

    Not needed for one robot process: that one listens itself. With a router the robot joins with
    `replan robot ... --connect ENDPOINT`, and everybody else gives the router's endpoint as --robot.
    """

    endpoint: str = DEFAULT_ENDPOINT
    """Where to listen: tcp/ within this machine, or tls/HOST:PORT with --link (tls/0.0.0.0:PORT: on every address)."""
    link: Path | None = None
    """Link file of role router, for tls/ endpoints (docs/security.md)."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print the ready line as JSON."""

    def execute(self, console: Console) -> int:
        """Run until told to stop."""
        from hw_interface.link.security import link_or_none
        from replan.robot.router import serve_router

        def announce(endpoint: str) -> None:
            console.result({"ready": True, "endpoint": endpoint}, f"router ready at {endpoint}; Ctrl-C ends it")

        serve_router(self.endpoint, link_or_none(self.link), announce)
        return 0
