"""`replan security init|show`: keys and certificates of links between machines."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    from replan.console import Console


@dataclass(frozen=True)
class SecurityInit:
    """Make an authority, and keys, certificate and link file for robot, router, camera, operator, viewer and ros2.

    Nothing is ever overwritten. Copy to each machine only the files of its role and ca.pem; keep ca-key.pem away from
    all of them (docs/security.md).
    """

    folder: tyro.conf.Positional[Path]
    """Where to put them."""
    host: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """Name or IP address under which the robot's or the router's machine is reached; may be repeated."""
    days: int = 730
    """How long the certificates hold."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Make the files."""
        import datetime

        from hw_interface.link.keys import make_keys

        links = make_keys(self.folder, self.host, self.days, datetime.datetime.now(datetime.UTC))
        lines = "\n".join(f"  {link}" for link in links)
        console.result(
            {"links": [str(link) for link in links], "hosts": list(self.host), "days": self.days},
            f"link files, for --link (valid for {self.days} days, hosts {', '.join(self.host)}):\n{lines}",
        )
        return 0


@dataclass(frozen=True)
class SecurityShow:
    """Examine the certificates of a link file: role, hosts, until when they hold, whether they belong together.

    Exit code 1 when one cannot be used, expires within 30 days, or its key can be read by others.
    """

    link: tyro.conf.Positional[Path]
    """Link file (YAML)."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Examine and report."""
        import datetime

        from hw_interface.link.keys import examine_keys
        from hw_interface.link.security import read_link_file

        known = examine_keys(read_link_file(self.link), datetime.datetime.now(datetime.UTC))
        rows = [
            {
                "file": str(k.path),
                "name": k.name,
                "hosts": list(k.hosts),
                "begins": k.begins.isoformat(),
                "expires": k.expires.isoformat(),
                "trouble": k.trouble,
            }
            for k in known
        ]
        lines = [
            f"{k.path}: '{k.name}'"
            + (f" at {', '.join(k.hosts)}" if k.hosts else "")
            + f", good until {k.expires:%Y-%m-%d}"
            + (f"; TROUBLE: {k.trouble}" if k.trouble else "")
            for k in known
        ]
        console.result({"certificates": rows}, "\n".join(lines))
        return 1 if any(k.trouble for k in known) else 0


@dataclass(frozen=True)
class Security:
    """Keys and certificates of links between machines: make them, examine them."""

    which: tyro.conf.OmitSubcommandPrefixes[
        tyro.conf.OmitArgPrefixes[
            Annotated[SecurityInit, tyro.conf.subcommand("init")]
            | Annotated[SecurityShow, tyro.conf.subcommand("show")]
        ]
    ]

    @property
    def json(self) -> bool:
        """Whether the chosen command prints JSON."""
        return self.which.json

    def execute(self, console: Console) -> int:
        """Run the chosen command."""
        return self.which.execute(console)
