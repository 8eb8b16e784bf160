"""What the parts of one run share: the robot's side, the cell file, the record, and whoever is told."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from replan.run.episode import Episode
from replan.run.film import Film
from replan.run.stopwatch import Stopwatch

if TYPE_CHECKING:
    from control.robot.limits import RobotLimits
    from hw_interface.cell.client import CellClient
    from sim_check.cells.loading import CellConfig


@dataclass(frozen=True)
class RunSession:
    """One run, connected.

    Attributes:
        client: Connection to the robot's side.
        cell: The cell file; never the simulated cell's truth.
        limits: Published limits of the robot's profile.
        episode: Record of the run.
        film: Gets pictures.
        say: Progress for people.
        watch: Shares out the run's time.
    """

    client: "CellClient"
    cell: "CellConfig"
    limits: "RobotLimits"
    episode: Episode
    film: Film
    say: Callable[[str], None]
    watch: Stopwatch
