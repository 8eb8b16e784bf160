"""`replan doctor`: what is installed, what works here, whether a robot and a language server answer."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from replan.options import DEFAULT_ENDPOINT

if TYPE_CHECKING:
    from replan.console import Console


@dataclass(frozen=True)
class Doctor:
    """Say what is installed, what works on this machine, and whether a robot answers.

    Packages, rendering, weights, language backends. Exit code 0 when a simulated run (with --robot-side: a robot's
    process) is possible, else 1.
    """

    robot: str = DEFAULT_ENDPOINT
    """Endpoint of a robot process to look for (tcp/HOST:PORT), or address of a Panda's control box (HOST)."""
    link: Path | None = None
    """Link file with this machine's certificates, for tls/ endpoints; it is examined too (docs/security.md)."""
    robot_side: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Look only at what the robot's own computer needs (`make setup-robot`)."""
    detector: str = "default"
    """Also look at these detector weights: local folder or hub name."""
    segmenter: str = "default"
    """Also look at these segmenter weights: local folder or hub name."""
    reasoner_url: str | None = None
    """Address of a language server to look for, usually ending with /v1."""
    reasoner_model: str | None = None
    """Also put one short question to this model of it."""
    reasoner_key_variable: str = "OPENAI_API_KEY"
    """Environment variable that holds the server's key."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Examine and report."""
        if self.robot_side:
            from replan.doctor.machine import examine_robot_side, render

            findings = examine_robot_side(self.robot, self.link)
            console.result(findings.as_json(), render(findings))
            return 0 if findings.complete else 1
        console.note("examining packages, rendering, model weights, language backends and robot")
        from replan.doctor.machine import examine, render

        url = self.reasoner_url
        server = None if url is None else (url, self.reasoner_model, self.reasoner_key_variable)
        findings = examine(self.robot, self.detector, self.segmenter, server, self.link)
        console.result(findings.as_json(), render(findings))
        return 0 if findings.complete else 1
