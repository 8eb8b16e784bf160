"""`replan doctor`: what is installed, what works here, whether a robot answers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import tyro

from replan.commands.robot import DEFAULT_ENDPOINT

if TYPE_CHECKING:
    from replan.console import Console


@dataclass(frozen=True)
class Doctor:
    """Say what is installed, which rendering works, which model weights are here, and whether a robot answers.

    Exit code 0 when a simulated run is possible, else 1.
    """

    robot: str = DEFAULT_ENDPOINT
    """Endpoint to look for a robot at."""
    detector: str = "default"
    """Also look at these detector weights: local folder or hub name."""
    segmenter: str = "default"
    """Also look at these segmenter weights: local folder or hub name."""
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print one JSON object on stdout."""

    def execute(self, console: Console) -> int:
        """Examine and report."""
        console.note("examining packages, rendering, model weights and robot")
        from replan.doctor import examine, render

        findings = examine(self.robot, self.detector, self.segmenter)
        console.result(findings.as_json(), render(findings))
        return 0 if findings.can_simulate else 1
