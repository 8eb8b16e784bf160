"""What a motion search returns."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from control.trajectory.samples import JointPath


@dataclass(frozen=True)
class MotionStats:
    """What a search spent and saw.

    Attributes:
        steps: Simulated steps (mj_step) spent.
        seconds: Wall time in [s].
        counts: Candidates by stage, for instance {"grasps": 96, "grasps_reachable": 41, "rollouts": 24, "clean": 17}.
    """

    steps: int
    seconds: float
    counts: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class MotionPlan:
    """A motion that met the primary reward in the twin.

    Attributes:
        path: To be retimed; its first waypoint is the twin's start configuration.
        description: One line for people: which grasp, which way.
        cost: Cost of the chosen candidate, lower is better.
        stats: What the search spent.
        end: Configuration of the twin's model after the motion, shape (nq,); None where nothing was simulated.
        alternatives: Other successful paths, best first, for when retiming or the verdict turns the first one down.
    """

    path: JointPath
    description: str
    cost: float
    stats: MotionStats
    end: NDArray[np.float64] | None = None
    alternatives: tuple[JointPath, ...] = ()
